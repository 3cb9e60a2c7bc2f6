// ---------------------------------------------------------------- motion: unpacking, poses at any time, body shapes

/** Base64 of a deflated, byte-planed, differenced int16 array of `rows` rows -> Int16Array, row after row. */
async function unpack(text, rows) {
  const packed = Uint8Array.from(atob(text), c => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const size = bytes.length / 2, columns = size / rows, out = new Int16Array(size);
  for (let r = 0, k = 0; r < rows; r++)
    for (let c = 0, sum = 0; c < columns; c++, k++) out[k] = sum += bytes[k] | bytes[size + k] << 8;
  return out;
}

/** One figure: its motion, and the place and turn of every joint at the time last asked for. */
class Figure {
  constructor(data, turns, moves) {
    Object.assign(this, data);
    this.turns = turns;                                  // Int16 [J * 4, frames] local quaternions w x y z
    this.moves = moves;                                  // Int16 [moving * 3, frames]
    this.count = this.parents.length;
    this.duration = this.frames * this.frameTime;
    this.local = new Float32Array(this.offsets.flat());
    this.turn = new Float32Array(this.count * 4);        // local turns
    this.quat = new Float32Array(this.count * 4);        // world turns
    this.place = new Float32Array(this.count * 3);       // world places, metres
    this.mats = new Float32Array(this.count * 12);       // world matrices, three rows of four
    this.trackCentre();
  }

  /** Frame number (not whole) shown at a time; holds the last frame after the end. */
  frameAt(time) { return Math.min(Math.max(time / this.frameTime, 0), this.frames - 1); }

  /** Sets places and turns of all joints at a time, between two frames by normalised interpolation. */
  pose(time) {
    const { turns, moves, frames, local } = this;
    const at = this.frameAt(time), i = Math.floor(at), n = Math.min(i + 1, frames - 1), f = at - i;
    this.moving.forEach((joint, m) => {
      for (let a = 0; a < 3; a++) {
        const row = (m * 3 + a) * frames;
        local[joint * 3 + a] = this.moveMiddle[m][a] + this.moveStep * (moves[row + i] * (1 - f) + moves[row + n] * f);
      }
    });
    for (let j = 0; j < this.count; j++) {
      const row = j * 4 * frames;
      let near = 0;
      for (let a = 0; a < 4; a++) near += turns[row + a * frames + i] * turns[row + a * frames + n];
      const g = near < 0 ? -f : f;
      for (let a = 0; a < 4; a++) this.turn[j * 4 + a] = turns[row + a * frames + i] * (1 - f) + turns[row + a * frames + n] * g;
    }
    this.carry();
  }

  /** Places and turns of all joints in world from `local` places and `turn` quaternions of any length. */
  carry() {
    const { parents, quat, place, local, turn } = this;
    for (let j = 0; j < this.count; j++) {
      let [w, x, y, z] = turn.subarray(j * 4, j * 4 + 4);
      const s = 1 / (Math.hypot(w, x, y, z) || 1), p = parents[j];
      w *= s; x *= s; y *= s; z *= s;
      const lx = local[j * 3], ly = local[j * 3 + 1], lz = local[j * 3 + 2];
      if (p < 0) { quat.set([w, x, y, z], j * 4); place.set([lx, ly, lz], j * 3); continue; }
      const pw = quat[p * 4], px = quat[p * 4 + 1], py = quat[p * 4 + 2], pz = quat[p * 4 + 3];
      quat[j * 4] = pw * w - px * x - py * y - pz * z;
      quat[j * 4 + 1] = pw * x + px * w + py * z - pz * y;
      quat[j * 4 + 2] = pw * y - px * z + py * w + pz * x;
      quat[j * 4 + 3] = pw * z + px * y - py * x + pz * w;
      const tx = 2 * (py * lz - pz * ly), ty = 2 * (pz * lx - px * lz), tz = 2 * (px * ly - py * lx);
      place[j * 3] = place[p * 3] + lx + pw * tx + py * tz - pz * ty;
      place[j * 3 + 1] = place[p * 3 + 1] + ly + pw * ty + pz * tx - px * tz;
      place[j * 3 + 2] = place[p * 3 + 2] + lz + pw * tz + px * ty - py * tx;
    }
    this.fillMatrices();
  }

  fillMatrices() {
    const { quat, place, mats } = this;
    for (let j = 0; j < this.count; j++) {
      const w = quat[j * 4], x = quat[j * 4 + 1], y = quat[j * 4 + 2], z = quat[j * 4 + 3], o = j * 12;
      mats[o] = 1 - 2 * (y * y + z * z); mats[o + 1] = 2 * (x * y - w * z); mats[o + 2] = 2 * (x * z + w * y);
      mats[o + 4] = 2 * (x * y + w * z); mats[o + 5] = 1 - 2 * (x * x + z * z); mats[o + 6] = 2 * (y * z - w * x);
      mats[o + 8] = 2 * (x * z - w * y); mats[o + 9] = 2 * (y * z + w * x); mats[o + 10] = 1 - 2 * (x * x + y * y);
      mats[o + 3] = place[j * 3]; mats[o + 7] = place[j * 3 + 1]; mats[o + 11] = place[j * 3 + 2];
    }
  }

  /**
   * The camera's path: where the pelvis is on the ground, ten times a second, smoothed over about two seconds; and the
   * room that the body takes around it: `tall` above the floor and `wide` to each side, but for rare moments.
   */
  trackCentre() {
    const n = Math.max(2, Math.ceil(this.duration * 10) + 1), tops = [], poses = [];
    for (let k = 0; k < n; k++) { this.pose(k / 10); poses.push(this.place.slice()); }
    let path = poses.map(place => [place[this.centre * 3], place[this.centre * 3 + 2]]);
    for (let pass = 0; pass < 2; pass++) {
      path = path.map((_, k) => {
        let x = 0, z = 0;
        for (let d = -8; d <= 8; d++) { const p = path[Math.min(Math.max(k + d, 0), n - 1)]; x += p[0]; z += p[1]; }
        return [x / 17, z / 17];
      });
    }
    this.path = path;
    const sides = poses.map((place, k) => {
      let top = 0, side = 0;
      for (let j = 0; j < this.count; j++) {
        top = Math.max(top, place[j * 3 + 1] - this.floor);
        if (this.parents[j] >= 0) side = Math.max(side, Math.hypot(place[j * 3] - path[k][0], place[j * 3 + 2] - path[k][1]));
      }
      tops.push(top);
      return side;
    });
    const most = (list, share) => list.sort((a, b) => a - b)[Math.floor(share * (n - 1))];
    this.tall = Math.max(most(tops, 0.985) + 0.04 * this.stature, this.stature);
    this.wide = Math.max(most(sides, 0.93) + 0.03 * this.stature, 0.3 * this.stature);
  }

  /** World place [x, z] that the camera follows at a time. */
  follow(time) {
    const at = Math.min(Math.max(time * 10, 0), this.path.length - 1.001), i = Math.floor(at), f = at - i;
    const [a, b] = [this.path[i], this.path[i + 1]];
    return [a[0] + (b[0] - a[0]) * f, a[1] + (b[1] - a[1]) * f];
  }

  /** A point of a joint's frame in world. */
  toWorld(joint, p) {
    const m = this.mats, o = joint * 12;
    return [0, 4, 8].map(r => m[o + r] * p[0] + m[o + r + 1] * p[1] + m[o + r + 2] * p[2] + m[o + r + 3]);
  }
}

// Small vectors
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const add = (a, b, s = 1) => [a[0] + b[0] * s, a[1] + b[1] * s, a[2] + b[2] * s];
const unit = a => { const n = Math.hypot(...a) || 1; return [a[0] / n, a[1] / n, a[2] / n]; };

/** Reads one shape: its tone and the ellipses that its skin runs over. */
function readPart([tone, ...rows]) {
  const stations = rows.map(row => {
    const at = i => row.slice(i, i + 3), side = at(4), along = at(7);
    return { joint: row[0], centre: at(1), side, along, deep: cross(along, side), width: row[10], depth: row[11], cap: row[12], slope: row[13] };
  });
  return { tone, stations, thick: Math.max(...stations.map(s => s.width)) };
}

/** Skin of a shape as rings of {joint, point, normal}; `caps` rings round off each end, meeting the sides smoothly. */
function skin({ stations }, around, caps) {
  const ring = (s, radius, lift, tilt) => Array.from({ length: around }, (_, t) => {
    const u = Math.cos(2 * Math.PI * t / around), v = Math.sin(2 * Math.PI * t / around);
    const point = add(add(add(s.centre, s.side, s.width * radius * u), s.deep, s.depth * radius * v), s.along, lift);
    const out = unit(add(add([0, 0, 0], s.side, u / s.width), s.deep, v / s.depth)), c = Math.cos(tilt);
    return { joint: s.joint, point, normal: unit(add([out[0] * c, out[1] * c, out[2] * c], s.along, Math.sin(tilt))) };
  });
  const round = s => phi => ring(s, Math.cos(phi), s.cap * Math.sin(phi), Math.atan2(s.width * Math.sin(phi), s.cap * Math.cos(phi)));
  const meets = s => Math.atan(-s.slope * s.cap / s.width);     // where the rounded end has the slope of the side
  const [first, last] = [stations[0], stations[stations.length - 1]], steps = Array.from({ length: caps }, (_, k) => k / caps);
  return [
    ...steps.map(k => round(first)(-Math.PI / 2 + k * (meets(first) + Math.PI / 2))),
    round(first)(meets(first)),
    ...stations.slice(1, -1).map(s => ring(s, 1, 0, -Math.atan(s.slope))),
    round(last)(meets(last)),
    ...steps.map(k => round(last)(Math.PI / 2 - k * (Math.PI / 2 - meets(last)))).reverse(),
  ];
}
