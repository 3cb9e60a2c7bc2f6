// y[n, b] = sum_k weight[n, k] * x[k, b], weights in bfloat16 or in int8 with a scale per row, at the memory's speed.
//
// Each weight is read once, whatever the number of columns b. The vectors are those of GCC and Clang, which split them
// where the machine's are shorter; `native.py` compiles this file for the machine it runs on, when it is first asked to.
// Activations and sums are float32, except where the machine has dot products of bytes: there a column becomes integers
// of 23 bits (float32's own precision, against its largest entry), their three bytes are multiplied with the weights
// without rounding, and only their sums are rounded to float32.

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <thread>
#include <vector>

#include "xla/ffi/api/ffi.h"

#if defined(__AVX512VNNI__) || defined(__AVXVNNI__)
#include <immintrin.h>
#define BYTE_DOTS 1
#endif

namespace {

namespace ffi = xla::ffi;

#ifdef __AVX512F__
constexpr int kBytes = 64;
#else
constexpr int kBytes = 32;
#endif
constexpr int kLanes = kBytes / 4;
constexpr int kRows = 4;                       // rows that share what is read of the columns
constexpr int kAhead = 2;                      // rounds of rows by which weights are called from memory in advance
constexpr int64_t kPortion = int64_t{1} << 17;  // bytes of weight that a thread takes at a time
constexpr int64_t kMostColumns = int64_t{1} << 16;  // of a weight; beyond, sums of bytes could overflow

typedef uint32_t Words __attribute__((vector_size(kBytes)));
typedef int32_t Ints __attribute__((vector_size(kBytes)));

template <class Vector>
inline Vector load(const void* from) {
  Vector v;
  std::memcpy(&v, from, sizeof v);
  return v;
}

inline void fetch(const void* soon) { __builtin_prefetch(soon, 0, 2); }  // beyond the end: does nothing

template <class Vector>
inline Vector load_part(const void* from, int64_t bytes) {
  Vector v{};
  std::memcpy(&v, from, bytes);
  return v;
}

template <class To, class From>
inline To as(From value) {
  static_assert(sizeof(To) == sizeof(From));
  To bits;
  std::memcpy(&bits, &value, sizeof bits);
  return bits;
}

template <int Bytes>
struct Lanes {
  typedef float Type __attribute__((vector_size(Bytes)));
};

template <int Bytes>
inline float sum(const typename Lanes<Bytes>::Type& v) {
  if constexpr (Bytes == 16) {
    return (v[0] + v[2]) + (v[1] + v[3]);
  } else {
    using Half = typename Lanes<Bytes / 2>::Type;
    const char* bytes = reinterpret_cast<const char*>(&v);
    return sum<Bytes / 2>(load<Half>(bytes) + load<Half>(bytes + Bytes / 2));
  }
}

using Floats = Lanes<kBytes>::Type;

inline int64_t blocks(int64_t n, int64_t size) { return (n + size - 1) / size; }

// Where the entries of y go, [lead, rows, columns]: from one row and one of all lead * columns columns on.
struct Place {
  float* y;
  int64_t rows, columns, row, column;
  float& operator()(int64_t r, int64_t c) const {
    const int64_t at = column + c;
    return y[(at / columns * rows + row + r) * columns + at % columns];
  }
};

// Weights of `kParts` to a 32-bit word, each turned into float32. Of every block of a column lie first the entries that
// meet the words' first parts, then those that meet the second: so no vector is ever shuffled.
template <class Entry, int kParts, Floats (*kPart)(Words, int)>
struct Plain {
  using Weight = Entry;
  static constexpr int kBlock = kParts * kLanes;  // weights in a vector
  static constexpr int kTile = kBytes == 64 ? 4 : 2;

  struct Column {
    std::vector<float> parted;
    void set(const float* x, int64_t k, int64_t step) {
      parted.assign(blocks(k, kBlock) * kBlock, 0.0f);
      for (int64_t i = 0; i < k; ++i)
        parted[i / kBlock * kBlock + i % kParts * kLanes + i % kBlock / kParts] = x[i * step];
    }
  };

