// A pen draws marks on a canvas, in CSS pixels: lines, dots, rings and labels that are seen on any cloth. It knows where
// places of what the canvas shows lie.

import { length, niceLength } from "../page/format.js";

const FONT = "12px system-ui, sans-serif";

/** The arms of a cross: between two distances from its middle. @param {Context} context @param {Point} middle */
export function traceCross(context, { x, y }, /** @type {number} */ from, /** @type {number} */ to) {
  for (const side of [-1, 1]) {
    context.moveTo(x + side * from, y);
    context.lineTo(x + side * to, y);
    context.moveTo(x, y + side * from);
    context.lineTo(x, y + side * to);
  }
}

export class Pen {
  constructor(/** @type {Context} */ context, at = (/** @type {UV} */ [x, y]) => /** @type {Point} */ ({ x, y })) {
    this.context = context;
    this.at = at;
    this.style = getComputedStyle(/** @type {HTMLCanvasElement} */ (context.canvas));
  }

  /** A colour as it is; of a property of the style sheet (--accent) that which it has here. */
  color(/** @type {string} */ name) {
    return name.startsWith("--") ? this.style.getPropertyValue(name).trim() : name;
  }

  /** A line through points. @param {Point[]} points @param {string} color @param {number[]} dash */
  line(points, color, width = 1.5, dash = []) {
    const { context } = this;
    context.setLineDash(dash);
    context.strokeStyle = this.color(color);
    context.lineWidth = width;
    context.beginPath();
    points.forEach(({ x, y }, i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.stroke();
    context.setLineDash([]);
  }

  /**
   * A closed line around places; a white rim, so much wider, lets it be seen on any cloth.
   * @param {UV[]} places @param {string} color @param {number} width @param {{ rim?: number; dash?: number[] }} look
   */
  loop(places, color, width, look) {
    const { rim = 0, dash = [] } = look;
    if (!places.length) return;
    const line = [...places, places[0]].map(this.at);
    if (rim) this.line(line, "#fff", width + rim, dash);
    this.line(line, color, width, dash);
  }

  /** Fill what `path` traces. @param {string} color @param {(to: Context) => void} path */
  fill(color, path, alpha = 1) {
    const { context } = this;
    context.globalAlpha = alpha;
    context.fillStyle = this.color(color);
    context.beginPath();
    path(context);
    context.fill();
    context.globalAlpha = 1;
  }

  /** Stroke what `path` traces, with a rim. @param {string} color @param {(to: Context) => void} path */
  rimmed(color, /** @type {number} */ width, path, rim = "#fff", rimWidth = 2) {
    const { context } = this;
    context.beginPath();
    path(context);
    context.strokeStyle = this.color(rim);
    context.lineWidth = width + rimWidth;
    context.stroke();
    context.strokeStyle = this.color(color);
    context.lineWidth = width;
    context.stroke();
  }

  ring(/** @type {Point} */ { x, y }, /** @type {string} */ color, /** @type {number} */ radius) {
    this.rimmed(color, 2, (to) => to.arc(x, y, radius, 0, 2 * Math.PI));
  }

  dot(/** @type {Point} */ { x, y }, /** @type {string} */ color, /** @type {number} */ radius, rim = 1.5) {
    const { context } = this;
    this.fill(color, (to) => to.arc(x, y, radius, 0, 2 * Math.PI));
    context.strokeStyle = "#fff";
    context.lineWidth = rim;
    context.stroke();
  }

  /** Small squares. @param {Iterable<Point | null>} points @param {string} color */
  squares(points, color, size = 2, alpha = 1) {
    this.fill(
      color,
      (to) => {
        for (const at of points) if (at) to.rect(at.x - size / 2, at.y - size / 2, size, size);
      },
      alpha,
    );
  }

  /** How wide a label is. @param {string} text */
  widthOf(text, font = `600 ${FONT}`) {
    this.context.font = font;
    return this.context.measureText(text).width + 10;
  }

  /**
   * A text on a plate, whose left end and middle are at a point; returns its width.
   * @param {string} text @param {Point} point @param {LabelLook} look
   */
  label(text, { x, y }, { font = `600 ${FONT}`, color = "--text", alpha = 1, height = 18, width = null } = {}) {
    const { context } = this;
    const wide = width ?? this.widthOf(text, font);
    this.fill("--panel", (to) => to.rect(x, y - height / 2, wide, height), alpha);
    context.font = font;
    context.textBaseline = "middle";
    context.fillStyle = this.color(color);
    context.fillText(text, x + 5, y);
    return wide;
  }

  /** A scale bar with its length, at most so long. @param {Point} left @param {number} most @param {number} pxPerM */
  scale({ x, y }, most, pxPerM) {
    const mm = niceLength((1000 * most) / pxPerM);
    const end = x + (mm / 1000) * pxPerM;
    const width = Math.max(end - x, this.widthOf(length(mm), FONT) - 10) + 16;
    this.fill("--panel", (to) => to.rect(x - 8, y - 24, width, 34), 0.85);
    this.label(length(mm), { x: x - 1, y: y - 11 }, { font: FONT, alpha: 0 });
    this.line(
      [
        { x, y: y - 5 },
        { x, y },
        { x: end, y },
        { x: end, y: y - 5 },
      ],
      "--text",
      1.5,
    );
  }
}
