"use strict";
// The table below a model's 3-D view and map: clicks in either are measured as `uw_recon measure` does.
(() => {
  const { known } = globalThis.uwClicks;

  class Ruler {
    constructor(root, told) {
      Object.assign(this, { model: globalThis.uwModel.opened(told), views: [], mesh: null });
      this.clicks = new globalThis.uwClicks(root, this);
      this.clicks.tell();
    }

    // A view that shows what is measured; `mesh`: the surface.
    join(view, mesh = null) {
      this.views.push(view);
      this.mesh ??= mesh;
    }

    draw() { this.views.forEach(view => view.draw()); }

    // A point of the surface, world less the origin; `perPixel`: how long a pixel of the screen is there.
    add(point, perPixel) { this.clicks.add([...point, perPixel]); }

    // The surface straight below a place of the map.
    addBelow(east, north, perPixel) {
      const { origin } = this.model, { positions: p } = this.mesh;
      let top = -Infinity;
      for (let i = 2; i < p.length; i += 3) top = Math.max(top, p[i]);
      const eye = [east - origin[0], north - origin[1], top + 1], down = globalThis.uwMesh.meet(this.mesh, eye, [0, 0, -1]);
      if (down < Infinity) this.add([eye[0], eye[1], eye[2] - down], perPixel);
      else Object.assign(this.clicks, { wrong: "no surface there" }).tell();
    }

    // Nobody hits better than a cell of the map.
    hit(point) { return Math.max(this.clicks.px * point[3], this.model.click); }

    measured(kind, points, plane) {
      const all = kind === "to_plane" ? [...points, ...plane] : points, place = point => point.slice(0, 3);
      const made = globalThis.uwModel.measure(this.model, kind, points.map(place), plane?.map(place), all.map(point => this.hit(point)));
      return [globalThis.uwModel.rowOf(this.model, made)];
    }

    cells(row) {
      const parts = [row.sigma_surface, row.sigma_trajectory, row.sigma_click, row.sigma_calibration];
      return [
        parts.map(x => known(x)).join(", "), `${known(row.distance, 3)} ${row.unit}`,
        row.points.map(point => point.map(x => x.toFixed(3).replace(/^-(0\.0+)$/, "$1")).join(",")).join("  "),
      ];
    }
  }

  document.querySelectorAll(".ruler").forEach(root => {
    root.ruler = new Ruler(root, JSON.parse(document.getElementById(`${root.id}-told`).textContent));
  });
})();
