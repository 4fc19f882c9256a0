// The outline of a garment and its named points on a flattened view.

import { WAYS } from "../page/dom.js";

const STEP_M = 0.006; // along the outline
const NEAR_M = 0.012; // from it to cloth
const AROUND = [[0, 0], ...Object.values(WAYS)];

/** A name of the files as words. */
export const words = (/** @type {string} */ name) => name.replaceAll("_", " ");

/**
 * `found` has `outline_uv_m` and `points`; the one that is `pointed` at (its name) is large, and named.
 * @param {FlatCanvas} canvas @param {{ outline_uv_m: UV[]; points: GarmentPoint[] }} found
 * @param {string | null} pointed
 */
export function drawGarment(canvas, found, pointed) {
  const { pen, context } = canvas;
  const color = "--garment";
  context.globalAlpha = 0.5;
  pen.loop(found.outline_uv_m, color, 1.5, { dash: [5, 5] });
  context.globalAlpha = 1;
  pen.rimmed(color, 2, () => traceSeen(canvas, found.outline_uv_m));
  for (const point of found.points) {
    const at = pen.at(point.uv_m);
    const on = point.name === pointed;
    // A predicted point is hollow, so that it differs without colours, too.
    if (point.seen || point.held) pen.dot(at, color, on ? 8 : 5);
    else pen.ring(at, color, on ? 8 : 5);
    if (point.held) pen.ring(at, color, on ? 12 : 9);
    if (on) pen.label(words(point.name), { x: at.x + 12, y: at.y });
  }
}

/** The parts of an outline that run along cloth: the others are foretold. */
function traceSeen(/** @type {FlatCanvas} */ canvas, /** @type {UV[]} */ outline) {
  const { pen, context } = canvas;
  const isSeen = (/** @type {number} */ u, /** @type {number} */ v) =>
    AROUND.some(([right, down]) => canvas.layer.covers(u + NEAR_M * right, v + NEAR_M * down));
  outline.forEach(([u, v], i) => {
    const [nextU, nextV] = outline[(i + 1) % outline.length];
    const n = Math.ceil(Math.hypot(nextU - u, nextV - v) / STEP_M);
    for (let k = 0; k < n; k++) {
      const at = (/** @type {number} */ x) =>
        /** @type {UV} */ ([u + (x / n) * (nextU - u), v + (x / n) * (nextV - v)]);
      if (!isSeen(...at(k + 0.5))) continue;
      const [from, to] = [k, k + 1].map((x) => pen.at(at(x)));
      context.moveTo(from.x, from.y);
      context.lineTo(to.x, to.y);
    }
  });
}
