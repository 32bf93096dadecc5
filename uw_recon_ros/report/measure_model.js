"use strict";
// Lengths on the model of a dive: what measure/on_model.py does, so that a page and `uw_recon measure` give one answer.
globalThis.uwModel = (() => {
  const BESIDE = 3, ROW = 8;
  const minus = (a, b) => a.map((x, k) => x - b[k]);
  const dot = (a, b) => a.reduce((total, x, k) => total + x * b[k], 0);
  const norm = vector => Math.sqrt(dot(vector, vector));
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const numbers = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
  const middle = points => [0, 1, 2].map(k => points.reduce((total, p) => total + p[k], 0) / points.length);
  const failed = text => { throw new RangeError(text); };

  // What measure.json holds.
  const opened = told => ({ ...told, rows: numbers(told.spots), covariance: numbers(told.covariance) });

  function nearest(model, point) {
    const { rows, spacing } = model;
    let [best, least] = [0, Infinity];
    for (let i = 0; i < rows.length; i += ROW) {
      const square = (rows[i] - point[0]) ** 2 + (rows[i + 1] - point[1]) ** 2 + (rows[i + 2] - point[2]) ** 2;
      if (square < least) [best, least] = [i, square];
    }
    if (least > (BESIDE * spacing) ** 2) failed("expected a point on the model's surface, got none");
    return { sigma: rows[best + 3], camera: [...rows.slice(best + 4, best + 7)], anchor: rows[best + 7] };
  }

  // How a value changes as the poses err that a point hangs on.
  function pull(model, sums, point, slope, anchor) {
    const first = Math.min(Math.floor(anchor), model.centres.length - 1);
    for (const [k, share] of [[first, 1 - (anchor - first)], [first + 1, anchor - first]]) {
      if (!(share > 0)) continue;
      [...slope, ...cross(minus(point, model.centres[k]), slope)].forEach((x, n) => { sums[6 * k + n] += share * x; });
    }
  }

  function byTrajectory(model, points, slopes, spots) {
    const side = 6 * model.centres.length, sums = new Float64Array(side);
    if (!side) return NaN;
    points.forEach((point, k) => pull(model, sums, point, slopes[k], spots[k].anchor));
    let total = 0;
    for (let i = 0; i < side; i++) if (sums[i]) for (let j = 0; j < side; j++) total += sums[i] * model.covariance[side * i + j] * sums[j];
    return Math.sqrt(Math.max(total, 0));
  }

  function byCalibration(model, distance) {
    const table = model.calibration;
    if (!table.length) return NaN;
    const at = Math.log(Math.max(distance, 1e-6)), k = table.findIndex(([range]) => Math.log(range) >= at);
    if (k <= 0) return table[k < 0 ? table.length - 1 : 0][1];
    const [[r0, f0], [r1, f1]] = [table[k - 1], table[k]];
    return f0 + (f1 - f0) * (at - Math.log(r0)) / (Math.log(r1) - Math.log(r0));
  }

  function propagated(model, quantity, value, points, clicks) {
    const step = 1e-4 * model.spacing, spots = points.map(point => nearest(model, point));
    const slopes = points.map((point, i) => point.map((_, k) => {
      const moved = by => points.map((p, j) => (j === i ? p.map((x, n) => (n === k ? x + by : x)) : p));
      return (value(moved(step)) - value(moved(-step))) / (2 * step);
    }));
    const views = points.map((point, i) => minus(point, spots[i].camera)), distances = views.map(norm);
    const distance = distances.reduce((a, b) => a + b) / distances.length, found = value(points);
    const along = slopes.map((slope, i) => dot(slope, views[i]) / Math.max(distances[i], 1e-12) * spots[i].sigma);
    const parts = [
      norm(along), byTrajectory(model, points, slopes, spots), Math.abs(found) * byCalibration(model, distance),
      norm(slopes.map((slope, i) => norm(slope) * clicks[i])),
    ];
    const [sigma_surface, sigma_trajectory, sigma_calibration, sigma_click] = parts;
    const sigma = norm(parts.map(part => (Number.isNaN(part) ? 0 : part)));
    return { quantity, value: found, sigma, sigma_surface, sigma_trajectory, sigma_calibration, sigma_click, distance, points, clicks };
  }

  const way = points => points.slice(1).reduce((total, point, k) => total + norm(minus(point, points[k])), 0);

  function above([point, ...corners]) {
    const up = globalThis.uwMeasure.flattest(corners);
    return dot(minus(point, middle(corners)), up) * (up[2] >= 0 ? 1 : -1);
  }

  // Corners of a plane that hardly differ across their longest direction fix none.
  function expectPlane(corners) {
    const aside = corners.map(corner => minus(corner, middle(corners)));
    const longest = Math.sqrt(aside.reduce((total, a) => total + dot(a, a), 0));
    const wide = Math.sqrt(aside.reduce((total, a) => total + aside.reduce((sum, b) => sum + dot(cross(a, b), cross(a, b)), 0), 0) / 2);
    if (wide < 0.02 * longest ** 2) failed("plane: expected corners that span one, got corners in one line");
  }

  // Points and corners: world less the origin; `clicks`: of the points, then the corners.
  function measure(model, kind, points, plane, clicks) {
    if (kind === "length") return propagated(model, points.length === 2 ? "length" : "polyline", way, points, clicks);
    expectPlane(plane);
    return propagated(model, "to_plane", above, [...points, ...plane], clicks);
  }

  // A row as the command writes it: what is not known is null.
  function rowOf(model, { points, clicks, distance, ...numbers }) {
    const { quantity, value, sigma, ...parts } = numbers, told = x => (Number.isFinite(x) ? x : null);
    return {
      model: `segment ${model.segment}`, crs: model.crs, quantity, value: told(value), sigma: told(sigma), unit: model.unit,
      ...Object.fromEntries(Object.entries(parts).map(([name, x]) => [name, told(x)])), distance: told(distance), clicks,
      points: points.map(point => point.map((x, k) => x + model.origin[k])), reliable: model.reliable,
    };
  }

  return { opened, measure, rowOf };
})();
