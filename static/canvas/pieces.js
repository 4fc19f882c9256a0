// The floating pieces on the flattened view: a rectangle in its colour, and its letter with the area.

import { applied, boxOf, cornersOf } from "./geometry.js";
import { drawLabel, strokeLine } from "./marks.js";
import { within } from "../page/dom.js";
import { number } from "../page/format.js";

const HIGH_PX = 19;
const PALE = 0.6;
const FONT = "600 14px system-ui, sans-serif";

/**
 * Draw them all, moved by so much; the rectangle of the `chosen` one (its letter) is not broken.
 * @param {FlatCanvas} canvas @param {Context} context @param {Style} style @param {Piece[]} pieces
 * @param {string | null} chosen @param {Motion} by
 */
export function drawPieces(canvas, context, style, pieces, chosen, by = [0, 0, 0]) {
  const taken = /** @type {Tag[]} */ ([]);
  for (const piece of pieces) {
    const corners = cornersOf(boxOf(piece.grid)).map((uv) => canvas.transform.toPane(...applied(by, ...uv)));
    const chosenOne = piece.label === chosen;
    strokeLine(context, [...corners, corners[0]], piece.color, chosenOne ? 3 : 1.5, chosenOne ? [] : [5, 4]);
    taken.push(drawTag(canvas, style, corners, piece, taken));
  }
}

/**
 * The cloth of the shape within some loops, moved; where it was it is pale.
 * @param {FlatCanvas} canvas @param {Style} style @param {UV[][]} loops @param {Motion} by
 */
export function drawMoved(canvas, style, loops, by) {
  const { context, transform } = canvas;
  const { shown } = canvas.layer;
  const trace = (/** @type {Motion} */ motion) => {
    context.beginPath();
    for (const loop of loops) {
      loop.forEach((uv, n) => {
        const { x, y } = transform.toPane(...applied(motion, ...uv));
        n ? context.lineTo(x, y) : context.moveTo(x, y);
      });
      context.closePath();
    }
  };
  context.globalAlpha = PALE;
  context.fillStyle = style.getPropertyValue("--ground");
  trace([0, 0, 0]);
  context.fill();
  context.globalAlpha = 1;
  context.save();
  trace(by);
  context.clip();
  if (shown) canvas.drawPicture(shown, shown.image, false, by);
  context.restore();
}

/**
 * A text below places of the plane, within the pane; of no place at its top. What is too wide is in lines.
 * @param {FlatCanvas} canvas @param {Style} style @param {string} text @param {UV[]} places
 */
export function drawCaption(canvas, style, text, places = []) {
  const { context } = canvas;
  const at = places.map(([u, v]) => canvas.transform.toPane(u, v));
  context.font = FONT;
  context.textBaseline = "middle";
  const widthOf = (/** @type {string} */ line) => context.measureText(line).width + 12;
  const lines = widthOf(text) > canvas.width ? text.split(", ") : [text];
  const width = Math.max(...lines.map(widthOf));
  const left = at.length ? Math.min(...at.map((place) => place.x)) : (canvas.width - width) / 2;
  const x = within(left, 0, canvas.width - width);
  const y = within(Math.max(0, ...at.map((place) => place.y)) + 4, 0, canvas.height - 20 * lines.length);
  lines.forEach((line, n) => drawLabel(context, style, line, [x + 6, y + 20 * n + 10], [x, y + 20 * n, width, 20]));
}

/** @typedef {{ x: number; top: number; right: number }} Tag */

/**
 * Within the canvas, so that the area can be read; below the tags that lie there.
 * @param {FlatCanvas} canvas @param {Style} style @param {Point[]} corners @param {Piece} piece @param {Tag[]} taken
 */
function drawTag(canvas, style, corners, piece, taken) {
  const { context } = canvas;
  const text = `${piece.label} · ${number(piece.area_cm2, 0)} cm²`;
  context.font = FONT;
  context.textBaseline = "middle";
  const width = context.measureText(text).width + 20;
  const [left, right, highest, lowest] = ["x", "y"].flatMap((axis) => {
    const all = corners.map((corner) => corner[/** @type {"x" | "y"} */ (axis)]);
    return [Math.min(...all), Math.max(...all)];
  });
  const middle = (left + right) / 2;
  const x = middle > 0 && middle < canvas.width ? within(middle - width / 2, 0, canvas.width - width) : middle;
  // Away from the shape.
  let top = highest + lowest < canvas.height ? highest - HIGH_PX - 2 : Math.min(lowest + 2, canvas.height - HIGH_PX);
  const covered = () => taken.find((tag) => x < tag.right && x + width > tag.x && Math.abs(top - tag.top) < HIGH_PX);
  for (let tag = covered(); tag; tag = covered()) top = tag.top + HIGH_PX + 1;
  drawLabel(context, style, text, [x + 12, top + 10], [x, top, width, HIGH_PX]);
  context.fillStyle = piece.color;
  context.fillRect(x, top, 6, HIGH_PX);
  return { x, top, right: x + width };
}
