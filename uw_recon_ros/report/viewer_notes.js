"use strict";
// What is written over the 3-D view: scale, axes, measured lengths.
globalThis.uwNotes = (() => {
  const { subtract, dot } = globalThis.uwMesh;
  const AXES = [["x", "#d9463e"], ["y", "#3a9d4a"], ["z", "#3b78d8"]];

  const number = value => value.toLocaleString("en", { maximumSignificantDigits: 3, useGrouping: false });

  // A length 1, 2 or 5 times a power of ten, not over `most`.
  function roundLength(most) {
    const power = 10 ** Math.floor(Math.log10(most));
    return power * [5, 2, 1].find(step => step * power <= most);
  }

  class Notes {
    constructor(canvas, unit, turn) {
      Object.assign(this, { canvas, unit, turn, pen: canvas.getContext("2d") });
    }

    draw(camera, lines, ratio, tracks) {
      const style = getComputedStyle(this.canvas), color = name => style.getPropertyValue(name).trim();
      Object.assign(this, { ink: color("--ink"), paper: color("--view") });
      this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      this.pen.clearRect(0, 0, camera.width, camera.height);
      this.pen.lineCap = this.pen.lineJoin = "round";
      for (const track of tracks) this.track(camera, track);
      this.scale(camera);
      this.axes(camera.axes());
      for (const line of lines) this.line(camera, line);
    }

    stroke(places, color, width) {
      Object.assign(this.pen, { strokeStyle: color, lineWidth: width });
      this.pen.beginPath();
      places.forEach(([x, y], i) => (i ? this.pen.lineTo(x, y) : this.pen.moveTo(x, y)));
      this.pen.stroke();
    }

    write(text, x, y, align, ink, paper, font = "12px system-ui, sans-serif") {
      Object.assign(this.pen, { font, textAlign: align, lineWidth: 4, strokeStyle: paper, fillStyle: ink });
      this.pen.strokeText(text, x, y);
      this.pen.fillText(text, x, y);
    }

    scale(camera) {
      const length = roundLength(camera.perPixel * Math.min(170, camera.width / 3)), pixels = length / camera.perPixel;
      const right = camera.width - 18, y = camera.height - 18, left = right - pixels;
      for (const [color, width] of [[this.paper, 5], [this.ink, 2]]) {
        this.stroke([[left, y - 5], [left, y], [right, y], [right, y - 5]], color, width);
      }
      const unit = this.unit === "m" ? "m" : `${length === 1 ? "baseline" : this.unit} (scale unknown)`;
      this.write(`${number(length)} ${unit}`, right, y - 11, "right", this.ink, this.paper);
    }

    // Where the camera was; over everything, so that nothing hides it.
    track(camera, { points, color }) {
      const places = points.filter(point => camera.sees(point)).map(point => camera.project(point));
      this.stroke(places, this.paper, 4);
      this.stroke(places, color, 2);
      this.pen.fillStyle = color;
      for (const [x, y] of places.length < 500 ? places : []) { this.pen.beginPath(); this.pen.arc(x, y, 2.6, 0, 7); this.pen.fill(); }
    }

    // Of the surface's own frame, turned as it is.
    axes({ right, up }) {
      for (const [k, [name, color]] of AXES.entries()) {
        const arm = [0, 0, 0];
        arm[k] = this.turn[k];
        const dx = 26 * dot(arm, right), dy = -26 * dot(arm, up);
        this.stroke([[46, 50], [46 + dx, 50 + dy]], color, 2.5);
        this.write(name, 46 + 1.4 * dx, 54 + 1.4 * dy, "center", color, this.paper);
      }
    }

    // The ends of a length, and the length.
    lines(points) {
      const length = points.length === 2 ? `${number(Math.hypot(...subtract(points[0], points[1])))} ${this.unit}` : "";
      return [{ points, color: "#ff8c1a", closed: false, label: length }];
    }

    // What is measured.
    line(camera, { points, color, closed, label }) {
      const places = points.filter(point => camera.sees(point)).map(point => camera.project(point));
      if (places.length > 1) this.stroke(closed && places.length > 2 ? [...places, places[0]] : places, color, 2);
      this.pen.fillStyle = color;
      for (const [x, y] of places) { this.pen.beginPath(); this.pen.arc(x, y, 4.5, 0, 7); this.pen.fill(); }
      if (!label || !places.length) return;
      const [x, y] = [0, 1].map(k => places.reduce((total, place) => total + place[k], 0) / places.length);
      this.write(label, x, y - 10, "center", "#fff", "#7a3d00", "600 14px system-ui, sans-serif");
    }
  }

  return Notes;
})();
