// Between the flattened plane (metres) and the pane (CSS pixels); the pane may be turned and flipped for looking.

export class Transform {
  constructor() {
    this.scale = 1000; // CSS pixels per metre
    this.x = 0;
    this.y = 0;
    this.angle = 0; // radians, clockwise as seen
    this.flipped = false; // left and right exchanged, before the turn
  }

  get axes() {
    const [cos, sin] = [this.scale * Math.cos(this.angle), this.scale * Math.sin(this.angle)];
    const side = this.flipped ? -1 : 1;
    return { ux: side * cos, uy: side * sin, vx: -sin, vy: cos };
  }

  toPane(u, v) {
    const at = this.toPaneVector(u, v);
    return { x: this.x + at.x, y: this.y + at.y };
  }

  toPlane(x, y) {
    return this.toPlaneVector(x - this.x, y - this.y);
  }

  /** A step on the plane as a step in the pane. */
  toPaneVector(u, v) {
    const { ux, uy, vx, vy } = this.axes;
    return { x: ux * u + vx * v, y: uy * u + vy * v };
  }

  toPlaneVector(x, y) {
    const { ux, uy, vx, vy } = this.axes;
    const square = this.scale * this.scale;
    return { u: (ux * x + uy * y) / square, v: (vx * x + vy * y) / square };
  }

  /** Draw in metres of the plane from now on. */
  apply(context) {
    const { ux, uy, vx, vy } = this.axes;
    context.transform(ux, uy, vx, vy, this.x, this.y);
  }

  pan(dx, dy) {
    this.x += dx;
    this.y += dy;
  }

  /** Zoom and keep what is under (x, y) there. */
  zoom(factor, x, y) {
    const scale = Math.min(200000, Math.max(50, this.scale * factor));
    this.x = x - ((x - this.x) * scale) / this.scale;
    this.y = y - ((y - this.y) * scale) / this.scale;
    this.scale = scale;
  }

  /** Turn and flip to these, and keep what is under (x, y) there. */
  turn(angle, flipped, x, y) {
    const { u, v } = this.toPlane(x, y);
    this.angle = angle;
    this.flipped = flipped;
    const moved = this.toPane(u, v);
    this.pan(x - moved.x, y - moved.y);
  }

  /** Fit a box of the plane into the pane, with a margin (CSS pixels). */
  fit(box, width, height, margin) {
    const [across, down] = [box.right - box.left, box.bottom - box.top];
    const [cos, sin] = [Math.abs(Math.cos(this.angle)), Math.abs(Math.sin(this.angle))];
    const wide = Math.max(1e-6, cos * across + sin * down);
    const high = Math.max(1e-6, sin * across + cos * down);
    this.scale = Math.max(50, Math.min((width - 2 * margin) / wide, (height - 2 * margin) / high));
    const middle = this.toPaneVector((box.left + box.right) / 2, (box.top + box.bottom) / 2);
    this.x = width / 2 - middle.x;
    this.y = height / 2 - middle.y;
  }
}

/** The box of the plane that a raster covers; pixel centres have integer coordinates. */
export function boxOf(grid) {
  const [u, v] = grid.origin_uv_m;
  const d = grid.pixel_size_m;
  return { left: u - d / 2, top: v - d / 2, right: u + (grid.cols - 0.5) * d, bottom: v + (grid.rows - 0.5) * d };
}

/** The corners of a box, in turn. */
export const cornersOf = ({ left, top, right, bottom }) => [
  [left, top],
  [right, top],
  [right, bottom],
  [left, bottom],
];

/** A point of the plane moved by a rigid motion: turn (radians), then u and v (metres). */
export function applied([theta, du, dv], u, v) {
  const [cos, sin] = [Math.cos(theta), Math.sin(theta)];
  return [cos * u - sin * v + du, sin * u + cos * v + dv];
}

/** A point moved back by a rigid motion. */
export function unapplied([theta, du, dv], u, v) {
  const [cos, sin] = [Math.cos(theta), Math.sin(theta)];
  return [cos * (u - du) + sin * (v - dv), -sin * (u - du) + cos * (v - dv)];
}

export const contains = (a, b) => a.left <= b.left && a.top <= b.top && a.right >= b.right && a.bottom >= b.bottom;

export const grown = (box, by) => ({
  left: box.left - by,
  top: box.top - by,
  right: box.right + by,
  bottom: box.bottom + by,
});

export function union(a, b) {
  if (!a || !b) return a ?? b;
  return {
    left: Math.min(a.left, b.left),
    top: Math.min(a.top, b.top),
    right: Math.max(a.right, b.right),
    bottom: Math.max(a.bottom, b.bottom),
  };
}
