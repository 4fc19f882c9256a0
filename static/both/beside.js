// Both sides beside one another: where the other one lies on the canvas, and which side a place belongs to.

import { applied, boxOfPoints, unapplied } from "../canvas/geometry.js";
import { Picture } from "../canvas/picture.js";

const GAP_M = 0.06;

export class Beside {
  constructor(/** @type {FlatCanvas} */ canvas) {
    this.canvas = canvas;
    this.picture = new Picture(() => canvas.refit());
    this.wanted = false;
  }

  /** Show the other side beside this one, or not. */
  update(/** @type {State} */ { other }, /** @type {string} */ layer) {
    const layers = this.wanted && this.canvas.side === "this" ? other?.layers : null;
    if (layers) this.picture.show(`other/${layers.revision}/${layer}.png`, layers.revision, layers, false);
    else this.picture.clear();
  }

  /**
   * Its motion on the canvas, so that it lies at the right of this side, as an opened book does: also where the
   * display is turned. Null: it is not shown.
   * @returns {Motion | null}
   */
  get motion() {
    const [own, its] = [this.canvas.layer.shown, this.picture.shown];
    if (!own || !its) return null;
    const { angle } = this.canvas.transform;
    const turned = (/** @type {UV[]} */ rim, /** @type {number} */ by) =>
      boxOfPoints(rim.flatMap(([u, v]) => applied([by, 0, 0], u, v)));
    const here = turned(this.canvas.layer.rim, angle);
    const there = turned(this.picture.rim, -angle);
    const shift = here.right + GAP_M - there.left;
    return [-2 * angle, Math.cos(angle) * shift, -Math.sin(angle) * shift];
  }

  /** Places of the canvas's plane that it lies between. */
  get rim() {
    const { motion } = this;
    return motion ? this.picture.rim.map(([u, v]) => applied(motion, u, v)) : [];
  }

  /** The place of the other side at a place of the canvas; null: that is not on it. @returns {UV | null} */
  at(/** @type {number} */ u, /** @type {number} */ v) {
    const { motion } = this;
    const box = this.picture.shown?.box;
    if (!motion || !box) return null;
    const [a, b] = unapplied(motion, u, v);
    return a >= box.left && a <= box.right && b >= box.top && b <= box.bottom ? [a, b] : null;
  }

  /** Where a place of the other side is on the canvas. @returns {UV | null} */
  shown(/** @type {UV} */ [u, v]) {
    const { motion } = this;
    return motion && applied(motion, u, v);
  }

  paint() {
    const { motion } = this;
    const its = this.picture.shown;
    if (motion && its) this.canvas.drawPicture(its, its.image, false, motion);
  }
}
