"use strict";
// The mesh: from what embed.mesh_json writes to arrays, and the point of it that a ray meets first.
//
// Axes here: x right, y up, z towards the viewer. `turn` (signs) leads there from the surface's own frame: from an optical
// one (x right, y down, z forward) by 180 degrees about x, from a world with z up not at all. Coordinates shown to the user
// are those of the surface's own frame.
globalThis.uwMesh = (() => {
  const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const quantile = (values, share) => Float32Array.from(values).sort()[Math.floor(share * (values.length - 1))];

  function bytes(text) {
    return Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
  }

  function decode(data) {
    const whole = new Uint16Array(bytes(data.positions)), n = whole.length / 3;
    const positions = new Float32Array(whole.length), normals = new Float32Array(whole.length);
    const small = new Int8Array(bytes(data.normals)), flip = data.turn;
    for (let i = 0; i < whole.length; i++) {
      const k = i % 3;
      positions[i] = flip[k] * (data.low[k] + whole[i] / 65535 * data.extent[k]);
      normals[i] = flip[k] * small[i] / 127;
    }
    const index = data.indexBits === 16 ? new Uint16Array(bytes(data.index)) : new Uint32Array(bytes(data.index));
    const uv = Float32Array.from(new Uint16Array(bytes(data.uv)), value => value / 65535);
    return { positions, normals, uv, index: new Uint32Array(index), n };
  }

  // A track's points, and its colour for a canvas.
  function line(track, turn) {
    const flat = new Float32Array(bytes(track.points)), points = [];
    for (let i = 0; i < flat.length; i += 3) points.push([0, 1, 2].map(k => turn[k] * flat[i + k]));
    return { points, color: `rgb(${track.color})` };
  }

  function edges(index, n) {
    const seen = new Set(), lines = [];
    for (let i = 0; i < index.length; i += 3) {
      for (let k = 0; k < 3; k++) {
        const a = index[i + k], b = index[i + (k + 1) % 3], key = a < b ? a * n + b : b * n + a;
        if (!seen.has(key)) { seen.add(key); lines.push(a, b); }
      }
    }
    return new Uint32Array(lines);
  }

  // Distance along `ray` from `eye` to the surface, Infinity beside it (Moeller and Trumbore on every triangle).
  function meet(mesh, eye, ray) {
    const { positions: p, index } = mesh;
    let nearest = Infinity;
    for (let i = 0; i < index.length; i += 3) {
      const a = 3 * index[i], b = 3 * index[i + 1], c = 3 * index[i + 2];
      const e1x = p[b] - p[a], e1y = p[b + 1] - p[a + 1], e1z = p[b + 2] - p[a + 2];
      const e2x = p[c] - p[a], e2y = p[c + 1] - p[a + 1], e2z = p[c + 2] - p[a + 2];
      const hx = ray[1] * e2z - ray[2] * e2y, hy = ray[2] * e2x - ray[0] * e2z, hz = ray[0] * e2y - ray[1] * e2x;
      const det = e1x * hx + e1y * hy + e1z * hz;
      const sx = eye[0] - p[a], sy = eye[1] - p[a + 1], sz = eye[2] - p[a + 2];
      const u = (sx * hx + sy * hy + sz * hz) / det;
      if (!(u >= 0 && u <= 1)) continue;
      const qx = sy * e1z - sz * e1y, qy = sz * e1x - sx * e1z, qz = sx * e1y - sy * e1x;
      const v = (ray[0] * qx + ray[1] * qy + ray[2] * qz) / det;
      if (!(v >= 0 && u + v <= 1)) continue;
      const t = (e2x * qx + e2y * qy + e2z * qz) / det;
      if (t > 0 && t < nearest) nearest = t;
    }
    return nearest;
  }

  return { subtract, dot, cross, quantile, bytes, decode, line, edges, meet };
})();
