// The floating pieces on the flattened view: a rectangle in its colour, and its letter with the area.

import { applied, boxOf, boxOfPoints, cornersOf } from "./geometry.js";
import { within } from "../page/dom.js";
import { number } from "../page/format.js";

const HIGH_PX = 19;
const PALE = 0.6;
const FONT = "600 14px system-ui, sans-serif";

/**
 * Draw them all, moved by so much; the rectangle of the `chosen` one (its letter) is not broken.
 * @param {FlatCanvas} canvas @param {Piece[]} pieces @param {string | null} chosen @param {Motion} by
 */
export function drawPieces(canvas, pieces, chosen, by = [0, 0, 0]) {
  const { pen } = canvas;
  const rims = pieces.map((piece) => cornersOf(boxOf(piece.grid)).map((uv) => pen.at(applied(by, ...uv))));
  const boxes = rims.map((corners) => boxOfPoints(corners.flatMap(({ x, y }) => [x, y])));
  const taken = [...boxes];
  pieces.forEach((piece, n) => {
    const chosenOne = piece.label === chosen;
    pen.line([...rims[n], rims[n][0]], piece.color, chosenOne ? 3 : 1.5, chosenOne ? [] : [5, 4]);
    taken.push(drawTag(canvas, boxes[n], piece, taken));
  });
}

/**
 * The cloth of the shape within some loops, moved; where it was it is pale.
 * @param {FlatCanvas} canvas @param {UV[][]} loops @param {Motion} by
 */
export function drawMoved(canvas, loops, by) {
  const { context, pen } = canvas;
  const { shown } = canvas.layer;
  const trace = (/** @type {Motion} */ motion) => {
    for (const loop of loops) {
      loop.forEach((uv, n) => {
        const { x, y } = pen.at(applied(motion, ...uv));
        n ? context.lineTo(x, y) : context.moveTo(x, y);
      });
      context.closePath();
    }
  };
  pen.fill("--ground", () => trace([0, 0, 0]), PALE);
  context.save();
  context.beginPath();
  trace(by);
  context.clip();
  if (shown) canvas.drawPicture(shown, shown.image, false, by);
  context.restore();
}

/**
 * A text at the top of the pane; what is too wide is in lines.
 * @param {FlatCanvas} canvas @param {string} text
 */
export function drawCaption({ pen, width: most }, text) {
  const lines = pen.widthOf(text, FONT) > most ? text.split(", ") : [text];
  const width = Math.max(...lines.map((line) => pen.widthOf(line, FONT)));
  const x = Math.max(0, (most - width) / 2);
  lines.forEach((line, n) => pen.label(line, { x, y: 14 + 20 * n }, { font: FONT, width, height: 20 }));
}

/**
 * Within the canvas, so that the area can be read; where it covers neither a piece nor a tag.
 * @param {FlatCanvas} canvas @param {Box} box of the piece @param {Piece} piece @param {Box[]} taken
 */
function drawTag(canvas, { left, right, top: highest, bottom: lowest }, piece, taken) {
  const { pen } = canvas;
  const text = `${piece.label} · ${number(piece.area_cm2, 0)} cm²`;
  const width = pen.widthOf(text, FONT) + 8;
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
  pen.label(text, { x: x + 7, y: top + HIGH_PX / 2 }, { font: FONT, width: width - 7, height: HIGH_PX });
  pen.fill(piece.color, (to) => to.rect(x, top, 6, HIGH_PX));
  return boxAt(top);
}

/** @param {Box} a @param {Box} b */
const meet = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
