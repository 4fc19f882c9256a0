// The pairs of cloth that fixed a proposal's place: what they say, and lines on the canvas and in 3D.

import { nearest } from "../canvas/geometry.js";
import { drawDot, strokeLine } from "../canvas/marks.js";
import { count, number } from "../page/format.js";

const STRETCH = 10; // lines on the canvas are drawn so many times as long: a millimetre would not be seen
const NEAR_PX = 14;
const COLORS = ["#2c7bb6", "#e67e00", "#b3261e"]; // below a third of the limit, below the limit, beyond it

export class ClothPairs {
  constructor(/** @type {FlatCanvas} */ canvas) {
    this.canvas = canvas;
    this.pairs = /** @type {Pairs | null} */ (null); // none before the first proposal, or if curves placed it
    this.marked = /** @type {number | null} */ (null); // number of a pair
  }

  /** What the pairs say, in a line. */
  get facts() {
    if (!this.pairs) return "";
    const { total, median_mm, nine_tenths_mm, beyond_share, limit_mm, apart_median_mm } = this.pairs;
    return (
      `${count(total, "pair")} of points that are the same cloth in the shape and in the proposal. ` +
      `Distance on the plane: median ${number(median_mm)} mm, 90 % within ${number(nine_tenths_mm)} mm, ` +
      `${number(100 * beyond_share, 0)} % over the limit of ${number(limit_mm, 0)} mm. ` +
      `Distance in space: median ${number(apart_median_mm)} mm. ` +
      `The lines on the canvas are drawn ${STRETCH} times as long, so that they can be seen.`
    );
  }

  textOf(/** @type {number | null} */ n) {
    if (n === null || !this.pairs) return "";
    const { residual_mm: off, apart_mm: apart } = this.pairs;
    return `This pair: ${number(off[n])} mm apart on the plane, ${number(apart[n])} mm in space.`;
  }

  // --- on the canvas and in 3D -------------------------------------------------------------------

  /** The pair at a place of the plane, null if none is near. */
  nearest(/** @type {Place | null} */ at) {
    if (!at || !this.pairs) return null;
    const { transform } = this.canvas;
    const { shape_uv_m: places } = this.pairs;
    const placesOf = (/** @type {number} */ n) => [transform.toPane(...places[n])];
    return nearest(places.keys(), placesOf, transform.toPane(at.u_m, at.v_m), NEAR_PX);
  }

  paint(/** @type {Context} */ context) {
    const { shape_uv_m: from, placed_uv_m: to } = this.pairs ?? { shape_uv_m: [], placed_uv_m: [] };
    from.forEach((uv, n) => {
      const [u, v] = uv.map((value, i) => value + STRETCH * (to[n][i] - value));
      this.paintPair(context, n, this.canvas.transform.toPane(...uv), this.canvas.transform.toPane(u, v), 1.25);
    });
  }

  paintInSpace(/** @type {Context} */ context, /** @type {PlaceInScene} */ place) {
    const { shape_xyz_m: from, new_xyz_m: to } = this.pairs ?? { shape_xyz_m: [], new_xyz_m: [] };
    from.forEach((point, n) => this.paintPair(context, n, place(point), place(to[n]), 1.5));
  }

  /**
   * @param {Context} context @param {number} n @param {Point | null} a @param {Point | null} b
   * @param {number} width
   */
  paintPair(context, n, a, b, width) {
    if (!a || !b || !this.pairs) return;
    const color = colorAt(this.pairs.residual_mm[n], this.pairs.limit_mm);
    const on = n === this.marked;
    strokeLine(context, [a, b], color, on ? 3 : width);
    if (on) return drawDot(context, a, color, 6);
    context.fillStyle = color;
    context.fillRect(a.x - 1, a.y - 1, 2.5, 2.5);
  }
}

/** @param {number} mm @param {number | null} limit */
const colorAt = (mm, limit) => COLORS[limit === null || mm <= limit / 3 ? 0 : mm <= limit ? 1 : 2];
