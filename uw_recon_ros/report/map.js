"use strict";
// A map, north up: layers, coordinates under the pointer, a ruler. Nothing is loaded from elsewhere.
(() => {
  const RULER = "#ff8c1a";
  const round = value => value.toLocaleString("en", { maximumSignificantDigits: 3, useGrouping: false });

  // A length 1, 2 or 5 times a power of ten, not over `most`.
  function roundLength(most) {
    const power = 10 ** Math.floor(Math.log10(most));
    return power * [5, 2, 1].find(step => step * power <= most);
  }

  class ChartView {
    constructor(root, data) {
      Object.assign(this, { root, data, canvas: root.querySelector("canvas"), readout: root.querySelector(".readout") });
      Object.assign(this, { pen: this.canvas.getContext("2d"), marks: [], pointers: new Map(), mode: 0 });
      this.layers = data.layers.map(uri => {
        const picture = new Image();
        picture.onload = () => { root.dataset.ready = "yes"; this.draw(); };
        picture.src = uri;
        return picture;
      });
      this.listen();
      new ResizeObserver(() => { this.resize(); }).observe(root);
      this.resize();
    }

    resize() {
      this.ratio = Math.min(devicePixelRatio || 1, 2);
      [this.width, this.height] = [Math.max(this.canvas.clientWidth, 1), Math.max(this.canvas.clientHeight, 1)];
      [this.canvas.width, this.canvas.height] = [this.width, this.height].map(side => Math.round(side * this.ratio));
      this.home();
    }

    // The whole map; `zoom` is screen px a pixel of the map, `left`, `top` the place of its corner.
    home() {
      this.zoom = this.least = Math.min(this.width / this.data.width, (this.height - 24) / this.data.height);
      this.left = (this.width - this.zoom * this.data.width) / 2;
      this.top = (this.height - this.zoom * this.data.height) / 2;
      this.draw();
    }

    draw() {
      if (this.waiting) return;
      this.waiting = true;
      requestAnimationFrame(() => { this.waiting = false; this.render(); });
    }

    render() {
      const { pen, data, zoom } = this, color = name => getComputedStyle(this.root).getPropertyValue(name).trim();
      Object.assign(this, { ink: color("--ink"), paper: color("--view") });
      pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
      pen.clearRect(0, 0, this.width, this.height);
      pen.imageSmoothingEnabled = zoom < 4;
      if (this.layers[this.mode].complete) {
        pen.drawImage(this.layers[this.mode], this.left, this.top, zoom * data.width, zoom * data.height);
      }
      this.scale();
      this.ruler();
    }

    stroke(places, color, width) {
      Object.assign(this.pen, { strokeStyle: color, lineWidth: width, lineCap: "round" });
      this.pen.beginPath();
      places.forEach(([x, y], i) => (i ? this.pen.lineTo(x, y) : this.pen.moveTo(x, y)));
      this.pen.stroke();
    }

    write(text, x, y, align, ink, paper, font) {
      Object.assign(this.pen, { font, textAlign: align, lineWidth: 4, lineJoin: "round", strokeStyle: paper, fillStyle: ink });
      this.pen.strokeText(text, x, y);
      this.pen.fillText(text, x, y);
    }

    scale() {
      const perPixel = this.data.pixel / this.zoom, length = roundLength(perPixel * Math.min(170, this.width / 3));
      const right = this.width - 18, y = this.height - 18, left = right - length / perPixel;
      for (const [color, width] of [[this.paper, 5], [this.ink, 2]]) {
        this.stroke([[left, y - 5], [left, y], [right, y], [right, y - 5]], color, width);
      }
      this.write(`${round(length)} ${this.data.unit}`, right, y - 11, "right", this.ink, this.paper, "12px system-ui, sans-serif");
    }

    ruler() {
      const places = this.marks.map(([east, north]) => this.place(east, north));
      if (places.length === 2) { this.stroke(places, "#fff", 4); this.stroke(places, RULER, 2); }
      this.pen.fillStyle = RULER;
      for (const [x, y] of places) { this.pen.beginPath(); this.pen.arc(x, y, 4.5, 0, 7); this.pen.fill(); }
      if (places.length < 2) return;
      const [[e1, n1], [e2, n2]] = this.marks, x = (places[0][0] + places[1][0]) / 2, y = (places[0][1] + places[1][1]) / 2;
      const length = `${round(Math.hypot(e2 - e1, n2 - n1))} ${this.data.unit}`;
      this.write(length, x, y - 10, "center", "#fff", "#7a3d00", "600 14px system-ui, sans-serif");
    }

    // Between the map's coordinates and the screen's.
    place(east, north) {
      const { pixel, west, north: top } = this.data;
      return [this.left + this.zoom * (east - west) / pixel, this.top + this.zoom * (top - north) / pixel];
    }

    at(event) {
      const box = this.canvas.getBoundingClientRect(), { pixel, west, north } = this.data;
      const x = event.clientX - box.left, y = event.clientY - box.top;
      return { x, y, world: [west + (x - this.left) / this.zoom * pixel, north - (y - this.top) / this.zoom * pixel] };
    }

    zoomBy(factor, x = this.width / 2, y = this.height / 2) {
      const zoom = Math.max(this.least / 2, Math.min(60, this.zoom * factor)), change = zoom / this.zoom;
      Object.assign(this, { zoom, left: x - (x - this.left) * change, top: y - (y - this.top) * change });
      this.draw();
    }

    listen() {
      const on = (name, act, options) => this.canvas.addEventListener(name, act, options);
      on("pointerdown", event => this.press(event));
      on("pointermove", event => (this.pointers.has(event.pointerId) ? this.drag(event) : this.hover(event)));
      on("pointerup", event => this.release(event));
      on("pointercancel", event => this.pointers.delete(event.pointerId));
      on("pointerleave", () => { this.readout.textContent = ""; });
      on("wheel", event => this.wheel(event), { passive: false });
      this.root.querySelectorAll("[data-act]").forEach(button => {
        button.addEventListener("click", () => this.act(button.dataset.act));
      });
      matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
      addEventListener("themechange", () => this.draw());
    }

    press(event) {
      this.canvas.focus({ preventScroll: true });
      this.canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
      this.travelled = 0;
    }

    drag(event) {
      const before = this.pointers.get(event.pointerId), now = [event.clientX, event.clientY];
      const [dx, dy] = [now[0] - before[0], now[1] - before[1]], share = 1 / this.pointers.size;
      this.travelled += Math.abs(dx) + Math.abs(dy);
      this.pointers.set(event.pointerId, now);
      Object.assign(this, { left: this.left + share * dx, top: this.top + share * dy });
      if (this.pointers.size === 2) this.pinch(before, now, event.pointerId);
      this.draw();
    }

    pinch(before, now, id) {
      const [, other] = [...this.pointers].find(([key]) => key !== id), box = this.canvas.getBoundingClientRect();
      const apart = p => Math.max(Math.hypot(p[0] - other[0], p[1] - other[1]), 1);
      this.zoomBy(apart(now) / apart(before), (now[0] + other[0]) / 2 - box.left, (now[1] + other[1]) / 2 - box.top);
    }

    release(event) {
      const alone = this.pointers.size === 1;
      this.pointers.delete(event.pointerId);
      if (!alone || this.travelled >= 4) return;
      this.marks = this.marks.length === 2 ? [this.at(event).world] : [...this.marks, this.at(event).world];
      this.draw();
    }

    wheel(event) {
      const turned = globalThis.uwWheel(this, event);
      if (turned === null) return;
      const { x, y } = this.at(event);
      this.zoomBy(Math.exp(-turned), x, y);
    }

    hover(event) {
      const show = value => value.toFixed(2).replace("-", "\u2212"), [east, north] = this.at(event).world;
      if (event.pointerType !== "touch") this.readout.textContent = `east ${show(east)}  north ${show(north)} ${this.data.unit}`;
    }

    act(name) {
      if (name.startsWith("mode-")) this.mode = Number(name.slice(5));
      if (name === "larger") this.zoomBy(1.4);
      if (name === "smaller") this.zoomBy(1 / 1.4);
      if (name === "reset") { this.marks = []; this.home(); }
      this.root.querySelectorAll("[aria-pressed]").forEach(button => {
        button.setAttribute("aria-pressed", String(button.dataset.act === `mode-${this.mode}`));
      });
      this.root.querySelectorAll(".legend").forEach(legend => { legend.hidden = Number(legend.dataset.mode) !== this.mode; });
      this.draw();
    }
  }

  document.querySelectorAll(".map").forEach(root => {
    root.view = new ChartView(root, JSON.parse(document.getElementById(root.dataset.map).textContent));
  });
})();
