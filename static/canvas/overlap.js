// How much cloth comes to lie on the shape where it is moved by hand: that decides whether it joins.

import { applied, boxOf, inBox } from "./geometry.js";
import { number } from "../page/format.js";

const SAMPLE_M = 0.004; // between places at which an overlap is looked for
const LEAST_CM2 = 2; // so much joins in any case: it holds two pairs of places, as shape/pieces.py wants

/**
 * The cloth (cm²) of a `picture` within a `box` that lies on the shape if it is `moved`.
 * @param {Page} page @param {FlatCanvas["layer"]} picture @param {Box} box
 * @param {(u: number, v: number) => UV} moved
 */
const overlapOf = (page, picture, box, moved) => {
  const isOfShape = shapeOf(page);
  return areaWhere(box, (u, v) => picture.covers(u, v) && isOfShape(...moved(u, v)));
};

/** What tells whether a place is cloth of the shape, not of the pieces beside it. @param {Page} page */
export function shapeOf({ state, canvas }) {
  const boxes = (state.layers?.pieces ?? []).filter((one) => !one.placed).map((one) => boxOf(one.grid));
  return (/** @type {number} */ u, /** @type {number} */ v) =>
    canvas.layer.covers(u, v) && !boxes.some((box) => inBox(box, u, v));
}

/** Area (cm²) of the places of a box that a test holds for. @param {Box} box @param {(...uv: UV) => boolean} test */
export function areaWhere({ left, top, right, bottom }, test) {
  let n = 0;
  for (let u = left; u < right; u += SAMPLE_M) for (let v = top; v < bottom; v += SAMPLE_M) n += Number(test(u, v));
  return n * (100 * SAMPLE_M) ** 2;
}

/** That of a floating piece. @param {Page} page @param {Piece} piece @param {UV} by */
export const overlapOfPiece = (page, { grid }, [du, dv]) =>
  overlapOf(page, page.canvas.layer, boxOf(grid), (u, v) => [u + du, v + dv]);

/** That of the proposal where it is, or is being moved to; null: it is not drawn. @param {Page} page */
export function overlapOfProposal(page) {
  const { overlay, preview, center } = page.canvas;
  if (!overlay.shown) return null;
  const to = /** @type {Motion} */ ([preview.theta, center[0] + preview.u, center[1] + preview.v]);
  return overlapOf(page, overlay, overlay.shown.box, (u, v) => applied(to, u - center[0], v - center[1]));
}

export const joinsBy = (/** @type {number} */ cm2) => cm2 >= LEAST_CM2;

/** What an overlap means. @param {number} cm2 */
export const joiningText = (cm2) =>
  cm2 === 0
    ? "does not touch the shape: does not join"
    : joinsBy(cm2)
      ? `${number(cm2, 0)} cm² on the shape: joins`
      : `${number(cm2, 1)} of ${LEAST_CM2} cm² on the shape: does not join yet`;
