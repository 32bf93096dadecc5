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

  class ChartView extends globalThis.uwPlate {
    constructor(root, data) {
      super(root, data.width, data.height, 24);
      Object.assign(this, { data, marks: [], mode: 0 });
      this.ruler = document.getElementById(root.dataset.ruler)?.ruler;
      this.ruler?.join(this);
      this.layers = data.layers.map(uri => this.picture(uri));
      this.root.querySelectorAll("[data-act]").forEach(button => {
        button.addEventListener("click", () => this.act(button.dataset.act));
      });
      this.begin();
    }

    render() {
      this.clear(this.layers[this.mode]);
      this.scale();
      this.lines().forEach(line => this.outline(line));
    }

    scale() {
      const perPixel = this.data.pixel / this.zoom, length = roundLength(perPixel * Math.min(170, this.width / 3));
      const right = this.width - 18, y = this.height - 18, left = right - length / perPixel;
      for (const [color, width] of [[this.paper, 5], [this.ink, 2]]) {
        this.stroke([[left, y - 5], [left, y], [right, y], [right, y - 5]], color, width);
      }
      this.write(`${round(length)} ${this.data.unit}`, right, y - 11, "right", this.ink, this.paper, "12px system-ui, sans-serif");
    }

    // What is measured: by the page's ruler where it has one, else between two clicks on the level.
    lines() {
      if (this.ruler) {
        const [east, north] = this.ruler.model.origin;
        return this.ruler.clicks.lines.map(line => ({ ...line, points: line.points.map(([x, y]) => [x + east, y + north]) }));
      }
      const [[e1, n1], [e2, n2]] = this.marks.length === 2 ? this.marks : [[0, 0], [0, 0]];
      const label = this.marks.length === 2 ? `${round(Math.hypot(e2 - e1, n2 - n1))} ${this.data.unit}` : "";
      return [{ points: this.marks, color: RULER, closed: false, label }];
    }

    outline({ points, color, closed, label }) {
      const places = points.map(([east, north]) => this.place(east, north));
      const way = closed && places.length > 2 ? [...places, places[0]] : places;
      if (way.length > 1) { this.stroke(way, "#fff", 4); this.stroke(way, color, 2); }
      this.dots(places, color);
      if (!label) return;
      const [x, y] = [0, 1].map(k => places.reduce((total, place) => total + place[k], 0) / places.length);
      this.label(label, x, y - 10);
    }

    // Between the map's coordinates and the screen's.
    place(east, north) {
      const { pixel, west, north: top } = this.data;
      return [this.left + this.zoom * (east - west) / pixel, this.top + this.zoom * (top - north) / pixel];
    }

    at(event) {
      const { u, v } = this.under(event), { pixel, west, north } = this.data;
      return [west + (u + 0.5) * pixel, north - (v + 0.5) * pixel];
    }

    click(event) {
      if (this.ruler) { this.ruler.addBelow(...this.at(event), this.data.pixel / this.zoom); return; }
      this.marks = this.marks.length === 2 ? [this.at(event)] : [...this.marks, this.at(event)];
      this.draw();
    }

    hover(event) {
      const show = value => value.toFixed(2).replace("-", "\u2212"), [east, north] = this.at(event);
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