  template <int R, int C>
  static void tile(const Weight* weight, int64_t k, const Column* x, const float* scale, const Place& y) {
    Floats total[R][C] = {};
    auto add = [&](int64_t at, auto read) {
      for (int r = 0; r < R; ++r) {
        const Words words = read(weight + r * k + at);
        fetch(weight + (kAhead * R + r) * k + at);
        for (int p = 0; p < kParts; ++p) {
          const Floats w = kPart(words, p);
          for (int c = 0; c < C; ++c) total[r][c] += w * load<Floats>(x[c].parted.data() + at + p * kLanes);
        }
      }
    };
    const int64_t whole = k / kBlock * kBlock;
    for (int64_t at = 0; at < whole; at += kBlock) add(at, [](const Weight* w) { return load<Words>(w); });
    if (whole < k) add(whole, [&](const Weight* w) { return load_part<Words>(w, (k - whole) * sizeof(Weight)); });
    for (int r = 0; r < R; ++r)
      for (int c = 0; c < C; ++c) y(r, c) = sum<kBytes>(total[r][c]) * (scale ? scale[r] : 1.0f);
  }
};

inline Floats number(Ints v) { return __builtin_convertvector(v, Floats); }
inline Floats half(Words words, int part) { return (Floats)(part ? words & 0xffff0000u : words << 16); }
inline Floats quarter(Words words, int part) { return number((Ints)(words << (24 - 8 * part)) >> 24); }

using Bfloat16 = Plain<uint16_t, 2, half>;

#ifdef BYTE_DOTS

struct Int8 {
  using Weight = int8_t;
  static constexpr int kBlock = kBytes;
  static constexpr int kTile = kBytes == 64 ? 2 : 1;
  static constexpr int kDigits = 3;
  static constexpr int32_t kMiddle = 1 << 22;

  // x = (value - middle) * unit with values of 23 bits; digits[d] holds the d-th byte of all values.
  struct Column {
    std::vector<uint8_t> digits[kDigits];
    float unit;
    void set(const float* x, int64_t k, int64_t step) {
      uint32_t top = 0;  // the magnitudes of floats are in the order of their bits; above all numbers are inf and nan
      for (int64_t i = 0; i < k; ++i) top = std::max(top, as<uint32_t>(x[i * step]) & 0x7fffffffu);
      const bool finite = top < 0x7f800000u;
      const float largest = as<float>(top);
      unit = finite ? largest / (kMiddle - 1) : std::nanf("");
      const float per_unit = finite && largest > 1e-30f ? (kMiddle - 1) / largest : 0.0f;
      for (auto& digit : digits) digit.assign(blocks(k, kBlock) * kBlock, 0);
      uint8_t *low = digits[0].data(), *middle = digits[1].data(), *high = digits[2].data();
      for (int64_t i = 0; i < k; ++i) {  // 1.5 * 2^23 rounds to an integer, whose value the mantissa then is
        const uint32_t bits = as<uint32_t>(x[i * step] * per_unit + 12582912.0f);
        low[i] = bits;
        middle[i] = bits >> 8;
        high[i] = bits >> 16 & 0x7f;
      }
    }
  };

  // Four products of an unsigned and a signed byte are added to each lane.
  static inline Ints dot(Ints total, Words unsigned_bytes, Words signed_bytes) {
#ifdef __AVX512VNNI__
    return (Ints)_mm512_dpbusd_epi32((__m512i)total, (__m512i)unsigned_bytes, (__m512i)signed_bytes);
#else
    return (Ints)_mm256_dpbusd_avx_epi32((__m256i)total, (__m256i)unsigned_bytes, (__m256i)signed_bytes);
#endif
  }

  template <int R, int C>
  static void tile(const Weight* weight, int64_t k, const Column* x, const float* scale, const Place& y) {
    Ints total[R][C][kDigits] = {}, plain[R] = {};
    const Words ones = Words{} + 0x01010101u;
    auto add = [&](int64_t at, auto read) {
      Words w[R];
      for (int r = 0; r < R; ++r) w[r] = read(weight + r * k + at), fetch(weight + (kAhead * R + r) * k + at);
      for (int r = 0; r < R; ++r) plain[r] = dot(plain[r], ones, w[r]);
      for (int c = 0; c < C; ++c)
        for (int d = 0; d < kDigits; ++d) {
          const Words digit = load<Words>(x[c].digits[d].data() + at);
          for (int r = 0; r < R; ++r) total[r][c][d] = dot(total[r][c][d], digit, w[r]);
        }
    };
    const int64_t whole = k / kBlock * kBlock;
    for (int64_t at = 0; at < whole; at += kBlock) add(at, [](const Weight* w) { return load<Words>(w); });
    if (whole < k) add(whole, [&](const Weight* w) { return load_part<Words>(w, k - whole); });
    for (int r = 0; r < R; ++r)
      for (int c = 0; c < C; ++c) {  // the middle, 64 in the third byte, is taken off before anything is rounded
        const Floats value = number(total[r][c][0]) + 256.0f * number(total[r][c][1]) +
                             65536.0f * number(total[r][c][2] - 64 * plain[r]);
        y(r, c) = sum<kBytes>(value) * x[c].unit * scale[r];
      }
  }
};

#else

using Int8 = Plain<int8_t, 4, quarter>;

#endif

// One product, shared by the threads that come in time.
template <class Kind>
struct Job {
  const typename Kind::Weight* weight;
  const float* scale;
  const typename Kind::Column* x;
  float* y;
  int64_t rows, k, lead, columns, portion;  // portion: rows taken at a time
  std::atomic<int64_t> taken{0}, done{0};

