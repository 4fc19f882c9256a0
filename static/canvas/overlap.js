// How cloth fits where it is moved by hand: what lies on the shape, which decides whether it joins; and how pairs,
// gap and colours across a joint do.

import { applied, boxOf, boxOfPoints, inBox, unapplied } from "./geometry.js";
import { WAYS } from "../page/dom.js";
import { cm2, number } from "../page/format.js";

const SAMPLE_M = 0.004; // between places at which an overlap is looked for
const LEAST_CM2 = 2; // so much joins in any case: it holds two pairs of places, as shape/pieces.py wants
const STEP_M = 0.002; // at which gaps are looked for
const ACROSS_M = 0.004; // from the outline of a part to the cloth that is compared on either side

/** @typedef {(u: number, v: number) => boolean} Covers whether there is cloth at a place */

/** What tells whether a place is cloth of the shape, not of the pieces beside it. @param {Page} page @returns {Covers} */
export function shapeOf({ state, canvas }) {
  const boxes = (state.layers?.pieces ?? []).filter((one) => !one.placed).map((one) => boxOf(one.grid));
  return (u, v) => canvas.layer.covers(u, v) && !boxes.some((box) => inBox(box, u, v));
}

/** Area (cm²) of the places of a box that a test holds for. @param {Box} box @param {Covers} test */
function areaWhere({ left, top, right, bottom }, test) {
  let n = 0;
  for (let u = left; u < right; u += SAMPLE_M) for (let v = top; v < bottom; v += SAMPLE_M) n += Number(test(u, v));
  return n * (100 * SAMPLE_M) ** 2;
}

/**
 * The cloth (cm²) within outlines that lies on other cloth if it is moved by so much.
 * @param {{ outline_uv_m: UV[][] }} part @param {Motion} by @param {Covers} own @param {Covers} other
 */
export const overlapAt = (part, by, own, other) =>
  areaWhere(
    boxOfPoints(part.outline_uv_m.flat(2)),
    (u, v) => holds(part, u, v) && own(u, v) && other(...applied(by, u, v)),
  );

/** That of the proposal where it is, or is being moved to; null: it is not drawn. @param {Page} page */
export function overlapOfProposal(page) {
  const { overlay, motion } = page.canvas;
  const isOfShape = shapeOf(page);
  if (!overlay.shown) return null;
  return areaWhere(overlay.shown.box, (u, v) => overlay.covers(u, v) && isOfShape(...applied(motion, u, v)));
}

export const joinsBy = (/** @type {number} */ cm2) => cm2 >= LEAST_CM2;

/** What an overlap means. @param {number} cm2 */
export const joiningText = (cm2) =>
  cm2 === 0
    ? "does not touch the shape: does not join"
    : joinsBy(cm2)
      ? `${number(cm2, 0)} cm² on the shape: joins`
      : `${number(cm2, 1)} of ${LEAST_CM2} cm² on the shape: does not join yet`;

/**
 * How a part fits, moved by so much: what the pairs across its joint are off, the widest gap between their ends, and
 * how much of it lies on other cloth; `colorAt` tells the colours: then also by how much they differ across its outline.
 * @param {Doubt} joint @param {Motion} by @param {Covers} covers
 * @param {((u: number, v: number) => Numbers) | null} colorAt
 */
export function fitOf(joint, by, covers, colorAt) {
  const isPart = (/** @type {UV} */ [u, v]) => holds(joint, u, v) && covers(u, v);
  const isRest = (/** @type {number} */ u, /** @type {number} */ v) => covers(u, v) && !holds(joint, u, v);
  let gap = 0;
  for (const [own, [u, v]] of joint.ends_uv_m) {
    const [s, t] = applied(by, ...own);
    const steps = Math.ceil(Math.hypot(u - s, v - t) / STEP_M);
    let free = 0;
    for (let n = 1; n < steps; n++) {
      const [x, y] = [s + ((u - s) * n) / steps, t + ((v - t) * n) / steps];
      free += Number(!isRest(x, y) && !isPart(unapplied(by, x, y)));
    }
    gap = Math.max(gap, free * STEP_M);
  }
  const overlap = cm2(overlapAt(joint, by, covers, isRest));
  const texture = colorAt && textureOf(joint, by, isPart, isRest, colorAt);
  const apart = texture === null ? "" : `colours ${number((100 * texture) / 255, 0)} % apart, `;
  return `Pairs ${number(offOf(joint, by))} mm off, gap ${number(1000 * gap, 0)} mm, ${apart}${overlap} on other cloth`;
}

/**
 * Mean difference of the colours on both sides of a part's outline, where it meets other cloth; null: nowhere.
 * @param {Doubt} joint @param {Motion} by @param {(uv: UV) => boolean} isPart
 * @param {Covers} isRest @param {(u: number, v: number) => Numbers} colorAt
 */
function textureOf({ outline_uv_m }, by, isPart, isRest, colorAt) {
  let [sum, n] = [0, 0];
  for (const [u, v] of outline_uv_m.flat())
    for (const [right, down] of Object.values(WAYS)) {
      const inner = /** @type {UV} */ ([u - ACROSS_M * right, v - ACROSS_M * down]);
      const outer = applied(by, u + ACROSS_M * right, v + ACROSS_M * down);
      if (!isPart(inner) || !isRest(...outer)) continue;
      const [own, other] = [colorAt(...inner), colorAt(...outer)];
      for (let i = 0; i < 3; i++) sum += Math.abs(own[i] - other[i]) / 3;
      n += 1;
    }
  return n ? sum / n : null;
}

/** Median of what the distances of pairs are off their lengths (mm). @param {Doubt} joint @param {Motion} by */
function offOf({ ends_uv_m, length_m }, by) {
  const off = ends_uv_m.map(([own, [u, v]], n) => {
    const [s, t] = applied(by, ...own);
    return 1000 * Math.abs(Math.hypot(u - s, v - t) - length_m[n]);
  });
  return off.sort((a, b) => a - b)[off.length >> 1] ?? 0;
}

/** Whether outlines hold a place: an odd number of their edges is crossed on the way out. */
/** @type {(part: { outline_uv_m: UV[][] }, u: number, v: number) => boolean} */
export const holds = ({ outline_uv_m }, u, v) => {
  let inside = false;
  for (const loop of outline_uv_m)
    loop.forEach(([u1, v1], n) => {
      const [u0, v0] = loop[(n + loop.length - 1) % loop.length];
      if (v0 > v !== v1 > v && u < u0 + ((v - v0) / (v1 - v0)) * (u1 - u0)) inside = !inside;
    });
  return inside;
};
