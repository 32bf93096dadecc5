"use strict";
// Where the user looks from: an eye that circles a target.
globalThis.uwCamera = (() => {
  const { subtract, dot, cross, quantile } = globalThis.uwMesh;
  const SLOPE = Math.tan(20 * Math.PI / 180); // of half the vertical field of view
  const START = { yaw: 0.13, pitch: 0.05 };

  class Camera {
    // `room` is how much farther than needed to stand off, 1.02 = hardly.
    constructor(mesh, room) {
      Object.assign(this, { mesh, room });
      this.width = this.height = 1;
    }

    get aspect() { return this.width / this.height; }

    // World units a screen pixel at the target.
    get perPixel() { return 2 * this.distance * SLOPE / this.height; }

    // World units a screen pixel at a point.
    perPixelAt(point) {
      return this.perPixel * dot(subtract(this.eye(), point), this.axes().back) / this.distance;
    }

    // Look from beside the left camera's place at the middle of the surface, so that nearly all of it is in view.
    home() {
      const { positions: p, n } = this.mesh, every = pick => Array.from({ length: n }, (_, i) => pick(3 * i));
      this.target = [0, 1, 2].map(k => (quantile(every(i => p[i + k]), 0.03) + quantile(every(i => p[i + k]), 0.97)) / 2);
      Object.assign(this, START);
      const { right, up, back } = this.axes();
      const needed = every(i => {
        const from = subtract([p[i], p[i + 1], p[i + 2]], this.target);
        return dot(from, back) + Math.max(Math.abs(dot(from, right)) / this.aspect, Math.abs(dot(from, up))) / SLOPE;
      });
      this.distance = this.homeDistance = Math.max(this.room * quantile(needed, 0.995), 1e-6);
    }

    axes() {
      const cy = Math.cos(this.yaw), sy = Math.sin(this.yaw), cp = Math.cos(this.pitch), sp = Math.sin(this.pitch);
      const back = [sy * cp, sp, cy * cp], right = [cy, 0, -sy];
      return { right, up: cross(back, right), back };
    }

    eye() {
      const { back } = this.axes();
      return this.target.map((value, k) => value + this.distance * back[k]);
    }

    matrices() {
      const { right, up, back } = this.axes(), eye = this.eye(), view = new Float32Array(16);
      [right, up, back].forEach((row, r) => {
        row.forEach((value, c) => { view[4 * c + r] = value; });
        view[12 + r] = -dot(row, eye);
      });
      view[15] = 1;
      const near = this.distance / 100, far = this.distance * 100;
      const projection = new Float32Array([1 / SLOPE / this.aspect, 0, 0, 0, 0, 1 / SLOPE, 0, 0,
        0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0]);
      return { view, projection };
    }

    // Screen position of a point, px.
    project(point) {
      const { right, up, back } = this.axes(), from = subtract(point, this.eye()), depth = -dot(from, back) * SLOPE;
      return [(dot(from, right) / depth / this.aspect + 1) / 2 * this.width, (1 - dot(from, up) / depth) / 2 * this.height];
    }

    // Whether a point lies before the eye.
    sees(point) {
      return dot(subtract(point, this.eye()), this.axes().back) < 0;
    }

    // Direction from the eye through a screen position.
    ray(left, top) {
      const { right, up, back } = this.axes();
      const x = (2 * left / this.width - 1) * SLOPE * this.aspect, y = (1 - 2 * top / this.height) * SLOPE;
      return [0, 1, 2].map(k => x * right[k] + y * up[k] - back[k]);
    }

    orbit(dx, dy) {
      this.yaw -= dx * 0.006;
      this.pitch = Math.max(-1.55, Math.min(1.55, this.pitch + dy * 0.006));
    }

    pan(dx, dy) {
      const { right, up } = this.axes(), step = this.perPixel;
      this.target = this.target.map((value, k) => value - step * (dx * right[k] - dy * up[k]));
    }

    zoom(factor) {
      this.distance = Math.max(this.homeDistance / 200, Math.min(this.homeDistance * 20, this.distance * factor));
    }
  }

  return Camera;
})();
