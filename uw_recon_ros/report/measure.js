"use strict";
// Measuring by clicks in the left view: what uwMeasure answers, drawn, listed, and given out as CSV or JSON.
(() => {
  const COLORS = ["#ff8c1a", "#2fb3ff", "#6fd66f", "#e86fd0", "#f2d33c"];
  const ASKS = {
    length: ["Click the ends of what is to be measured.", "More clicks make a polyline; Next begins another."],
    height: ["Click a point: its height above the bottom that most of the view lies in.", "Each click is a point of its own."],
    to_plane: ["Click three corners or more of a plane, then Next.", "Now click points: their distances from the plane. Next begins another plane."],
    area: ["Click the corners of a patch, three or more.", "Further clicks are further corners; Next begins another patch."],
  };
  const NAMES = { length: "length", polyline: "polyline", height: "height", to_plane: "to plane", area: "area", rugosity: "rugosity" };
  const digits = (value, most) => value.toLocaleString("en", { maximumSignificantDigits: most, useGrouping: false }).replace("-", "\u2212");
  const known = (value, most = 2) => (value === null ? "\u2013" : digits(value, most));
  const unit = text => text.replace("2", "\u00b2");

  class MeasureView extends globalThis.uwPlate {
    constructor(root, frame) {
      super(root.querySelector(".plate"), frame.width, frame.height);
      Object.assign(this, { whole: root, frame, kind: "length", points: [], plane: null, entries: [], open: null, wrong: "" });
      this.shown = this.picture(frame.picture);
      const on = (name, act) => root.querySelectorAll(`[data-${name}]`).forEach(e => e.addEventListener("click", () => act(e.dataset[name])));
      on("kind", kind => this.choose(kind));
      on("act", name => this.act(name));
      root.querySelector("input").addEventListener("change", () => this.again());
      this.canvas.addEventListener("keydown", event => this.key(event));
      this.begin();
      this.tell();
    }

    get clickPx() {
      const value = Number(this.whole.querySelector("input").value);
      return value >= 0 && value <= 100 ? value : 1;
    }

    get cornering() { return this.kind === "to_plane" && !this.plane; }

    choose(kind) {
      this.whole.querySelectorAll("[data-kind]").forEach(e => e.setAttribute("aria-pressed", String(e.dataset.kind === kind)));
      Object.assign(this, { kind, plane: null });
      this.next();
    }

    // What is being clicked is finished.
    next() {
      Object.assign(this, { points: [], open: null, wrong: "" });
      this.tell();
    }

    // Runs `uw_recon measure` in small; RangeError is its refusal.
    measured(kind, points, plane) {
      const quantity = kind === "to_plane" ? "height" : kind;
      const rows = globalThis.uwMeasure.measure(this.frame, quantity, points, { plane, clickPx: this.clickPx });
      return rows.map(row => globalThis.uwMeasure.rowOf(this.frame, row));
    }

    click(event) {
      const { u, v } = this.under(event), { width, height } = this.frame;
      if (u < -0.5 || v < -0.5 || u > width - 0.5 || v > height - 0.5) return;
      const inside = (x, most) => Math.min(Math.max(Math.round(100 * x) / 100, 0), most - 1);
      this.add([inside(u, width), inside(v, height)]);
    }

    add(point) {
      Object.assign(this, { points: [...this.points, point], wrong: "" });
      const least = { length: 2, height: 1, to_plane: 1, area: 3 }[this.kind];
      if (!this.cornering && this.points.length >= least) this.answer();
      this.tell();
    }

    answer() {
      const { kind, points, plane } = this, alone = kind === "height" || kind === "to_plane";
      try {
        this.keep({ kind, points, plane, rows: this.measured(kind, points, plane) });
        if (alone) Object.assign(this, { points: [], open: null });
      } catch (error) {
        if (!(error instanceof RangeError)) throw error;
        this.wrong = error.message;
        if (kind !== "area") this.points = points.slice(0, -1); // a patch may become better by one corner more
        else this.drop();
      }
    }

    keep(entry) {
      if (this.open) this.entries = this.entries.map(old => (old === this.open ? { ...entry, color: old.color } : old));
      else this.entries = [...this.entries, { ...entry, color: COLORS[this.entries.length % COLORS.length] }];
      this.open = this.entries.find(made => made.points === entry.points);
    }

    drop() {
      this.entries = this.entries.filter(entry => entry !== this.open);
      this.open = null;
    }

    undo() {
      this.wrong = "";
      if (this.points.length) {
        const left = this.points.slice(0, -1);
        this.drop();
        this.points = [];
        left.forEach(point => this.add(point));
      } else if (this.plane && !this.entries.some(entry => entry.plane === this.plane)) this.plane = null;
      else this.entries = this.entries.slice(0, -1);
      this.tell();
    }

    // All results anew: how well clicks hit has changed.
    again() {
      const now = entry => ({ ...entry, rows: this.measured(entry.kind, entry.points, entry.plane) });
      this.entries = this.entries.map(entry => {
        const made = now(entry);
        if (entry === this.open) this.open = made;
        return made;
      });
      this.tell();
    }

    act(name) {
      if (name === "larger") this.zoomBy(1.4);
      if (name === "smaller") this.zoomBy(1 / 1.4);
      if (name === "reset") this.home();
      if (name === "undo") this.undo();
      if (name === "next") this.forward();
      if (name === "clear") { this.entries = []; this.plane = null; this.next(); }
      if (name === "csv") this.save("measured.csv", "text/csv", this.csv());
      if (name === "json") this.save("measured.json", "application/json", this.json());
      if (name === "copy") this.copy(this.csv());
    }

    forward() {
      if (!this.cornering) this.plane = null;
      else if (this.points.length >= 3) this.plane = this.points;
      else { this.wrong = `a plane has three corners or more, got ${this.points.length}`; this.tell(); return; }
      this.next();
    }

    key(event) {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const acts = { Enter: "next", Backspace: "undo", "+": "larger", "-": "smaller", r: "reset" };
      if (!acts[event.key]) return;
      event.preventDefault();
      this.act(acts[event.key]);
    }

    get results() { return this.entries.flatMap(entry => entry.rows); }

    csv() {
      const cell = x => (x === null ? "" : typeof x === "boolean" ? (x ? "True" : "False") : Array.isArray(x) ? `"${x.map(p => p.join(",")).join(" ")}"` : String(x));
      const text = x => (typeof x === "string" && /[",\n]/.test(x) ? `"${x.replaceAll('"', '""')}"` : cell(x));
      return `${[Object.keys(this.results[0]), ...this.results.map(row => Object.values(row).map(text))].map(line => line.join(",")).join("\n")}\n`;
    }

    // Stamps have more digits than a number of this language.
    json() {
      return `${JSON.stringify(this.results, null, 2).replace(/"stamp_ns": "(\d+)"/g, '"stamp_ns": $1')}\n`;
    }

    save(name, kind, text) {
      const link = document.createElement("a");
      link.download = name;
      link.href = `data:${kind};charset=utf-8,${encodeURIComponent(text)}`;
      link.click();
    }

    async copy(text) {
      const button = this.whole.querySelector("[data-act=copy]");
      try {
        await navigator.clipboard.writeText(text);
      } catch {
        const area = document.createElement("textarea");
        area.value = text;
        document.body.append(area);
        area.select();
        document.execCommand("copy");
        area.remove();
      }
      button.textContent = "Copied";
      setTimeout(() => { button.textContent = "Copy as CSV"; }, 1500);
    }

    tell() {
      const asks = this.whole.querySelector(".asks"), [first, then] = ASKS[this.kind];
      const begun = this.cornering ? false : this.plane || this.open || (this.kind === "height" && this.entries.some(e => e.kind === "height"));
      const counted = this.cornering && this.points.length ? ` ${this.points.length} so far.` : "";
      asks.textContent = this.wrong || (begun ? then : first) + counted;
      asks.classList.toggle("wrong", Boolean(this.wrong));
      this.list();
      this.draw();
    }

    list() {
      const body = this.whole.querySelector("tbody");
      this.whole.querySelector(".results").hidden = !this.entries.length;
      body.replaceChildren(...this.entries.flatMap((entry, k) => entry.rows.map(row => {
        const line = document.createElement("tr"), far = this.frame.unit;
        const cells = [
          `${k + 1} ${NAMES[row.quantity]}`, `${known(row.value, 4)} ${unit(row.unit)}${row.reliable ? "" : " (not reliable)"}`, `${known(row.sigma)} ${unit(row.unit)}`,
          [row.sigma_disparity, row.sigma_click, row.sigma_calibration].map(x => known(x)).join(", "),
          `${known(row.depth, 3)} ${far}`, row.pixels.map(p => p.join(",")).join("  "),
        ];
        line.append(...cells.map((words, i) => {
          const cell = document.createElement(i ? "td" : "th");
          cell.textContent = words;
          return cell;
        }));
        return line;
      })));
    }

    place([u, v]) { return [this.left + this.zoom * (u + 0.5), this.top + this.zoom * (v + 0.5)]; }

    outline(points, color, closed) {
      const places = points.map(point => this.place(point)), way = closed && places.length > 2 ? [...places, places[0]] : places;
      if (way.length > 1) { this.stroke(way, "#fff", 4); this.stroke(way, color, 2); }
      this.dots(places, "#fff");
      this.pen.fillStyle = color;
      for (const [x, y] of places) { this.pen.beginPath(); this.pen.arc(x, y, 3.2, 0, 7); this.pen.fill(); }
      return places;
    }

    render() {
      this.clear(this.shown);
      for (const [k, entry] of this.entries.entries()) {
        if (entry.plane) this.outline(entry.plane, "#9aa9ba", true);
        const places = this.outline(entry.points, entry.color, entry.kind === "area");
        const [x, y] = [0, 1].map(j => places.reduce((total, place) => total + place[j], 0) / places.length), [row] = entry.rows;
        this.label(`${k + 1}: ${known(row.value, 3)} \u00b1 ${known(row.sigma)} ${unit(row.unit)}`, x, y - 12);
      }
      if (this.plane) this.outline(this.plane, "#9aa9ba", true);
      if (!this.open) this.outline(this.points, this.cornering ? "#9aa9ba" : COLORS[this.entries.length % COLORS.length], this.cornering);
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
