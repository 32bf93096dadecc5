"use strict";
// Measuring by clicks in the left view: what uwMeasure answers, drawn there.
(() => {
  const { known } = globalThis.uwClicks;

  class MeasureView extends globalThis.uwPlate {
    constructor(root, frame) {
      super(root.querySelector(".plate"), frame.width, frame.height);
      this.frame = frame;
      this.shown = this.picture(frame.picture);
      this.clicks = new globalThis.uwClicks(root, this);
      root.querySelectorAll("[data-act]").forEach(e => e.addEventListener("click", () => this.act(e.dataset.act)));
      this.canvas.addEventListener("keydown", event => this.key(event));
      this.begin();
      this.clicks.tell();
    }

    // Runs `uw_recon measure` in small; RangeError is its refusal.
    measured(kind, points, plane) {
      const quantity = kind === "to_plane" ? "height" : kind;
      const rows = globalThis.uwMeasure.measure(this.frame, quantity, points, { plane, clickPx: this.clicks.px });
      return rows.map(row => globalThis.uwMeasure.rowOf(this.frame, row));
    }

    cells(row) {
      return [
        [row.sigma_disparity, row.sigma_click, row.sigma_calibration].map(x => known(x)).join(", "),
        `${known(row.depth, 3)} ${this.frame.unit}`, row.pixels.map(p => p.join(",")).join("  "),
      ];
    }

    click(event) {
      const { u, v } = this.under(event), { width, height } = this.frame;
      if (u < -0.5 || v < -0.5 || u > width - 0.5 || v > height - 0.5) return;
      const inside = (x, most) => Math.min(Math.max(Math.round(100 * x) / 100, 0), most - 1);
      this.clicks.add([inside(u, width), inside(v, height)]);
    }

    act(name) {
      if (name === "larger") this.zoomBy(1.4);
      if (name === "smaller") this.zoomBy(1 / 1.4);
      if (name === "reset") this.home();
    }

    key(event) {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const acts = { Enter: "next", Backspace: "undo", "+": "larger", "-": "smaller", r: "reset" };
      if (!acts[event.key]) return;
      event.preventDefault();
      this.act(acts[event.key]);
      this.clicks.act(acts[event.key]);
    }

    place([u, v]) { return [this.left + this.zoom * (u + 0.5), this.top + this.zoom * (v + 0.5)]; }

    outline({ points, color, closed, label }) {
      const places = points.map(point => this.place(point)), way = closed && places.length > 2 ? [...places, places[0]] : places;
      if (way.length > 1) { this.stroke(way, "#fff", 4); this.stroke(way, color, 2); }
      this.dots(places, "#fff");
      this.pen.fillStyle = color;
      for (const [x, y] of places) { this.pen.beginPath(); this.pen.arc(x, y, 3.2, 0, 7); this.pen.fill(); }
      if (!label) return;
      const [x, y] = [0, 1].map(j => places.reduce((total, place) => total + place[j], 0) / places.length);
      this.label(label, x, y - 12);
    }

    render() {
      this.clear(this.shown);
      for (const line of this.clicks.lines) this.outline(line);
    }

    hover(event) {
      if (event.pointerType === "touch") return;
      const { u, v } = this.under(event), [x, y] = [Math.round(u), Math.round(v)], { frame } = this;
      const there = x >= 0 && y >= 0 && x < frame.width && y < frame.height;
      const depth = there ? frame.focalTimesBaseline / (frame.disparity[y * frame.width + x] + frame.offset) : NaN;
      this.readout.textContent = there ? `${x}, ${y} px   ${Number.isFinite(depth) ? `${depth.toFixed(3)} ${frame.unit}` : "no depth"}` : "";
    }
  }

  document.querySelectorAll(".measure").forEach(async root => {
    try {
      const data = JSON.parse(document.getElementById(root.dataset.view).textContent);
      root.view = new MeasureView(root, await globalThis.uwMeasure.opened(data));
      root.dataset.ready = "yes";
    } catch (error) {
      root.querySelector(".asks").textContent = `Nothing can be measured here: ${error.message}.`;
    }
  });
})();
