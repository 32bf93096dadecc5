"use strict";
// What is measured by clicks: the points clicked so far, the results in a table, given out as CSV or JSON. Where the clicks
// come from and what they mean is the host's: `measured(kind, points, plane)` answers rows, `cells(row)` their texts for
// the table, `draw()` shows them.
(() => {
  const COLORS = ["#ff8c1a", "#2fb3ff", "#6fd66f", "#e86fd0", "#f2d33c"];
  const ASKS = {
    length: ["Click the ends of what is to be measured.", "More clicks make a polyline; Next begins another."],
    height: ["Click a point: its height above the bottom that most of the view lies in.", "Each click is a point of its own."],
    to_plane: ["Click three corners or more of a plane, then Next.", "Now click points: their distances from the plane. Next begins another plane."],
    area: ["Click the corners of a patch, three or more.", "Further clicks are further corners; Next begins another patch."],
  };
  const digits = (value, most) => value.toLocaleString("en", { maximumSignificantDigits: most, useGrouping: false }).replace("-", "\u2212");
  const known = (value, most = 2) => (value === null ? "\u2013" : digits(value, most));
  const unit = text => text.replace("2", "\u00b2");
  const atEdge = row => (Number.isFinite(row.other) ? ` (at an edge: ${known(row.other, 4)} ${unit(row.unit)} by the other surface)` : "");

  class Clicks {
    constructor(root, host) {
      Object.assign(this, { whole: root, host, kind: "length", points: [], plane: null, entries: [], open: null, wrong: "" });
      const on = (name, act) => root.querySelectorAll(`[data-${name}]`).forEach(e => e.addEventListener("click", () => act(e.dataset[name])));
      on("kind", kind => this.choose(kind));
      on("act", name => this.act(name));
      root.querySelector("input").addEventListener("change", () => this.again());
    }

    // How well clicks hit.
    get px() {
      const value = Number(this.whole.querySelector("input").value);
      return value >= 0 && value <= 100 ? value : 1;
    }

    get cornering() { return this.kind === "to_plane" && !this.plane; }

    // The colour of what is being clicked.
    get color() { return this.cornering ? "#9aa9ba" : COLORS[this.entries.length % COLORS.length]; }

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

    add(point) {
      Object.assign(this, { points: [...this.points, point], wrong: "" });
      const least = { length: 2, height: 1, to_plane: 1, area: 3 }[this.kind];
      if (!this.cornering && this.points.length >= least) this.answer();
      this.tell();
    }

    answer() {
      const { kind, points, plane } = this, alone = kind === "height" || kind === "to_plane";
      try {
        this.keep({ kind, points, plane, rows: this.host.measured(kind, points, plane) });
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
      const now = entry => ({ ...entry, rows: this.host.measured(entry.kind, entry.points, entry.plane) });
      this.entries = this.entries.map(entry => {
        const made = now(entry);
        if (entry === this.open) this.open = made;
        return made;
      });
      this.tell();
    }

    act(name) {
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

    get results() { return this.entries.flatMap(entry => entry.rows); }

    csv() {
      const cell = x => (x === null ? "" : typeof x === "boolean" ? (x ? "True" : "False") : Array.isArray(x) ? `"${x.map(p => [p].flat().join(",")).join(" ")}"` : String(x));
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
      this.host.draw();
    }

    list() {
      const body = this.whole.querySelector("tbody");
      this.whole.querySelector(".results").hidden = !this.entries.length;
      body.replaceChildren(...this.entries.flatMap((entry, k) => entry.rows.map(row => {
        const line = document.createElement("tr"), mark = (row.reliable ? "" : " (not reliable)") + atEdge(row);
        const cells = [
          `${k + 1} ${row.quantity.replace("_", " ")}`, `${known(row.value, 4)} ${unit(row.unit)}${mark}`,
          `${known(row.sigma)} ${unit(row.unit)}`, ...this.host.cells(row),
        ];
        line.append(...cells.map((words, i) => {
          const cell = document.createElement(i ? "td" : "th");
          cell.textContent = words;
          return cell;
        }));
        return line;
      })));
    }

    // What is to be drawn, the latest last: points, their colour, whether they close to an outline, and the result.
    get lines() {
      const made = this.entries.flatMap((entry, k) => [
        ...(entry.plane ? [{ points: entry.plane, color: "#9aa9ba", closed: true, label: "" }] : []),
        { points: entry.points, color: entry.color, closed: entry.kind === "area", label: Clicks.label(entry, k) },
      ]);
      if (this.plane) made.push({ points: this.plane, color: "#9aa9ba", closed: true, label: "" });
      if (!this.open) made.push({ points: this.points, color: this.color, closed: this.cornering, label: "" });
      return made;
    }

    static label({ rows: [row] }, k) { return `${k + 1}: ${known(row.value, 3)} \u00b1 ${known(row.sigma)} ${unit(row.unit)}`; }
  }

  globalThis.uwClicks = Object.assign(Clicks, { known });
})();
