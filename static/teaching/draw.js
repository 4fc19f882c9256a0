// The drawing sheet of the teaching mode: panes, plots, and what is drawn in them.

import { Pen } from "../canvas/pen.js";
import { contextOf, sized, within } from "../page/dom.js";
import { number } from "../page/format.js";

const COLORS =
  "panel raised line text soft accent sample pair unused point short even long count mean before limit mark band " +
  "kept new";

/** Rectangles of CSS pixels beside each other. */
export function columns(/** @type {Rect} */ rect, /** @type {number[]} */ shares, gap = 16) {
  const total = shares.reduce((a, b) => a + b, 0);
  let x = rect.x;
  return shares.map((share) => {
    const w = ((rect.w - gap * (shares.length - 1)) * share) / total;
    const made = { x, y: rect.y, w, h: rect.h };
    x += w + gap;
    return made;
  });
}

/** Rectangles below each other. */
export function rows(/** @type {Rect} */ rect, /** @type {number[]} */ shares, gap = 16) {
  const turned = columns({ x: rect.y, y: rect.x, w: rect.h, h: rect.w }, shares, gap);
  return turned.map((r) => ({ x: r.y, y: r.x, w: r.h, h: r.w }));
}

/** @param {Rect} rect @param {number} left */
export const inset = (rect, left, top = left, right = left, bottom = top) => ({
  x: rect.x + left,
  y: rect.y + top,
  w: Math.max(1, rect.w - left - right),
  h: Math.max(1, rect.h - top - bottom),
});

/** The width share of a pane that shows a box at the full height of the sheet. */
export function shareOf(/** @type {Box} */ box, /** @type {Rect} */ rect, least = 0.22, most = 0.5) {
  const wide = (rect.h * (box.right - box.left)) / (box.bottom - box.top);
  return within((1.08 * wide) / rect.w, least, most);
}

/** @param {Drawable} image */
export const imageBox = (image) => ({ left: -0.5, top: -0.5, right: image.width - 0.5, bottom: image.height - 0.5 });

/** Round numbers that divide a range into about `count` steps. */
function ticks(/** @type {number} */ low, /** @type {number} */ high, count = 5) {
  const rough = Math.max(1e-12, (high - low) / count);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= 0.999 * rough) ?? rough;
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, i) => (first + i) * step);
}

export class Sheet extends Pen {
  constructor(/** @type {HTMLCanvasElement} */ canvas, /** @type {(key: string, at: UV) => void} */ probe) {
    super(contextOf(canvas));
    this.canvas = canvas;
    this.panes = /** @type {Pane[]} */ ([]);
    this.palette = /** @type {Record<string, string>} */ ({});
    this.em = this.weight = 1;
    const point = (/** @type {PointerEvent} */ { offsetX: x, offsetY: y }) => {
      const pane = this.panes.findLast(({ rect: r }) => x >= r.x && y >= r.y && x <= r.x + r.w && y <= r.y + r.h);
      if (pane) probe(pane.key, pane.from(x, y));
    };
    canvas.addEventListener("pointerdown", point);
    canvas.addEventListener("pointermove", point);
  }

  begin() {
    const { clientWidth: w, clientHeight: h } = this.canvas;
    sized(this.canvas, w, h);
    this.palette = Object.fromEntries(COLORS.split(" ").map((name) => [name, this.color(`--${name}`)]));
    this.em = parseFloat(this.style.fontSize);
    this.weight = within(h / 620, 1, 2); // strokes and dots grow with the sheet
    this.panes = [];
    return inset({ x: 0, y: 0, w, h }, 14, 10, 14, 14);
  }

