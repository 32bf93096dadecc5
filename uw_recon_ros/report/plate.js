"use strict";
// A picture on a canvas to move and zoom, as the map and the view to measure in have it. Derived classes have `render`,
// `click` and `hover`.
globalThis.uwPlate = class {
  // `columns`, `rows`: of the picture, px; `spare`: screen px kept free below it.
  constructor(root, columns, rows, spare = 0) {
    Object.assign(this, { root, columns, rows, spare, canvas: root.querySelector("canvas"), readout: root.querySelector(".readout") });
    Object.assign(this, { pen: this.canvas.getContext("2d"), pointers: new Map() });
  }

  // A picture that is drawn when it is there.
  picture(uri) {
    const picture = new Image();
    picture.onload = () => { this.root.dataset.ready = "yes"; this.draw(); };
    picture.src = uri;
    return picture;
  }

  begin() {
    this.listen();
    new ResizeObserver(() => { this.resize(); }).observe(this.root);
    this.resize();
  }

  resize() {
    this.ratio = Math.min(devicePixelRatio || 1, 2);
    [this.width, this.height] = [Math.max(this.canvas.clientWidth, 1), Math.max(this.canvas.clientHeight, 1)];
    [this.canvas.width, this.canvas.height] = [this.width, this.height].map(side => Math.round(side * this.ratio));
    this.home();
  }

  // All of it; `zoom` is screen px a pixel of the picture, `left`, `top` the place of its corner.
  home() {
    this.zoom = this.least = Math.min(this.width / this.columns, (this.height - this.spare) / this.rows);
    this.left = (this.width - this.zoom * this.columns) / 2;
    this.top = (this.height - this.zoom * this.rows) / 2;
    this.draw();
  }

  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.render(); });
  }

  clear(picture) {
    const { pen, zoom } = this, color = name => getComputedStyle(this.root).getPropertyValue(name).trim();
    Object.assign(this, { ink: color("--ink"), paper: color("--view") });
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    pen.clearRect(0, 0, this.width, this.height);
    pen.imageSmoothingEnabled = zoom < 4;
    if (picture.complete) pen.drawImage(picture, this.left, this.top, zoom * this.columns, zoom * this.rows);
  }

  stroke(places, color, width) {
    Object.assign(this.pen, { strokeStyle: color, lineWidth: width, lineCap: "round", lineJoin: "round" });
    this.pen.beginPath();
    places.forEach(([x, y], i) => (i ? this.pen.lineTo(x, y) : this.pen.moveTo(x, y)));
    this.pen.stroke();
  }

  dots(places, color) {
    this.pen.fillStyle = color;
    for (const [x, y] of places) { this.pen.beginPath(); this.pen.arc(x, y, 4.5, 0, 7); this.pen.fill(); }
  }

  write(text, x, y, align, ink, paper, font) {
    Object.assign(this.pen, { font, textAlign: align, lineWidth: 4, lineJoin: "round", strokeStyle: paper, fillStyle: ink });
    this.pen.strokeText(text, x, y);
    this.pen.fillText(text, x, y);
  }

  label(text, x, y) {
    this.write(text, x, y, "center", "#fff", "#7a3d00", "600 14px system-ui, sans-serif");
  }

  // Place on the canvas, and of the picture's px; the middle of its first pixel is (0, 0).
  under(event) {
    const box = this.canvas.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
    return { x, y, u: (x - this.left) / this.zoom - 0.5, v: (y - this.top) / this.zoom - 0.5 };
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
    if (this.travelled < 4) return; // a finger trembles
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
    if (this.pointers.delete(event.pointerId) && alone && this.travelled < 4) this.click(event);
  }

  wheel(event) {
    const turned = globalThis.uwWheel(this, event);
    if (turned === null) return;
    const { x, y } = this.under(event);
    this.zoomBy(Math.exp(-turned), x, y);
  }
};
