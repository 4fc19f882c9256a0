// Between the flattened plane (metres) and the pane (CSS pixels); the pane may be turned for looking.

export class Transform {
  constructor() {
    this.scale = 1000; // CSS pixels per metre
    this.x = 0;
    this.y = 0;
    this.angle = 0; // radians, clockwise as seen
  }

  get axes() {
    const [cos, sin] = [this.scale * Math.cos(this.angle), this.scale * Math.sin(this.angle)];
    return { ux: cos, uy: sin, vx: -sin, vy: cos };
  }

  toPane(/** @type {number} */ u, /** @type {number} */ v) {
    const at = this.toPaneVector(u, v);
    return { x: this.x + at.x, y: this.y + at.y };
  }

  toPlane(/** @type {number} */ x, /** @type {number} */ y) {
    return this.toPlaneVector(x - this.x, y - this.y);
  }

  /** A step on the plane as a step in the pane. */
  toPaneVector(/** @type {number} */ u, /** @type {number} */ v) {
    const { ux, uy, vx, vy } = this.axes;
    return { x: ux * u + vx * v, y: uy * u + vy * v };
  }

  toPlaneVector(/** @type {number} */ x, /** @type {number} */ y) {
    const { ux, uy, vx, vy } = this.axes;
    const square = this.scale * this.scale;
    return { u: (ux * x + uy * y) / square, v: (vx * x + vy * y) / square };
  }

  /** Draw in metres of the plane from now on. */
  apply(/** @type {Context | OffscreenCanvasRenderingContext2D} */ context) {
    const { ux, uy, vx, vy } = this.axes;
    context.transform(ux, uy, vx, vy, this.x, this.y);
  }

  pan(/** @type {number} */ dx, /** @type {number} */ dy) {
    this.x += dx;
    this.y += dy;
  }

  /** Zoom and keep what is under (x, y) there. @param {number} factor @param {number} x @param {number} y */
  zoom(factor, x, y) {
    const scale = Math.min(200000, Math.max(50, this.scale * factor));
    this.x = x - ((x - this.x) * scale) / this.scale;
    this.y = y - ((y - this.y) * scale) / this.scale;
    this.scale = scale;
  }

  /** Turn to an angle, and keep what is under (x, y) there. @param {number} angle @param {number} x @param {number} y */
  turn(angle, x, y) {
    const { u, v } = this.toPlane(x, y);
    this.angle = angle;
    const moved = this.toPane(u, v);
    this.pan(x - moved.x, y - moved.y);
  }

  /**
   * Fit places of the plane into the pane, with a margin (CSS pixels).
   * @param {UV[]} places @param {number} width @param {number} height @param {number} margin
   */
  fit(places, width, height, margin) {
    this.scale = 1;
    const seen = places.map(([u, v]) => this.toPaneVector(u, v));
    const { left, right, top, bottom } = boxOfPoints(seen.flatMap(({ x, y }) => [x, y]));
    const [wide, high] = [Math.max(1e-6, right - left), Math.max(1e-6, bottom - top)];
    this.scale = Math.max(50, Math.min((width - 2 * margin) / wide, (height - 2 * margin) / high));
    this.x = width / 2 - (this.scale * (left + right)) / 2;
    this.y = height / 2 - (this.scale * (top + bottom)) / 2;
  }
}

/** A motion of the proposal, and another. @param {By} a @param {By} b @returns {By} */
export const sumOf = (a, b) => ({ theta: a.theta + b.theta, u: a.u + b.u, v: a.v + b.v });

/** The box of the plane that a raster covers; pixel centres have integer coordinates. */
export function boxOf(/** @type {Grid} */ grid) {
  const [u, v] = grid.origin_uv_m;
  const d = grid.pixel_size_m;
  return { left: u - d / 2, top: v - d / 2, right: u + (grid.cols - 0.5) * d, bottom: v + (grid.rows - 0.5) * d };
}

/**
 * The index of the pixel of a raster at a place of the plane; -1 outside of it.
 * @param {Grid} grid @param {number} u @param {number} v
 */
export function pixelAt(grid, u, v) {
  const col = Math.round((u - grid.origin_uv_m[0]) / grid.pixel_size_m);
  const row = Math.round((v - grid.origin_uv_m[1]) / grid.pixel_size_m);
  return col < 0 || row < 0 || col >= grid.cols || row >= grid.rows ? -1 : row * grid.cols + col;
}

/**
 * Places between which the opaque pixels of a raster lie: the first and the last of its rows.
 * @param {Grid} grid @param {Numbers} pixels four numbers each @returns {UV[]}
 */
