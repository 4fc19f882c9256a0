// The outline of a garment and its named points on a flattened view.

import { drawDot, drawLabel, drawRing, strokeLoop } from "../canvas/marks.js";

/** A name of the files as words. */
export const words = (/** @type {string} */ name) => name.replaceAll("_", " ");

/**
 * `found` has `outline_uv_m` and `points`; the one that is `pointed` at (its name) is large, and named.
 * @param {FlatCanvas} canvas @param {Context} context @param {Style} style
 * @param {{ outline_uv_m: UV[]; points: GarmentPoint[] }} found
 * @param {string | null} pointed
 */
export function drawGarment(canvas, context, style, found, pointed) {
  const { transform } = canvas;
  const color = style.getPropertyValue("--garment");
  strokeLoop(canvas, found.outline_uv_m, color, 2, { rim: 2 });
  for (const point of found.points) {
    const at = transform.toPane(...point.uv_m);
    const on = point.name === pointed;
    // A predicted point is hollow, so that it differs without colours, too.
    if (point.seen || point.held) drawDot(context, at, color, on ? 8 : 5);
    else drawRing(context, at, color, on ? 8 : 5);
    if (point.held) drawRing(context, at, color, on ? 12 : 9);
    if (on) drawName(context, style, at, point.name);
  }
}

/** @param {Context} context @param {Style} style @param {Point} parts @param {string} name */
export function drawName(context, style, { x, y }, name) {
  const text = words(name);
  context.font = "600 12px system-ui, sans-serif";
  context.textBaseline = "middle";
  drawLabel(context, style, text, [x + 17, y], [x + 12, y - 9, context.measureText(text).width + 10, 18]);
}
