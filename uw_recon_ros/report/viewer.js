"use strict";
// A textured mesh to turn, measure and look at closely. Nothing is loaded from elsewhere.
(() => {
  const { decode, meet } = globalThis.uwMesh;
  const KEYS = { r: "reset", w: "wire", m: "measure", f: "fullscreen", 1: "mode-0", 2: "mode-1", 3: "mode-2", 4: "mode-3", 5: "mode-4", 6: "mode-5", t: "track" };
  const TURNS = { ArrowLeft: [-20, 0], ArrowRight: [20, 0], ArrowUp: [0, -20], ArrowDown: [0, 20] };

  class Viewer {
    constructor(root, data) {
      this.root = root;
      this.unit = data.metric ? "m" : "baselines";
      this.canvas = root.querySelector("canvas.scene");
      this.overlay = root.querySelector("canvas.overlay");
      this.readout = root.querySelector(".readout");
      this.mesh = decode(data);
      this.ruler = document.getElementById(root.dataset.ruler)?.ruler;
      this.ruler?.join(this, this.mesh);
      this.camera = new globalThis.uwCamera(this.mesh, data.tracks.length ? 1.18 : 1.02); // tracks go beyond the surface
      this.turn = data.turn;
      this.tracks = data.tracks.map(track => globalThis.uwMesh.line(track, data.turn));
      this.notes = new globalThis.uwNotes(this.overlay, this.unit, data.turn);
      this.painter = new globalThis.uwPainter(this.canvas, this.mesh, data, () => {
        root.dataset.ready = "yes";
        this.draw();
      });
      Object.assign(this, { mode: 0, wire: false, measuring: false, tracking: true, marks: [], pointers: new Map() });
      this.listen();
      this.resize();
      this.camera.home();
      new ResizeObserver(() => { this.resize(); this.render(); }).observe(root); // at once: resizing wipes a canvas
    }

    resize() {
      this.ratio = Math.min(devicePixelRatio || 1, 2);
      this.camera.width = Math.max(this.canvas.clientWidth, 1); // the tool bar may stand above it
      this.camera.height = Math.max(this.canvas.clientHeight, 1);
      for (const canvas of [this.canvas, this.overlay]) {
        canvas.width = Math.round(this.camera.width * this.ratio);
        canvas.height = Math.round(this.camera.height * this.ratio);
      }
    }

    // Once before the next repaint, however often it is asked for.
    draw() {
      if (this.waiting) return;
      this.waiting = true;
      requestAnimationFrame(() => {
        this.waiting = false;
        this.render();
      });
    }

    render() {
      this.painter.paint(this.camera.matrices(), this.mode, this.wire);
      this.notes.draw(this.camera, this.ruler ? this.measured() : this.notes.lines(this.marks), this.ratio, this.tracking ? this.tracks : []);
    }

    // What the ruler holds, in the axes of this view.
    measured() {
      return this.ruler.clicks.lines.map(line => ({ ...line, points: line.points.map(point => this.turned(point)) }));
    }

    // Between the surface's own frame and this view's.
    turned(point) { return [0, 1, 2].map(k => this.turn[k] * point[k]); }

    // The point of the surface under the pointer, or null.
    pick(event) {
      const box = this.canvas.getBoundingClientRect(), eye = this.camera.eye();
      const ray = this.camera.ray(event.clientX - box.left, event.clientY - box.top), distance = meet(this.mesh, eye, ray);
      return distance < Infinity ? eye.map((value, k) => value + distance * ray[k]) : null;
    }

    listen() {
      const canvas = this.canvas, on = (name, act, options) => canvas.addEventListener(name, act, options);
      on("contextmenu", event => event.preventDefault());
      on("pointerdown", event => this.press(event));
      on("pointermove", event => (this.pointers.has(event.pointerId) ? this.drag(event) : this.hover(event)));
      on("pointerup", event => this.release(event));
      on("pointercancel", event => this.release(event));
      on("pointerleave", () => { this.readout.textContent = ""; });
      on("dblclick", event => this.turnAbout(this.pick(event)));
      on("wheel", event => this.wheel(event), { passive: false });
      on("keydown", event => this.key(event));
      const full = this.root.querySelector("[data-act=fullscreen]");
      if (full) full.hidden = !document.fullscreenEnabled; // telephones, frames that do not allow it
      this.root.querySelectorAll("[data-act]").forEach(button => {
        button.addEventListener("click", () => this.act(button.dataset.act));
      });
      matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
      addEventListener("themechange", () => this.draw());
    }

    press(event) {
      this.canvas.focus({ preventScroll: true });
      this.canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY, button: event.button });
      this.travelled = 0;
    }

    drag(event) {
      const before = this.pointers.get(event.pointerId), now = { ...before, x: event.clientX, y: event.clientY };
      const dx = now.x - before.x, dy = now.y - before.y;
      this.travelled += Math.abs(dx) + Math.abs(dy);
      this.pointers.set(event.pointerId, now);
      if (this.pointers.size > 1) this.pinch(before, now, event.pointerId);
      else if (before.button > 0 || event.shiftKey) this.camera.pan(dx, dy);
      else this.camera.orbit(dx, dy);
      this.draw();
    }

    pinch(before, now, id) {
      const [, other] = [...this.pointers].find(([key]) => key !== id);
      const apart = p => Math.max(Math.hypot(p.x - other.x, p.y - other.y), 1);
      this.camera.zoom(apart(before) / apart(now));
      this.camera.pan((now.x - before.x) / 2, (now.y - before.y) / 2);
    }

    release(event) {
      const pressed = this.pointers.delete(event.pointerId);
      if (pressed && this.measuring && this.travelled < 4 && event.type === "pointerup") this.mark(this.pick(event));
    }

    mark(point) {
      if (point && this.ruler) this.ruler.add(this.turned(point), this.camera.perPixelAt(point));
      else if (point) this.marks = this.marks.length === 2 ? [point] : [...this.marks, point];
      this.draw();
    }

    turnAbout(point) {
      if (point) this.camera.target = point;
      this.draw();
    }

    wheel(event) {
      const turned = globalThis.uwWheel(this, event);
      if (turned === null) return;
      this.camera.zoom(Math.exp(turned));
      this.draw();
    }

    hover(event) {
      if (event.pointerType === "touch" || this.looking) return;
      this.looking = true;
      requestAnimationFrame(() => {
        this.looking = false;
        const hit = this.pick(event)?.map((value, k) => (this.turn[k] * value).toFixed(3).replace("-", "\u2212"));
        this.readout.textContent = hit ? `x ${hit[0]}  y ${hit[1]}  z ${hit[2]} ${this.unit}` : "";
      });
    }

    key(event) {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (TURNS[event.key]) this.camera.orbit(...TURNS[event.key]);
      else if (event.key === "+" || event.key === "=") this.camera.zoom(0.9);
      else if (event.key === "-") this.camera.zoom(1.1);
      else if (KEYS[event.key]) this.act(KEYS[event.key]);
      else return;
      event.preventDefault();
      this.draw();
    }

    act(name) {
      if (name.startsWith("mode-")) this.mode = Number(name.slice(5));
      if (name === "wire") this.wire = !this.wire;
      if (name === "track") this.tracking = !this.tracking;
      if (name === "measure") Object.assign(this, { measuring: !this.measuring, marks: [] });
      if (name === "reset") { this.marks = []; this.camera.home(); }
      if (name === "fullscreen") {
        if (document.fullscreenElement) document.exitFullscreen(); else this.root.requestFullscreen?.();
      }
      const on = { wire: this.wire, measure: this.measuring, track: this.tracking, [`mode-${this.mode}`]: true };
      this.root.querySelectorAll("[aria-pressed]").forEach(button => {
        button.setAttribute("aria-pressed", String(Boolean(on[button.dataset.act])));
      });
      this.root.querySelectorAll(".legend").forEach(legend => { legend.hidden = Number(legend.dataset.mode) !== this.mode; });
      this.root.classList.toggle("measuring", this.measuring);
      this.draw();
    }
  }

  document.querySelectorAll(".viewer").forEach(root => {
    try {
      root.view = new Viewer(root, JSON.parse(document.getElementById(root.dataset.mesh).textContent));
    } catch (error) {
      root.querySelector(".problem").textContent = `The 3-D view cannot be shown: ${error.message}.`;
      root.classList.add("failed");
    }
  });
})();
