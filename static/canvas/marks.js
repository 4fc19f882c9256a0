// What is marked on the flattened view: picks, the gripper of the current one, the scale bar.

import { length, niceLength } from "../page/format.js";

/** @param {FlatCanvas} canvas @param {{ uv_m: UV }} mark @param {Style} style */
export function drawMark(canvas, mark, style) {
  drawDot(canvas.context, canvas.transform.toPane(...mark.uv_m), style.getPropertyValue("--pick"), 4);
}

/**
 * Stroke what `path` traces, in a colour and with a rim, so that it is seen on any cloth.
 * @param {Context} context @param {string} color @param {number} width @param {() => void} path
 */
export function strokeRimmed(context, color, width, path, rim = "#fff", rimWidth = 2) {
  context.beginPath();
  path();
  context.strokeStyle = rim;
  context.lineWidth = width + rimWidth;
  context.stroke();
  context.strokeStyle = color;
  context.lineWidth = width;
  context.stroke();
}

/**
 * A ring that is seen on any cloth.
 * @param {Context} context @param {Point} parts @param {string} color @param {number} radius
 */
export const drawRing = (context, { x, y }, color, radius) =>
  strokeRimmed(context, color, 2, () => context.arc(x, y, radius, 0, 2 * Math.PI));

/**
 * The arms of a cross: between two distances from its middle.
 * @param {Context} context @param {number} x @param {number} y @param {number} from @param {number} to
 */
export function traceCross(context, x, y, from, to) {
  for (const side of [-1, 1]) {
    context.moveTo(x + side * from, y);
    context.lineTo(x + side * to, y);
    context.moveTo(x, y + side * from);
    context.lineTo(x, y + side * to);
  }
}

/**
 * A text on a plate: `box` is left, top, width and height of the plate.
 * @param {Context} context @param {Style} style @param {string} text @param {UV} parts
 * @param {[number, number, number, number]} box
 */
export function drawLabel(context, style, text, [x, y], box, { color = "--text", alpha = 1 } = {}) {
  context.globalAlpha = alpha;
  context.fillStyle = style.getPropertyValue("--panel");
  context.fillRect(...box);
  context.globalAlpha = 1;
  context.fillStyle = style.getPropertyValue(color);
  context.fillText(text, x, y);
}

/**
 * A dot that is seen on any cloth.
 * @param {Context} context @param {Point} parts @param {string} color @param {number} radius
 */
export function drawDot(context, { x, y }, color, radius, rim = 1.5) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fillStyle = color;
  context.strokeStyle = "#fff";
  context.lineWidth = rim;
  context.fill();
  context.stroke();
}

/** @param {FlatCanvas} canvas @param {{ uv_m: UV; grip?: CurrentPick["grip"] }} pick @param {Style} style */
export function drawPick(canvas, pick, style) {
  const { x, y } = canvas.transform.toPane(...pick.uv_m);
  const context = canvas.context;
  strokeRimmed(context, style.getPropertyValue("--pick"), 2, () => {
    context.arc(x, y, 9, 0, 2 * Math.PI);
    traceCross(context, x, y, 5, 14);
  });
  if (pick.grip?.axis_uv) drawGrip(canvas, x, y, pick.grip, style);
}

/**
 * The gripper's axis as a line through the pick, its fingers as bars on both sides of it.
 * @param {FlatCanvas} canvas @param {number} x @param {number} y @param {NonNullable<CurrentPick["grip"]>} grip
 * @param {Style} style
 */
function drawGrip(canvas, x, y, grip, style) {
  const context = canvas.context;
  const { scale } = canvas.transform;
  const along = canvas.transform.toPaneVector(.../** @type {UV} */ (grip.axis_uv));
  const [du, dv] = [along.x / scale, along.y / scale];
  const half = (grip.opening_m / 2) * scale;
  strokeRimmed(context, style.getPropertyValue("--pick"), 2.5, () => {
    for (const side of [-1, 1]) {
      context.moveTo(x + 15 * side * du, y + 15 * side * dv);
      context.lineTo(x + 30 * side * du, y + 30 * side * dv);
      const [fx, fy] = [x - side * half * dv, y + side * half * du];
      context.moveTo(fx - 8 * du, fy - 8 * dv);
      context.lineTo(fx + 8 * du, fy + 8 * dv);
    }
  });
}

export function drawScale(/** @type {FlatCanvas} */ canvas, /** @type {Style} */ style) {
  const context = canvas.context;
  const mm = niceLength((1000 * Math.min(150, 0.3 * canvas.width)) / canvas.transform.scale);
  const width = (mm / 1000) * canvas.transform.scale;
  const x = 14;
  const y = canvas.height - 16;
  context.font = "12px system-ui, sans-serif";
  context.textBaseline = "bottom";
  const label = length(mm);
  const wide = Math.max(width, context.measureText(label).width) + 16;
  drawLabel(context, style, label, [x + 4, y - 4], [x - 8, y - 24, wide, 34], { alpha: 0.85 });
  strokeScale(context, x, y, width, style.getPropertyValue("--text"));
}

/**
 * The bar of a scale, its ends turned up.
 * @param {Context} context @param {number} x @param {number} y @param {number} width @param {string} color
 */
export function strokeScale(context, x, y, width, color) {
  const ends = [x, x + width].map((end) => [
    { x: end, y: y - 5 },
    { x: end, y },
  ]);
  strokeLine(context, [...ends[0], ...ends[1].reverse()], color, 1.5);
}

/**
 * A closed line around places of the plane; a white rim, so much wider, lets it be seen on any cloth.
 * @param {FlatCanvas} canvas @param {UV[]} loop @param {string} color @param {number} width
 */
export function strokeLoop(
  { context, transform },
  loop,
  color,
  width,
  { rim = 0, dash = /** @type {number[]} */ ([]) },
) {
  if (!loop.length) return;
  const line = [...loop, loop[0]].map(([u, v]) => transform.toPane(u, v));
  if (rim) strokeLine(context, line, "#fff", width + rim, dash);
  strokeLine(context, line, color, width, dash);
}

/**
 * Seams of a list at their places in the pane: small, those that are doubted in another colour; the chosen one large.
 * @param {Context} context @param {Style} style @param {{ at: Point[]; doubted: boolean }[]} seams
 * @param {number | null} chosen @param {boolean} alone the chosen one only
 */
export function drawSeams(context, style, seams, chosen, alone) {
  seams.forEach(({ at, doubted }, n) => {
    context.fillStyle = style.getPropertyValue(doubted ? "--warn" : "--seam");
    if (n !== chosen && !alone) for (const { x, y } of at) context.fillRect(x - 2, y - 2, 4, 4);
  });
  const large = chosen === null ? [] : seams[chosen].at;
  for (const at of large) drawDot(context, at, style.getPropertyValue("--accent"), 3.5);
}

/**
 * Points of the chosen seam in the scene.
 * @param {Context} context @param {Style} style @param {XYZ[]} points @param {PlaceInScene} place
 */
export function drawSeamInScene(context, style, points, place) {
  for (const at of points.map(place)) if (at) drawDot(context, at, style.getPropertyValue("--accent"), 3);
}

/**
 * A line through points of the pane.
 * @param {Context} context @param {Point[]} points @param {string} color @param {number} width
 * @param {number[]} dash
 */
export function strokeLine(context, points, color, width, dash = []) {
  context.setLineDash(dash);
  context.strokeStyle = color;
  context.lineWidth = width;
  context.beginPath();
  points.forEach((p, i) => (i ? context.lineTo(p.x, p.y) : context.moveTo(p.x, p.y)));
  context.stroke();
  context.setLineDash([]);
}