  /**
   * Write a text; A_w in it is set as A with a small w. Returns its width.
   * @param {string} text @param {number} x @param {number} y @param {TextLook} look
   */
  text(text, x, y, look = {}) {
    const { color = "--text", size = 0.92, weight = 400, align = "left", plate = false } = look;
    const { context, em } = this;
    context.textBaseline = look.baseline ?? "alphabetic";
    const runs = text.split(/(?<=\b[A-Za-z])_([a-z0-9])\b/); // every other one is small
    const fontOf = (/** @type {number} */ n) => {
      context.font = `${weight} ${((n % 2 ? 0.76 : 1) * size * em).toFixed(1)}px ${this.style.fontFamily}`;
    };
    const widths = runs.map((run, n) => (fontOf(n), context.measureText(run).width));
    const width = widths.reduce((a, b) => a + b);
    let left = x - width * { left: 0, center: 0.5, right: 1 }[align];
    const top = y - (look.baseline ? 0.7 : 1) * size * em;
    if (plate) this.fill("--panel", (to) => to.rect(left - 3, top, width + 6, 1.35 * size * em), 0.82);
    context.fillStyle = this.color(color);
    runs.forEach((run, n) => {
      fontOf(n);
      context.fillText(run, left, y + (n % 2 ? 0.28 * size * em : 0));
      left += widths[n];
    });
    return width;
  }

  /** A title above a pane, clipped to its width; returns what is left of it. */
  titled(/** @type {Rect} */ rect, /** @type {string} */ title, detail = "") {
    const { em } = this;
    this.clipped(rect, () => {
      const used = this.text(title, rect.x, rect.y + 1.05 * em, { weight: 600 });
      this.text(detail, rect.x + used + 0.6 * em, rect.y + 1.05 * em, { color: "--soft" });
    });
    return inset(rect, 0, 1.7 * em, 0, 0);
  }

  /**
   * Draw in a pane, which gets a frame.
   * @param {string} key @param {Box} box @param {Rect} rect @param {PaneOptions} options
   * @param {(pane: Pane) => void} draw
   */
  show(key, box, rect, options, draw) {
    const pane = new Pane(this, key, box, rect, options);
    this.clipped(rect, () => {
      draw(pane);
      const { x, y, w, h } = rect;
      if (options.bar) this.scale({ x: x + 8, y: y + h - 7 }, Math.min(120, 0.4 * w), pane.scaling[0]);
    });
    this.frame(rect);
    return pane;
  }

  /** Show a picture in a pane. @param {string} key @param {Drawable} image @param {Box} box @param {Rect} rect */
  image(key, image, box, rect, options = {}) {
    return this.show(key, box, rect, options, (pane) => pane.picture(image, box));
  }

  clipped(/** @type {Rect} */ rect, /** @type {() => void} */ draw) {
    this.context.save();
    this.context.beginPath();
    this.context.rect(rect.x, rect.y, rect.w, rect.h);
    this.context.clip();
    draw();
    this.context.restore();
  }

  frame(/** @type {Rect} */ { x, y, w, h }, color = "--line") {
    this.context.strokeStyle = this.color(color);
    this.context.lineWidth = 1;
    this.context.strokeRect(Math.round(x) + 0.5, Math.round(y) + 0.5, Math.round(w) - 1, Math.round(h) - 1);
  }
}

/** A part of the sheet that shows a box of its own units, y down; stretched, both directions have scales of their own. */
export class Pane {
  /** @param {Sheet} sheet @param {string} key @param {Box} box @param {Rect} rect @param {PaneOptions} options */
  constructor(sheet, key, { left, top, right, bottom }, rect, { margin = 6, stretch = false }) {
    const scale = [(rect.w - 2 * margin) / (right - left || 1), (rect.h - 2 * margin) / (bottom - top || 1)];
    this.sheet = sheet;
    this.key = key;
    this.rect = rect;
    this.scaling = stretch ? scale : [Math.min(...scale), Math.min(...scale)];
    this.x = rect.x + rect.w / 2 - (this.scaling[0] * (left + right)) / 2;
    this.y = rect.y + rect.h / 2 - (this.scaling[1] * (top + bottom)) / 2;
    sheet.panes.push(this);
  }

  /** Where a place is on the sheet. @param {number} u @param {number} v */
  at(u, v) {
    return { x: this.x + this.scaling[0] * u, y: this.y + this.scaling[1] * v };
  }

  /** The reverse. @returns {UV} */
  from(/** @type {number} */ x, /** @type {number} */ y) {
    return [(x - this.x) / this.scaling[0], (y - this.y) / this.scaling[1]];
  }

