"use strict";
// Lengths, heights and areas in one view with its disparity: what measure/ends.py and measure/quantities.py do, line
// for line, so that a page and `uw_recon measure` give one answer. Names are the same; explanations stand there.
globalThis.uwMeasure = (() => {
  const SPOT_PX = [4, 2], BAND_PX = 2, INWARDS_PX = 6, LEAST = 8, STRAIGHT = 0.7, BY_NOISE = 1.25, TOLERANCE = 3, LEAST_TOLERANCE_PX = 0.3;
  const BORNE_PX = 8, EDGE_PX = 3, ANOTHER_PX = 2, MOST_TOLERANCE_PX = 1, AVERAGED = 0.8;
  const CORRELATED_PX = 8, DRAWS = 200, PLACE_PX = 6, PLANE_DRAWS = 300, PLANE_MOST = 4000;
  const CELLS_MOST = 60, CELLS_LEAST = 8, TILTED_BY_NOISE = 0.1, REPEATS = 24, WHOLE = 2 ** 32;

  // measure/draws.py
  function mixed(k) {
    let x = Math.imul(k, 0x9E3779B9);
    x = Math.imul(x ^ (x >>> 16), 0x21F0AAAD);
    x = Math.imul(x ^ (x >>> 15), 0x735A2D97);
    return (x ^ (x >>> 15)) >>> 0;
  }
  const below = (limit, k) => Math.floor(mixed(k) / WHOLE * limit);
  const normal = k => Math.sqrt(-2 * Math.log((mixed(2 * k) + 0.5) / WHOLE)) * Math.cos(2 * Math.PI * mixed(2 * k + 1) / WHOLE);

  const rint = x => { const r = Math.round(x); return r - x === 0.5 && r % 2 ? r - 1 : r; }; // halves to even
  const sum = values => values.reduce((a, b) => a + b, 0);
  const mean = values => sum(values) / values.length;
  const norm = vector => Math.sqrt(sum(vector.map(x => x * x)));
  const minus = (a, b) => a.map((x, k) => x - b[k]);
  const dot = (a, b) => sum(a.map((x, k) => x * b[k]));
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const pairwise = values => values.slice(1).map((value, k) => [values[k], value]);
  function median(values) {
    const sorted = Float64Array.from(values).sort(), n = sorted.length;
    return n % 2 ? sorted[(n - 1) / 2] : (sorted[n / 2 - 1] + sorted[n / 2]) / 2;
  }
  // Two numbers of equal size are as much as 0.
  function solve3(rows, values) {
    const whole = dot(rows[0], cross(rows[1], rows[2]));
    const columns = [0, 1, 2].map(k => rows.map(row => row[k]));
    return { determinant: whole, found: columns.map((_, k) => {
      const [a, b, c] = columns.map((column, j) => (j === k ? values : column));
      return dot(a, cross(b, c)) / whole;
    }) };
  }
  // Least squares of d = a x + b y + c.
  function planeThrough(x, y, d) {
    const [mx, my, md] = [mean(x), mean(y), mean(d)];
    let [xx, xy, yy, xd, yd] = [0, 0, 0, 0, 0];
    for (let i = 0; i < d.length; i++) {
      const [dx, dy, dd] = [x[i] - mx, y[i] - my, d[i] - md];
      xx += dx * dx; xy += dx * dy; yy += dy * dy; xd += dx * dd; yd += dy * dd;
    }
    const det = xx * yy - xy * xy, a = (xd * yy - yd * xy) / det, b = (yd * xx - xd * xy) / det;
    return [a, b, md - a * mx - b * my];
  }
  const failed = text => { throw new RangeError(text); };

  // From the page's JSON to numbers; disparities are kept in 16 bits over their range.
  async function opened(data) {
    const read = async ({ low, step, values }) => {
      const packed = Uint8Array.from(atob(values), c => c.charCodeAt(0));
      const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
      const view = new DataView(await new Response(stream).arrayBuffer()), n = view.byteLength / 2;
      const found = new Float32Array(n);
      for (let i = 0; i < n; i++) {
        const q = view.getUint16(2 * i, true);
        found[i] = q === 65535 ? NaN : low + step * q;
      }
      return found;
    };
    return { ...data, disparity: await read(data.disparity), sigma: await read(data.sigma) };
  }

  function pointOf(frame, u, v, disparity) {
    const depth = frame.focalTimesBaseline / (disparity + frame.offset);
    return [depth * (u - frame.cx) / frame.fx, depth * (v - frame.cy) / frame.fy, depth];
  }

  // Relative sigma of depth by the calibration: between rows of its table by the logarithm of range.
  function byCalibration(frame, depth) {
    const table = frame.calibration;
    if (!table) return NaN;
    const x = Math.log(Math.max(depth, 1e-6)), k = table.findIndex(([range]) => Math.log(range) >= x);
    if (k <= 0) return table[k === 0 ? 0 : table.length - 1][1];
    const [[r0, e0], [r1, e1]] = [table[k - 1], table[k]];
    return e0 + (e1 - e0) * (x - Math.log(r0)) / (Math.log(r1) - Math.log(r0));
  }

  // ---- measure/ends.py ----

  const at = (line, t) => [line.offset + line.slope * t, line.sigma * Math.sqrt((1 + ((t - line.middle) / Math.max(line.spread, 1e-9)) ** 2) / line.count)];
  const straight = (line, length) => line.byNoise && line.agreed >= STRAIGHT && line.reach[0] < 0.2 * length && line.reach[1] > 0.8 * length;
  const endOf = ([u, v], line, t) => {
    const [disparity, sigma] = at(line, t);
    return { u, v, disparity, sigma, agreed: line.agreed };
  };

  function segmentEnds(frame, first, second) {
    const length = norm(minus(second, first));
    if (length < 2) failed("segment: expected points 2 px apart or more, got one twice");
    const read = readAlong(frame, first, second, length), whole = fitted(read);
    return [[first, 0], [second, length]].map(([point, t]) => {
      const line = whole && straight(whole, length) ? along(frame, point, whole, t, read) : null;
      const end = seenThere(frame, point, SPOT_PX[0]) || line || seenThere(frame, point, SPOT_PX[1]) || inwards(point, t, length, read);
      return { ...end, beside: beside(frame, end) };
    });
  }

  function along(frame, point, line, t, read) {
    const limit = limitOf(read), found = endOf(point, line, t);
    const agree = read.filter(row => Math.abs(row[0] - t) <= BORNE_PX && Math.abs(row[1] - line.offset - line.slope * row[0]) <= limit);
    const there = frame.disparity[rint(point[1]) * frame.width + rint(point[0])];
    const behind = (there - found.disparity) * Math.sign(frame.focalTimesBaseline);
    return agree.length < LEAST || behind > MOST_TOLERANCE_PX ? null : found;
  }

  const limitOf = read => Math.max(TOLERANCE * median(read.map(row => row[2])), LEAST_TOLERANCE_PX);

  function beside(frame, end) {
    const d = spot(frame, rint(end.u), rint(end.v), EDGE_PX).rows.map(row => row[2]);
    const others = d.filter(value => Math.abs(value - end.disparity) > ANOTHER_PX);
    return others.length > 1 ? median(others) : NaN;
  }

  function inwards(point, t, length, read) {
    const near = read.filter(row => Math.abs(row[0] - t) <= Math.min(INWARDS_PX, Math.max(length / 3, 6)));
    const line = fitted(near);
    if (!line) {
      failed(`no depth at (${rint(point[0])}, ${rint(point[1])}): expected at least ${LEAST} disparities towards the other end, got ${near.length}: click where the picture has depth`);
    }
    return endOf(point, line, t);
  }

  // [u, v, disparity, sigma] of the pixels within a square that the picture has, and how many those are.
  function spot(frame, u, v, reach) {
    const rows = [];
    let size = 0;
    for (let y = Math.max(v - reach, 0); y <= Math.min(v + reach, frame.height - 1); y++) {
      for (let x = Math.max(u - reach, 0); x <= Math.min(u + reach, frame.width - 1); x++, size++) {
        const i = y * frame.width + x;
        if (Number.isFinite(frame.disparity[i])) rows.push([x, y, frame.disparity[i], frame.sigma[i]]);
      }
    }
    return { rows, size };
  }

  const finite = values => values.filter(Number.isFinite);

  function seenThere(frame, point, reach) {
    const { rows, size } = spot(frame, rint(point[0]), rint(point[1]), reach);
    if (rows.length < 0.6 * size || size < LEAST) return null;
    const x = rows.map(row => row[0] - point[0]), y = rows.map(row => row[1] - point[1]), d = rows.map(row => row[2]);
    const [a, b, c] = planeThrough(x, y, d), known = finite(rows.map(row => row[3]));
    const scatter = Math.max(...d.map((value, i) => Math.abs(value - a * x[i] - b * y[i] - c)));
    const noise = known.length ? median(known) : 1;
    if (!(scatter <= Math.min(Math.max(TOLERANCE * noise, LEAST_TOLERANCE_PX), MOST_TOLERANCE_PX))) return null;
    return { u: point[0], v: point[1], disparity: c, sigma: AVERAGED * noise, agreed: rows.length / size };
  }

  // [t, disparity, sigma] of all pixels in a band about the segment.
  function readAlong(frame, first, second, length) {
    const along = minus(second, first).map(x => x / length), found = [];
    for (let aside = -BAND_PX; aside <= BAND_PX; aside++) {
      for (let t = 0; t < length + 0.5; t++) {
        const u = rint(first[0] + t * along[0] - aside * along[1]), v = rint(first[1] + t * along[1] + aside * along[0]);
        if (u < 0 || v < 0 || u >= frame.width || v >= frame.height) continue;
        const i = v * frame.width + u, sigma = frame.sigma[i];
        if (Number.isFinite(frame.disparity[i])) found.push([t, frame.disparity[i], Number.isFinite(sigma) ? sigma : 1]);
      }
    }
    return found;
  }

  function fitted(read) {
    if (read.length < LEAST) return null;
    const limit = limitOf(read);
    const [start, rise] = mostAgreed(read, limit);
    const agree = read.filter(row => Math.abs(row[1] - start - rise * row[0]) <= limit);
    if (agree.length < LEAST) return null;
    const t = agree.map(row => row[0]), d = agree.map(row => row[1]), least = Math.min(...t), most = Math.max(...t);
    const [slope, offset] = lineThrough(t, d, most - least);
    const scatter = Math.sqrt(mean(d.map((value, i) => (value - offset - slope * t[i]) ** 2)));
    const middle = mean(t), length = Math.max(most - least, 1), noise = median(agree.map(row => row[2]));
    return {
      offset, slope, sigma: Math.max(scatter, noise), middle, byNoise: scatter <= BY_NOISE * noise,
      spread: Math.sqrt(mean(t.map(x => (x - middle) ** 2))), count: Math.max(length / CORRELATED_PX, 1),
      agreed: agree.length / read.length, reach: [least, most],
    };
  }

  function lineThrough(t, d, range) {
    if (range < 1) return [0, mean(d)];
    const [mt, md] = [mean(t), mean(d)], aside = t.map(x => x - mt);
    const slope = dot(aside, d.map(x => x - md)) / dot(aside, aside);
    return [slope, md - slope * mt];
  }

  function mostAgreed(read, limit) {
    let [best, most] = [null, -1];
    for (let k = 0; k < DRAWS; k++) {
      const [t1, d1] = read[below(read.length, k)], [t2, d2] = read[below(read.length, DRAWS + k)];
      const slope = Math.abs(t2 - t1) < 1 ? 0 : (d2 - d1) / (t2 - t1), offset = d1 - slope * t1;
      let count = 0;
      for (const [t, d] of read) count += Math.abs(d - offset - slope * t) <= limit;
      if (count > most) [best, most] = [[offset, slope], count];
    }
    return best;
  }

  // ---- measure/quantities.py ----

  function measurePolyline(frame, points, clickPx) {
    const segments = pairwise(points).map(([one, other]) => segmentEnds(frame, one, other));
    const inner = pairwise(segments).map(([before, after]) => joined(before[1], after[0]));
    const ends = [segments[0][0], ...inner, segments[segments.length - 1][1]];
    const length = values => sum(pairwise(values.map(row => pointOf(frame, ...row))).map(([a, b]) => norm(minus(b, a))));
    const made = propagated(ends.length === 2 ? "length" : "polyline", length, ends, frame, clickPx);
    return { ...made, other: withAnother(length, ends, made.value) };
  }

  function withAnother(length, ends, found) {
    const inputs = ends.map(end => [end.u, end.v, end.disparity]);
    const others = ends.flatMap((end, k) => (Number.isFinite(end.beside) ? [length(inputs.map((row, j) => (j === k ? [row[0], row[1], end.beside] : row)))] : []));
    return others.reduce((most, other) => (Number.isNaN(most) || Math.abs(other - found) > Math.abs(most - found) ? other : most), NaN);
  }

  function joined(one, other) {
    const [w1, w2] = [1 / one.sigma ** 2, 1 / other.sigma ** 2], apart = Math.abs(one.disparity - other.disparity) / 2;
    const disparity = (w1 * one.disparity + w2 * other.disparity) / (w1 + w2);
    return { ...one, disparity, sigma: Math.max(1 / Math.sqrt(w1 + w2), apart), agreed: Math.min(one.agreed, other.agreed) };
  }

  const together = (...parts) => Math.sqrt(sum(parts.map(part => (Number.isNaN(part) ? 0 : part * part))));

  function propagated(quantity, value, ends, frame, clickPx) {
    const inputs = ends.map(end => [end.u, end.v, end.disparity]), parts = [0, 0];
    ends.forEach((end, i) => [clickPx, clickPx, end.sigma].forEach((sigma, k) => {
      const moved = by => inputs.map((row, j) => (j === i ? row.map((x, n) => (n === k ? x + by : x)) : row));
      parts[k === 2 ? 1 : 0] += ((value(moved(1e-3)) - value(moved(-1e-3))) / 2e-3 * sigma) ** 2;
    }));
    const found = value(inputs), depth = mean(inputs.map(row => pointOf(frame, ...row)[2]));
    const [click, disparity, calibration] = [Math.sqrt(parts[0]), Math.sqrt(parts[1]), Math.abs(found) * byCalibration(frame, depth)];
    return {
      quantity, value: found, sigma: together(disparity, click, calibration), unit: frame.unit,
      sigma_disparity: disparity, sigma_click: click, sigma_calibration: calibration, depth,
      agreed: Math.min(...ends.map(end => end.agreed)), cell: NaN, other: NaN, pixels: ends.map(end => [end.u, end.v]),
    };
  }

  function place(frame, point) {
    const [u, v] = point.map(rint), { rows } = spot(frame, u, v, PLACE_PX);
    if (rows.length < 8) failed(`no depth at (${u}, ${v}): click where the picture has depth`);
    const d = rows.map(row => row[2]), middle = median(d);
    const noise = Math.max(median(finite(rows.map(row => row[3]))), 0.05);
    const agree = d.filter(value => Math.abs(value - middle) <= Math.max(3 * noise, 0.5));
    return { u: point[0], v: point[1], disparity: mean(agree), sigma: noise, agreed: agree.length / d.length };
  }

  function crossesItself(corners) {
    const turn = (a, b, c) => (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    const apart = ([a, b], [c, d]) => turn(a, b, c) * turn(a, b, d) < 0;
    const sides = pairwise([...corners, corners[0]]);
    return sides.some((one, i) => sides.slice(0, i).some(other => apart(one, other) && apart(other, one)));
  }

  function flatOutline(corners) {
    const twice = pairwise([...corners, corners[0]]).reduce((sum, [[u0, v0], [u1, v1]]) => sum + u0 * v1 - u1 * v0, 0);
    const across = corners.map(([u, v]) => Math.hypot(u - corners[0][0], v - corners[0][1]));
    return Math.abs(twice) < 2 * Math.max(...across);
  }

  function inside(frame, corners) {
    if (crossesItself(corners)) failed("outline: expected corners in order, got an outline that crosses itself");
    if (flatOutline(corners)) failed("outline: expected three corners or more that are not in one line");
    const mask = new Uint8Array(frame.width * frame.height);
    for (const [[u0, v0], [u1, v1]] of pairwise([...corners, corners[0]])) {
      if (v0 === v1) continue;
      for (let v = Math.max(Math.ceil(Math.min(v0, v1)), 0); v < frame.height && v <= Math.max(v0, v1); v++) {
        if ((v0 <= v) === (v1 <= v)) continue;
        const crossed = u0 + (v - v0) * (u1 - u0) / (v1 - v0);
        for (let u = Math.max(Math.floor(crossed) + 1, 0); u < frame.width; u++) mask[v * frame.width + u] ^= 1;
      }
    }
    return mask;
  }

  function fitPlane(frame, corners) {
    const mask = corners && inside(frame, corners), known = [];
    frame.disparity.forEach((d, i) => { if (Number.isFinite(d) && (!mask || mask[i])) known.push(i); });
    if (known.length < 50) failed(`plane: expected at least 50 disparities, got ${known.length}`);
    const n = Math.min(known.length, PLANE_MOST);
    const chosen = known.length > PLANE_MOST ? Array.from({ length: n }, (_, k) => known[below(known.length, k)]) : known;
    const u = chosen.map(i => i % frame.width), v = chosen.map(i => Math.floor(i / frame.width)), d = chosen.map(i => frame.disparity[i]);
    const limit = Math.max(3 * median(finite(known.map(i => frame.sigma[i]))), 0.5);
    let agreed = [];
    for (let k = 0; k < PLANE_DRAWS; k++) {
      const triple = [0, 1, 2].map(j => below(n, PLANE_MOST + 3 * k + j));
      const { determinant, found: [a, b, c] } = solve3(triple.map(i => [u[i], v[i], 1]), triple.map(i => d[i]));
      if (Math.abs(determinant) <= 1) continue;
      const agree = [];
      for (let i = 0; i < n; i++) if (Math.abs(a * u[i] + b * v[i] + c - d[i]) <= limit) agree.push(i);
      if (agree.length > agreed.length) agreed = agree;
    }
    const share = agreed.length / n;
    if (share < 0.5) failed(`plane: expected at least half of the view to lie in one, got ${Math.round(100 * share)}%`);
    return { plane: planeThrough(...[u, v, d].map(values => agreed.map(i => values[i]))), share };
  }

  function planeInSpace(frame, [a, b, c]) {
    const third = c + frame.offset, turned = [a * frame.fx, b * frame.fy, a * frame.cx + b * frame.cy + third];
    const length = norm(turned) * (turned[2] > 0 ? -1 : 1);
    return { normal: turned.map(x => x / length), distance: frame.focalTimesBaseline / length };
  }

  function measureToPlane(frame, point, fit, quantity, clickPx) {
    const { normal: up, distance } = planeInSpace(frame, fit.plane), end = place(frame, point);
    const made = propagated(quantity, ([row]) => dot(up, pointOf(frame, ...row)) - distance, [end], frame, clickPx);
    return { ...made, agreed: Math.min(made.agreed, fit.share) };
  }

  function measurePatch(frame, corners, clickPx) {
    const mask = inside(frame, corners), all = [], known = [];
    mask.forEach((set, i) => { if (set) { all.push(i); if (Number.isFinite(frame.disparity[i])) known.push(i); } });
    if (known.length < 200 || known.length < 0.5 * all.length) {
      failed(`patch: expected depth on half of it, got ${known.length} of ${all.length} pixels`);
    }
    const { u, v, d, noise, columns, step } = cells(frame, mask, all, known), [area, flat] = areas(frame, u, v, d, columns);
    const again = Array.from({ length: REPEATS }, (_, k) => areas(frame, u, v, d.map((x, i) => x + noise[i] * normal(k * d.length + i)), columns));
    const spread = [0, 1].map(k => { const all = again.map(row => row[k]), m = mean(all); return Math.sqrt(mean(all.map(x => (x - m) ** 2))); });
    const added = [mean(again.map(row => row[0])) - area, mean(again.map(row => row[1])) - flat];
    const whole = all.length / Math.max(d.filter(Number.isFinite).length * step ** 2, 1);
    const depth = frame.focalTimesBaseline / (median(known.map(i => frame.disparity[i])) + frame.offset);
    const outline = sum(pairwise([...corners, corners[0]]).map(([a, b]) => norm(minus(b, a))));
    const edge = Math.sqrt(outline * step) / all.length * clickPx, [surface, shadow] = [area - added[0], flat - added[1]];
    const value = surface * whole, disparity = spread[0] * whole, click = value * edge;
    const calibration = 2 * value * byCalibration(frame, depth);
    const rough = Math.hypot(spread[0] / shadow, spread[1] * surface / shadow ** 2);
    const shared = { depth, agreed: 1, cell: step * depth / frame.focal, other: NaN, pixels: corners };
    return [
      { quantity: "area", value, sigma: together(disparity, click, calibration), unit: `${frame.unit}2`, sigma_disparity: disparity, sigma_click: click, sigma_calibration: calibration, ...shared },
      { quantity: "rugosity", value: Math.max(surface / shadow, 1), sigma: rough, unit: "", sigma_disparity: rough, sigma_click: NaN, sigma_calibration: NaN, ...shared },
    ];
  }

  function cells(frame, mask, all, known) {
    let [top, bottom, left, right] = [Infinity, 0, Infinity, 0];
    for (const i of all) {
      const y = Math.floor(i / frame.width), x = i % frame.width;
      [top, bottom, left, right] = [Math.min(top, y), Math.max(bottom, y), Math.min(left, x), Math.max(right, x)];
    }
    const step = cellPx(frame, known, Math.max(bottom - top, right - left));
    const rows = Math.min(Math.floor((bottom - top) / step) + 1, Math.floor((frame.height - top) / step));
    const columns = Math.min(Math.floor((right - left) / step) + 1, Math.floor((frame.width - left) / step));
    const made = { u: [], v: [], d: [], noise: [], columns, step };
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) {
        let [count, total, noise] = [0, 0, 0];
        for (let y = top + row * step; y < top + (row + 1) * step; y++) {
          for (let x = left + column * step; x < left + (column + 1) * step; x++) {
            const i = y * frame.width + x;
            if (!mask[i] || !Number.isFinite(frame.disparity[i])) continue;
            count++; total += frame.disparity[i];
            if (Number.isFinite(frame.sigma[i])) noise += frame.sigma[i];
          }
        }
        made.u.push(left + step * column + (step - 1) / 2);
        made.v.push(top + step * row + (step - 1) / 2);
        made.d.push(count >= step * step / 2 ? total / count : NaN);
        made.noise.push(count ? noise / count * Math.min(1, CORRELATED_PX / step) : 0);
      }
    }
    return made;
  }

  function cellPx(frame, known, longest) {
    const noise = median(finite(known.map(i => frame.sigma[i])));
    const baselinePx = Math.abs(median(known.map(i => frame.disparity[i])) + frame.offset);
    const least = Math.max(4, Math.ceil(longest / CELLS_MOST)), most = Math.max(Math.floor(longest / CELLS_LEAST), 4);
    for (let step = least; step < most; step++) {
      if (noise * Math.min(1, CORRELATED_PX / step) * frame.focal / (baselinePx * step) <= TILTED_BY_NOISE) return step;
    }
    return Math.max(most, least);
  }

  function areas(frame, u, v, d, columns) {
    const points = d.map((value, i) => pointOf(frame, u[i], v[i], value)), shown = points.filter(p => p.every(Number.isFinite));
    const double = [];
    for (let i = 0; i + columns < points.length; i++) {
      if (i % columns === columns - 1) continue;
      const [a, b, c, e] = [points[i], points[i + 1], points[i + columns], points[i + columns + 1]];
      double.push(cross(minus(b, a), minus(c, a)), cross(minus(c, e), minus(b, e)));
    }
    const known = double.filter(p => p.every(Number.isFinite));
    if (!known.length) return [NaN, NaN];
    const up = flattest(shown), scale = 2 * d.filter(Number.isFinite).length / known.length;
    return [sum(known.map(norm)) / 2 * scale, sum(known.map(p => Math.abs(dot(p, up)))) / 2 * scale];
  }

  // The direction in which points spread least: that of the smallest eigenvalue, by Jacobi's turns.
  function flattest(points) {
    const middle = [0, 1, 2].map(k => mean(points.map(p => p[k]))), aside = points.map(p => minus(p, middle));
    const a = [0, 1, 2].map(i => [0, 1, 2].map(j => sum(aside.map(p => p[i] * p[j])))), turned = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    for (let k = 0; k < 30; k++) {
      const [p, q] = [[0, 1], [0, 2], [1, 2]][k % 3];
      if (a[p][q] === 0) continue;
      const theta = (a[q][q] - a[p][p]) / (2 * a[p][q]), t = (theta < 0 ? -1 : 1) / (Math.abs(theta) + Math.hypot(theta, 1));
      const c = 1 / Math.hypot(t, 1), s = t * c;
      for (let i = 0; i < 3; i++) [a[i][p], a[i][q]] = [c * a[i][p] - s * a[i][q], s * a[i][p] + c * a[i][q]];
      for (let i = 0; i < 3; i++) [a[p][i], a[q][i]] = [c * a[p][i] - s * a[q][i], s * a[p][i] + c * a[q][i]];
      for (let i = 0; i < 3; i++) [turned[i][p], turned[i][q]] = [c * turned[i][p] - s * turned[i][q], s * turned[i][p] + c * turned[i][q]];
    }
    const k = [0, 1, 2].reduce((least, i) => (a[i][i] < a[least][least] ? i : least), 0);
    return turned.map(row => row[k]);
  }

  // What `uw_recon measure FRAME QUANTITY POINTS` answers; throws RangeError with the reason where there is no answer.
  function measure(frame, quantity, points, { plane = null, clickPx = 1 } = {}) {
    const fit = quantity === "height" && fitPlane(frame, plane);
    const made = {
      length: () => [measurePolyline(frame, points, clickPx)],
      height: () => points.map(point => measureToPlane(frame, point, fit, plane ? "to_plane" : "height", clickPx)),
      area: () => measurePatch(frame, points, clickPx),
    };
    return made[quantity]();
  }

  // A row as the command writes it: what is not known is null.
  function rowOf(frame, result) {
    const { pixels, ...numbers } = result, told = x => (typeof x === "number" && !Number.isFinite(x) ? null : x);
    return {
      frame: frame.name, stamp_ns: frame.stamp, ...Object.fromEntries(Object.entries(numbers).map(([name, x]) => [name, told(x)])),
      pixels, reliable: frame.reliable,
    };
  }

  return { opened, measure, rowOf, flattest };
})();
