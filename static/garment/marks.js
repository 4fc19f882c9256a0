// The outline of a garment and its named points on a flattened view.

import { drawDot, strokeLine } from "/static/canvas/marks.js";

/** A name of the files as words. */
export const words = (name) => name.replaceAll("_", " ");

/** `found` has `outline_uv_m` and `points`; the one that is `pointed` at (its name) is large, and named. */
export function drawGarment(canvas, context, style, found, pointed) {
  const { transform } = canvas;
  const line = found.outline_uv_m.map((uv) => transform.toPane(...uv));
  if (line.length) line.push(line[0]);
  const color = style.getPropertyValue("--garment");
  strokeLine(context, line, "#fff", 4);
  strokeLine(context, line, color, 2);
  for (const point of found.points) {
    const at = transform.toPane(...point.uv_m);
    const on = point.name === pointed;
    if (point.seen || point.held) drawDot(context, at, color, on ? 8 : 5);
    else drawRing(context, at, color, on ? 8 : 5);
    if (point.held) drawRing(context, at, color, on ? 12 : 9);
    if (on) drawName(context, style, at, point.name);
  }
}

/** A predicted point: hollow, so that it is told apart without colours. */
function drawRing(context, { x, y }, color, radius) {
  for (const [stroke, width] of [
    ["#fff", 4],
    [color, 2],
  ]) {
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.strokeStyle = stroke;
    context.lineWidth = width;
    context.stroke();
  }
}

export function drawName(context, style, { x, y }, name) {
  const text = words(name);
  context.font = "600 12px system-ui, sans-serif";
  context.textBaseline = "middle";
  const width = context.measureText(text).width + 10;
  context.fillStyle = style.getPropertyValue("--panel");
  context.fillRect(x + 12, y - 9, width, 18);
  context.fillStyle = style.getPropertyValue("--text");
  context.fillText(text, x + 17, y);
}