export function rimOf({ rows, cols, origin_uv_m: [u, v], pixel_size_m: size }, pixels) {
  const rim = /** @type {UV[]} */ ([]);
  for (let row = 0; row < rows; row++) {
    let [first, last] = [0, cols - 1];
    const isClear = (/** @type {number} */ col) => pixels[4 * (row * cols + col) + 3] === 0;
    while (first < cols && isClear(first)) first++;
    while (last > first && isClear(last)) last--;
    if (first < cols) for (const col of [first, last]) rim.push([u + size * col, v + size * row]);
  }
  return rim;
}

/** The corners of a box, in turn. @returns {UV[]} */
export const cornersOf = (/** @type {Box} */ { left, top, right, bottom }) => [
  [left, top],
  [right, top],
  [right, bottom],
  [left, bottom],
];

/** A point of the plane moved by a rigid motion: turn (radians), then u and v (metres). @returns {UV} */
export function applied(/** @type {Motion} */ [theta, du, dv], /** @type {number} */ u, /** @type {number} */ v) {
  const [cos, sin] = [Math.cos(theta), Math.sin(theta)];
  return [cos * u - sin * v + du, sin * u + cos * v + dv];
}

/** A point moved back by a rigid motion. @returns {UV} */
export function unapplied(/** @type {Motion} */ [theta, du, dv], /** @type {number} */ u, /** @type {number} */ v) {
  const [cos, sin] = [Math.cos(theta), Math.sin(theta)];
  return [cos * (u - du) + sin * (v - dv), -sin * (u - du) + cos * (v - dv)];
}

/** @param {Box} a @param {Box} b */
export const contains = (a, b) => a.left <= b.left && a.top <= b.top && a.right >= b.right && a.bottom >= b.bottom;

/** @type {(box: Box, u: number, v: number) => boolean} */
export const inBox = ({ left, top, right, bottom }, u, v) => u >= left && u <= right && v >= top && v <= bottom;

export const grown = (/** @type {Box} */ box, /** @type {number} */ by) => ({
  left: box.left - by,
  top: box.top - by,
  right: box.right + by,
  bottom: box.bottom + by,
});

/** The box of points [x0, y0, x1, y1, ...]. */
export function boxOfPoints(/** @type {Numbers} */ points) {
  const box = { left: Infinity, top: Infinity, right: -Infinity, bottom: -Infinity };
  for (let i = 0; i < points.length; i += 2) {
    box.left = Math.min(box.left, points[i]);
    box.right = Math.max(box.right, points[i]);
    box.top = Math.min(box.top, points[i + 1]);
    box.bottom = Math.max(box.bottom, points[i + 1]);
  }
  return box;
}

/** The box of a box that was moved. @param {Box} box @param {Motion} motion */
export const movedBox = (box, motion) => boxOfPoints(cornersOf(box).flatMap(([u, v]) => applied(motion, u, v)));

/** The box around two. @param {Box} a @param {Box} b */
export const union = (a, b) => boxOfPoints([a, b].flatMap(cornersOf).flat());

/**
 * The part of an image that is seen of a box, zoomed in about a pixel; it stays within the box.
 * @param {ItemBox} box @param {{ factor: number; row: number; col: number }} zoom @returns {ItemBox}
 */
export function zoomedBox({ top, left, width, height }, { factor, row, col }) {
  const [wide, high] = [width / factor, height / factor];
  const kept = (/** @type {number} */ value, /** @type {number} */ most) => Math.min(most, Math.max(0, value));
  return {
    top: top + kept(row - high / 2 - top, height - high),
    left: left + kept(col - wide / 2 - left, width - wide),
    width: wide,
    height: high,
  };
}

/**
 * The ends of a line through pixels.
 * @param {{ pixels_uv_m: number[][]; center_uv_m: number[]; direction: number[] }} line @returns {UV[]}
 */
export function endsOf({ pixels_uv_m: pixels, center_uv_m: [cu, cv], direction: [du, dv] }) {
  const along = pixels.map(([u, v]) => (u - cu) * du + (v - cv) * dv);
  return [Math.min(...along), Math.max(...along)].map((t) => [cu + t * du, cv + t * dv]);
}

export const dot = (/** @type {Numbers} */ a, /** @type {Numbers} */ b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** @param {number[]} a @param {number[]} b */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

export const unit = (/** @type {number[]} */ v) => v.map((x) => x / (Math.hypot(...v) || 1));

/**
 * The thing nearest to a point, of those with a place within so many pixels; null: none.
 * @template T
 * @param {Iterable<T>} things @param {(thing: T) => Iterable<Point>} placesOf @param {Point} point
 * @param {number} within
 * @returns {T | null}
 */
export function nearest(things, placesOf, { x, y }, within) {
  let best = /** @type {T | null} */ (null);
  let least = within;
  for (const thing of things)
    for (const at of placesOf(thing)) {
      const off = Math.hypot(at.x - x, at.y - y);
      if (off < least) [best, least] = [thing, off];
    }
  return best;
}