  int64_t portions() const { return blocks(rows, portion); }

  // Portions are taken until none is left; a thread that comes late finds none and touches nothing else.
  void work() {
    for (int64_t i; (i = taken.fetch_add(1)) < portions(); done.fetch_add(1))
      multiply(i * portion, std::min(rows, (i + 1) * portion));
  }

  void multiply(int64_t row, int64_t end) const {
    for (; row + kRows <= end; row += kRows) all_columns<kRows>(row);
    for (; row < end; ++row) all_columns<1>(row);
  }

  template <int R>
  void all_columns(int64_t row) const {
    const auto* w = weight + row * k;
    const float* s = scale ? scale + row : nullptr;
    int64_t c = 0;
    for (; c + Kind::kTile <= lead * columns; c += Kind::kTile)
      Kind::template tile<R, Kind::kTile>(w, k, x + c, s, Place{y, rows, columns, row, c});
    for (; c < lead * columns; ++c) Kind::template tile<R, 1>(w, k, x + c, s, Place{y, rows, columns, row, c});
  }
};

// `vmap` gives the weight leading axes of 1; its own batches of weights are refused.
template <class Kind, class Weight>
ffi::Error product(ffi::ThreadPool pool, const Weight& weight, const float* scale, ffi::Buffer<ffi::F32>& x,
                   ffi::Result<ffi::Buffer<ffi::F32>>& y) {
  const auto shape = weight.dimensions(), given = x.dimensions();
  if (shape.size() < 2 || given.size() != shape.size())
    return ffi::Error::InvalidArgument("a weight [N, K] and columns [K, B] were expected");
  const int64_t rows = shape[shape.size() - 2], k = shape.back(), columns = given.back();
  if (static_cast<int64_t>(weight.element_count()) != rows * k)
    return ffi::Error::InvalidArgument("a reduced weight was batched by vmap; batch the columns instead");
  if (given[given.size() - 2] != k || k > kMostColumns)
    return ffi::Error::InvalidArgument("the columns do not fit the weight, or it has more than 65536 of them");
  const int64_t lead = k && columns ? x.element_count() / (k * columns) : 0;
  thread_local std::vector<typename Kind::Column> prepared;
  if (static_cast<int64_t>(prepared.size()) < lead * columns) prepared.resize(lead * columns);
  for (int64_t c = 0; c < lead * columns; ++c)
    prepared[c].set(x.typed_data() + c / columns * k * columns + c % columns, k, columns);

  auto job = std::make_shared<Job<Kind>>();
  job->weight = reinterpret_cast<const typename Kind::Weight*>(weight.untyped_data());
  job->scale = scale, job->x = prepared.data(), job->y = y->typed_data();
  job->rows = rows, job->k = k, job->lead = lead, job->columns = columns;
  const int64_t row_bytes = std::max<int64_t>(1, k * sizeof(typename Kind::Weight));
  job->portion = std::max<int64_t>(kRows, kPortion / row_bytes / kRows * kRows);
  const int64_t helpers = std::min(pool.num_threads(), job->portions()) - 1;
  for (int64_t i = 0; i < helpers; ++i) pool.Schedule([job] { job->work(); });
  job->work();
  while (job->done.load() < job->portions()) std::this_thread::yield();
  return ffi::Error::Success();
}

ffi::Error bfloat16(ffi::ThreadPool pool, ffi::Buffer<ffi::BF16> weight, ffi::Buffer<ffi::F32> x,
                    ffi::Result<ffi::Buffer<ffi::F32>> y) {
  return product<Bfloat16>(pool, weight, nullptr, x, y);
}

ffi::Error int8(ffi::ThreadPool pool, ffi::Buffer<ffi::S8> weight, ffi::Buffer<ffi::F32> scale,
                ffi::Buffer<ffi::F32> x, ffi::Result<ffi::Buffer<ffi::F32>> y) {
  return product<Int8>(pool, weight, scale.typed_data(), x, y);
}

}  // namespace

XLA_FFI_DEFINE_HANDLER_SYMBOL(zeggs_bfloat16, bfloat16,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .Arg<ffi::Buffer<ffi::BF16>>()
                                  .Arg<ffi::Buffer<ffi::F32>>()
                                  .Ret<ffi::Buffer<ffi::F32>>());

XLA_FFI_DEFINE_HANDLER_SYMBOL(zeggs_int8, int8,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .Arg<ffi::Buffer<ffi::S8>>()
                                  .Arg<ffi::Buffer<ffi::F32>>()
                                  .Arg<ffi::Buffer<ffi::F32>>()
                                  .Ret<ffi::Buffer<ffi::F32>>());
