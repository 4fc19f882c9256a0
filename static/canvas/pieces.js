// The floating pieces on the flattened view: a rectangle in its colour, and its letter with the area.

import { applied, boxOf, boxOfPoints, cornersOf } from "./geometry.js";
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
  const rims = pieces.map((piece) =>
    cornersOf(boxOf(piece.grid)).map((uv) => canvas.transform.toPane(...applied(by, ...uv))),
  );
  const boxes = rims.map((corners) => boxOfPoints(corners.flatMap(({ x, y }) => [x, y])));
  const taken = [...boxes];
  pieces.forEach((piece, n) => {
    const chosenOne = piece.label === chosen;
    strokeLine(context, [...rims[n], rims[n][0]], piece.color, chosenOne ? 3 : 1.5, chosenOne ? [] : [5, 4]);
    taken.push(drawTag(canvas, style, boxes[n], piece, taken));
  });
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

/**
 * Within the canvas, so that the area can be read; where it covers neither a piece nor a tag.
 * @param {FlatCanvas} canvas @param {Style} style @param {Box} box of the piece @param {Piece} piece
 * @param {Box[]} taken
 */
function drawTag(canvas, style, { left, right, top: highest, bottom: lowest }, piece, taken) {
  const { context } = canvas;
  const text = `${piece.label} · ${number(piece.area_cm2, 0)} cm²`;
  context.font = FONT;
  context.textBaseline = "middle";
  const width = context.measureText(text).width + 20;
  const middle = (left + right) / 2;
  const x = middle > 0 && middle < canvas.width ? within(middle - width / 2, 0, canvas.width - width) : middle;
  // Away from the shape, if there is room.
  const ways = [
    { from: highest - HIGH_PX - 2, step: -HIGH_PX - 1 },
    { from: Math.min(lowest + 2, canvas.height - HIGH_PX), step: HIGH_PX + 1 },
  ];
  if (highest + lowest >= canvas.height) ways.reverse();
  const tops = [...Array(taken.length).keys()].flatMap((n) => ways.map(({ from, step }) => from + n * step));
  const boxAt = (/** @type {number} */ y) => ({ left: x, right: x + width, top: y, bottom: y + HIGH_PX });
  const isFree = (/** @type {number} */ y) =>
    y >= 0 && y <= canvas.height - HIGH_PX && !taken.some((one) => meet(one, boxAt(y)));
  const top = tops.find(isFree) ?? tops[0];
  drawLabel(context, style, text, [x + 12, top + 10], [x, top, width, HIGH_PX]);
  context.fillStyle = piece.color;
  context.fillRect(x, top, 6, HIGH_PX);
  return boxAt(top);
}

/** @param {Box} a @param {Box} b */
const meet = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