  /** A picture of a box, or of another plane that a motion brings here. @param {Drawable} image @param {Box} box */
  picture(image, box, alpha = 1, /** @type {Motion} */ [theta, u, v] = [0, 0, 0]) {
    const { context } = this.sheet;
    const [across, down] = [this.scaling[0] * (box.right - box.left), this.scaling[1] * (box.bottom - box.top)];
    const { x, y } = this.at(u, v);
    context.save();
    context.translate(x, y);
    context.rotate(theta);
    context.globalAlpha = alpha;
    context.imageSmoothingEnabled = (devicePixelRatio * across) / image.width < 2.5;
    context.imageSmoothingQuality = "high";
    context.drawImage(image, this.scaling[0] * box.left, this.scaling[1] * box.top, across, down);
    context.restore();
  }

  /**
   * A picture made pixel by pixel: `colorAt(index)` is [r, g, b, alpha], or nothing.
   * @param {{ rows: number; cols: number }} size @param {Box} box @param {(i: number) => number[] | null} colorAt
   */
  painted({ rows: down, cols }, box, colorAt) {
    const context = contextOf(new OffscreenCanvas(cols, down));
    const data = context.createImageData(cols, down);
    for (let i = 0; i < down * cols; i++) data.data.set(colorAt(i) ?? [], 4 * i);
    context.putImageData(data, 0, 0);
    this.picture(context.canvas, box);
  }

  /** Dots at places [u0, v0, u1, v1, ...]. @param {Numbers} places @param {number} radius @param {string} color */
  dots(places, radius, color) {
    const r = radius * this.sheet.weight;
    this.sheet.fill(color, (to) => {
      for (let i = 0; i < places.length; i += 2) {
        const { x, y } = this.at(places[i], places[i + 1]);
        to.moveTo(x + r, y);
        to.arc(x, y, r, 0, 2 * Math.PI);
      }
    });
  }

  /**
   * Lines between such places by pairs of indices; `pick(pair)` says which are drawn.
   * @param {Numbers} places @param {Numbers} pairs @param {string} color @param {number} width
   */
  segments(places, pairs, color, width, pick = (/** @type {number} */ _pair) => true) {
    const { context, weight } = this.sheet;
    const placeOf = (/** @type {number} */ k) => this.at(places[2 * k], places[2 * k + 1]);
    context.beginPath();
    for (let e = 0; e < pairs.length; e += 2) {
      if (!pick(e / 2)) continue;
      const [a, b] = [placeOf(pairs[e]), placeOf(pairs[e + 1])];
      context.moveTo(a.x, a.y);
      context.lineTo(b.x, b.y);
    }
    context.strokeStyle = color;
    context.lineWidth = width * weight;
    context.stroke();
  }

  /** A line through places. @param {Numbers[]} places @param {string} color @param {number[]} dash */
  line(places, color, width = 1.5, dash = []) {
    const { sheet } = this;
    const points = places.map((place) => this.at(place[0], place[1]));
    sheet.line(points, color, width > 1 ? width * sheet.weight : width, dash);
  }

  /** A closed line through places. @param {ArrayLike<number>[]} places @param {string} color @param {number[]} dash */
  loop(places, color, width = 1.5, dash = []) {
    this.line([...places, places[0]], color, width, dash);
  }

  /** Fill what lies between places, in turn. @param {number[][]} places @param {string} color */
  area(places, color, alpha = 1) {
    const points = places.map(([u, v]) => this.at(u, v));
    this.sheet.fill(color, (to) => points.forEach(({ x, y }) => to.lineTo(x, y)), alpha);
  }

  /** A ring with a rim. @param {number[]} place @param {number} radius @param {string} color */
  ring([u, v], radius, color, width = 2.5) {
    const { weight } = this.sheet;
    const { x, y } = this.at(u, v);
    const circle = (/** @type {Context} */ to) => to.arc(x, y, radius * weight, 0, 2 * Math.PI);
    this.sheet.rimmed(color, width * weight, circle, "--panel", 3 * weight);
  }

