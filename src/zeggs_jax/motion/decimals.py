"""Many decimal numbers of a text read at once, eight characters as one integer: what BVH files are full of.

Only numbers as "%f" writes them, all with equally many decimals; the last bit is that of `float`.
"""

import numpy as np
from jaxtyping import Float, UInt8, UInt64

PIECE = 1 << 19  # bytes at a time: all that is made of them stays in the CPU's cache
WORD = 8  # bytes of an integer: no number has more digits before its point, or behind it
DIGITS = 15  # of a number at most: as integers they are exact in float64
LEAST = 1 << 12  # bytes; shorter texts are not worth it
SPACE, DOT, MINUS = 32, 46, 45


def read(text: bytes | memoryview) -> Float[np.ndarray, " n"] | None:
    """The numbers of a text, divided by white space; None where one has another form: read them in another way."""
    decimals = _decimals(bytes(text[:256]))
    if len(text) < LEAST or not 1 <= decimals < WORD:
        return None
    padded = np.frombuffer(b" " * WORD + text + b" " * (WORD + 1), np.uint8)  # words fit around every point
    found = np.empty(len(text) // (decimals + 2) + 1)  # each has a point, its decimals and a space behind it
    count, start, end = 0, WORD, len(padded) - WORD
    while start < end:
        stop = _cut(padded, min(start + PIECE, end))
        values = None if stop <= start else _piece(padded[start - WORD : stop + WORD], decimals)
        if values is None:
            return None
        found[count : count + len(values)] = values
        count, start = count + len(values), stop
    return found[:count]


def _decimals(text: bytes) -> int:
    """Digits behind the point of the first number; -1 where there is none."""
    first = text.split(maxsplit=1)[:1]
    _, point, behind = first[0].partition(b".") if first else (b"", b"", b"")
    return len(behind) if point else -1


def _cut(padded: UInt8[np.ndarray, " n"], stop: int) -> int:
    """The last place up to `stop` behind white space."""
    spaces = np.flatnonzero(padded[max(stop - 64, 0) : stop] <= SPACE)
    return max(stop - 64, 0) + int(spaces[-1]) + 1 if spaces.size else 0


def _piece(text: UInt8[np.ndarray, " n"], decimals: int) -> Float[np.ndarray, " k"] | None:
    """The numbers of some text; its first and last WORD bytes are not read."""
    dark = text > SPACE
    dark[:WORD] = dark[-WORD:] = False
    edges = np.flatnonzero(dark[1:] != dark[:-1])  # before a number, and its last character, in turns
    starts, dots = edges[::2] + 1, edges[1::2] - decimals
    minus = text[starts] == MINUS
    starts += minus
    whole = dots - starts
    if not whole.size:
        return np.zeros(0)
    if whole.min() < 0 or whole.max() > min(WORD, DIGITS - decimals):
        return None
    both = np.ndarray(
        (len(text) - 2 * WORD + 1,), "V16", text, strides=(1,)
    )  # from any character on; one gather for two
    before, behind = both[dots - WORD].view("<u8").reshape(-1, 2).T.copy()
    if (behind & np.uint64(0xFF) != DOT).any():
        return None
    behind >>= np.uint64(8)
    behind <<= np.uint64(8 * (WORD - decimals))
    whole = _number(before, np.uint64(8) * (WORD - whole).astype(np.uint64))
    part = _number(behind, np.uint64(8 * (WORD - decimals)))
    if whole is None or part is None:
        return None
    whole *= np.uint64(10**decimals)
    whole += part
    values = whole.view(np.int64) / 10.0**decimals
    values.view(np.uint64)[...] |= minus.astype(np.uint64) << np.uint64(63)
    return values


def _number(word: UInt64[np.ndarray, " n"], skipped: UInt64[np.ndarray, " n"] | np.uint64) -> np.ndarray | None:
    """The number of the digits in a word, whose first bits are `skipped`; None where one is no digit.

    The first digit stands in the lowest byte. Neighbours are joined: to pairs, to fours, to eight.
    """
    word ^= np.uint64(0x3030303030303030)
    word >>= skipped
    word <<= skipped
    beyond = word + np.uint64(0x7676767676767676)  # the upper bit of a byte that is more than 9
    beyond |= word
    if np.bitwise_or.reduce(beyond) & np.uint64(0x8080808080808080):
        return None
    for ten, bits, kept in ((10, 8, 0x00FF00FF00FF00FF), (100, 16, 0x0000FFFF0000FFFF), (10**4, 32, 0xFFFFFFFF)):
        above = word >> np.uint64(bits)
        word *= np.uint64(ten)
        word += above
        word &= np.uint64(kept)
    return word