  /** A text with its middle so many ems below a place. @param {string} text @param {number[]} place @param {TextLook} look */
  text(text, [u, v], look, below = 0) {
    const { x, y } = this.at(u, v);
    this.sheet.text(text, x, y + below * this.sheet.em, { align: "center", baseline: "middle", ...look });
  }
}

/** A pane with two axes, y up, on which `log` values are given by their logarithms. */
export class Plot extends Pane {
  /** @param {Sheet} sheet @param {Rect} rect @param {UV} x @param {UV} y @param {PlotOptions} options */
  constructor(sheet, rect, x, y, { log = false, key = "plot", xLabel = "", yLabel = "", color = "--soft" }) {
    const { em } = sheet;
    const inner = inset(rect, 3.9 * em, 1.9 * em, 0.8 * em, (xLabel ? 3.1 : 0.6) * em);
    super(sheet, key, { left: x[0], right: x[1], top: y[1], bottom: y[0] }, inner, { margin: 0, stretch: true });
    this.span = x;
    sheet.frame(inner);
    const look = { color, size: 0.85 };
    /** @type {TextLook} */
    const below = { ...look, color: "--soft", align: "center", baseline: "top" };
    const some = ticks(...y, Math.max(1, Math.min(5, inner.h / (2 * em))));
    for (const t of log ? some.filter(Number.isInteger) : some) {
      this.horizontal(t, "--line", 1);
      const text = log ? number(10 ** t, Math.max(0, -t)) : number(t, Math.abs(y[1] - y[0]) < 3 ? 1 : 0);
      sheet.text(text, inner.x - 6, this.at(0, t).y, { ...look, align: "right", baseline: "middle" });
    }
    sheet.text(yLabel, inner.x, inner.y - 0.55 * em, look);
    if (!xLabel) return;
    for (const t of ticks(...x, Math.max(3, Math.round(inner.w / (7 * em)))))
      sheet.text(number(t, 0), this.at(t, 0).x, inner.y + inner.h + 0.4 * em, below);
    sheet.text(xLabel, inner.x + inner.w / 2, inner.y + inner.h + 1.75 * em, below);
  }

  /**
   * A curve over arrays; null makes a gap.
   * @param {Numbers} xs @param {ArrayLike<number | null>} ys @param {string} color @param {number[]} dash
   */
  curve(xs, ys, color, width = 2, dash = []) {
    let part = /** @type {number[][]} */ ([]);
    this.sheet.clipped(inset(this.rect, -1), () => {
      for (let i = 0; i <= xs.length; i++) {
        const y = ys[i] ?? null;
        if (y !== null) part.push([xs[i], y]);
        else part = (this.line(part, color, width, dash), []);
      }
    });
  }

  /** The area under a curve, between two indices. @param {Numbers} xs @param {Numbers} ys @param {string} color */
  under(xs, ys, color, from = 0, to = xs.length - 1, alpha = 0.3) {
    const top = Array.from({ length: to + 1 - from }, (_, i) => [xs[from + i], ys[from + i] || 0]);
    this.area([[xs[from], 0], ...top, [xs[to], 0]], color, alpha);
  }

  /** A bar, or a band. @param {UV} x from, to @param {UV} y from, to @param {string} color */
  block([x0, x1], [y0, y1], color, alpha = 1) {
    const [a, b] = [this.at(x0, y1), this.at(x1, y0)];
    this.sheet.fill(color, (to) => to.rect(a.x, a.y, Math.max(1, b.x - a.x - 1), b.y - a.y), alpha);
  }

  /** A line across the plot, or on to a place of the sheet below it. @param {number} x @param {string} color */
  vertical(x, color, width = 2, bottom = this.rect.y + this.rect.h) {
    const ends = [this.rect.y, bottom].map((y) => ({ x: this.at(x, 0).x, y }));
    this.sheet.line(ends, color, width * this.sheet.weight);
  }

  /** @param {number} y @param {string} color @param {number[]} dash */
  horizontal(y, color, width = 1.5, dash = []) {
    const ends = this.span.map((x) => [x, y]);
    this.line(ends, color, width, dash);
  }
}
