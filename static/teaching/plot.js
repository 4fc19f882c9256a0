// Plots of the teaching mode: curves over columns or iterations, bars, and a map of costs.

import { number } from "../page/format.js";
import { inset } from "./draw.js";

/** Round numbers that divide a range into about `count` steps. */
export function ticks(/** @type {number} */ low, /** @type {number} */ high, count = 5) {
  const rough = Math.max(1e-12, (high - low) / count);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= 0.999 * rough) ?? rough;
  const found = [];
  for (let t = Math.ceil(low / step - 1e-9) * step; t <= high + 1e-9 * step; t += step)
    found.push(Math.abs(t) < 1e-9 * step ? 0 : t);
  return found;
}

const decimals = (/** @type {number[]} */ values) => (values.length > 1 && values[1] - values[0] < 1 ? 1 : 0);

/** One plot: two axes, y up. `y2` is a second scale at the right. */
export class Plot {
  constructor(/** @type {Sheet} */ sheet, /** @type {Rect} */ rect, /** @type {PlotOptions} */ options) {
    const { x, y, y2 = null, log = false, xAxis = true } = options;
    const em = sheet.em;
    this.sheet = sheet;
    this.log = log;
    this.inner = inset(rect, 3.9 * em, 1.9 * em, y2 ? 3.7 * em : 0.8 * em, (xAxis ? 3.1 : 0.6) * em);
    this.x = x;
    this.y = y;
    this.y2 = y2;
    this.axes(options);
  }

  px(/** @type {number} */ value) {
    const [low, high] = this.x;
    return this.inner.x + (this.inner.w * (value - low)) / (high - low || 1);
  }

  py(/** @type {number} */ value, /** @type {UV | null} */ scale = this.y) {
    const ends = scale ?? this.y;
    const [low, high] = this.log ? ends.map(Math.log10) : ends;
    const at = this.log ? Math.log10(Math.max(value, 1e-12)) : value;
    return this.inner.y + this.inner.h * (1 - (at - low) / (high - low || 1));
  }

  /** @param {number} x @param {number} y @param {UV | null} [scale] of the second axis @returns {UV} */
  at(x, y, scale) {
    return [this.px(x), this.py(y, scale)];
  }

  axes(/** @type {PlotOptions} */ { xLabel = "", yLabel = "", y2Label = "", yColor, y2Color, yTicks, xAxis = true }) {
    const { sheet, inner, y2 } = this;
    const { soft, line } = sheet.color;
    const em = sheet.em;
    const [right, bottom] = [inner.x + inner.w, inner.y + inner.h];
    sheet.frame(inner);
    /** @type {(text: string, x: number, y: number, look: TextLook) => void} */
    const write = (text, x, y, look) => sheet.text(text, x, y, { color: soft, size: 0.85, ...look });
    const left = /** @type {TextLook} */ ({ color: yColor ?? soft, align: "right", baseline: "middle" });
    const yt = yTicks ?? (this.log ? decades(this.y) : ticks(...this.y));
    for (const t of yt) {
      const y = this.py(t);
      sheet.line([inner.x, y], [right, y], line, 1);
      write(this.log ? power(t) : number(t, decimals(yt)), inner.x - 6, y, left);
    }
    const y2t = y2 ? ticks(...y2) : [];
    for (const t of y2t)
      write(number(t, decimals(y2t)), right + 6, this.py(t, y2), { color: y2Color ?? soft, baseline: "middle" });
    if (xAxis) {
      const below = /** @type {TextLook} */ ({ align: "center", baseline: "top" });
      const xt = ticks(...this.x, Math.max(2, Math.round(inner.w / (7 * em))));
      for (const t of xt) write(number(t, decimals(xt)), this.px(t), bottom + 0.4 * em, below);
      write(xLabel, inner.x + inner.w / 2, bottom + 1.75 * em, below);
    }
    write(yLabel, inner.x, inner.y - 0.55 * em, { color: yColor ?? soft });
    if (y2Label) write(y2Label, right, inner.y - 0.55 * em, { color: y2Color ?? soft, align: "right" });
  }

  /**
   * A curve over arrays; NaN makes a gap.
   * @param {Numbers} xs @param {Numbers} ys @param {string} color
   * @param {{ width?: number; scale?: UV | null; dash?: number[] }} parts
   */
  curve(xs, ys, color, { width = 2, scale, dash = [] } = {}) {
    const context = this.sheet.context;
    this.sheet.within(inset(this.inner, -1), () => {
      context.setLineDash(dash);
      context.beginPath();
      let down = false;
      for (let i = 0; i < xs.length; i++) {
        if (!Number.isFinite(ys[i])) {
          down = false;
          continue;
        }
        const place = this.at(xs[i], ys[i], scale);
        if (down) context.lineTo(...place);
        else context.moveTo(...place);
        down = true;
      }
      context.strokeStyle = color;
      context.lineWidth = width * this.sheet.weight;
      context.lineJoin = "round";
      context.stroke();
    });
  }

  /** The area under a curve, between two indices. @param {Numbers} xs @param {Numbers} ys @param {string} color */
  area(xs, ys, color, from = 0, to = xs.length - 1, /** @type {UV | null} */ scale = this.y, alpha = 0.3) {
    const ground = this.py(Math.max(0, (scale ?? this.y)[0]), scale);
    const context = this.sheet.context;
    this.sheet.within(this.inner, () => {
      context.globalAlpha = alpha;
      context.fillStyle = color;
      context.beginPath();
      context.moveTo(this.px(xs[from]), ground);
      for (let i = from; i <= to; i++) context.lineTo(...this.at(xs[i], Number.isFinite(ys[i]) ? ys[i] : 0, scale));
      context.lineTo(this.px(xs[to]), ground);
      context.fill();
    });
  }

  /** @param {number} low @param {number} high @param {string} color */
  band(low, high, color, alpha = 0.16) {
    const context = this.sheet.context;
    this.sheet.within(this.inner, () => {
      context.globalAlpha = alpha;
      context.fillStyle = color;
      context.fillRect(this.inner.x, this.py(high), this.inner.w, this.py(low) - this.py(high));
    });
  }

  /** @param {number} x @param {string} color @param {number[]} dash */
  vertical(x, color, label = "", width = 2, dash = [], above = false) {
    const { inner, sheet } = this;
    sheet.line([this.px(x), inner.y], [this.px(x), inner.y + inner.h], color, width, dash);
    if (label)
      sheet.text(label, this.px(x), above ? inner.y + 1.2 * sheet.em : inner.y + inner.h - 6, {
        color,
        weight: 600,
        align: "center",
        plate: true,
      });
  }

  horizontal(/** @type {number} */ y, /** @type {string} */ color, label = "", dash = [5, 4]) {
    const { inner, sheet } = this;
    sheet.line([inner.x, this.py(y)], [inner.x + inner.w, this.py(y)], color, 1.5, dash);
    if (label)
      sheet.text(label, inner.x + inner.w - 5, this.py(y) - 5, {
        color,
        align: "right",
        weight: 600,
        size: 0.85,
        plate: true,
      });
  }

  /** @param {number[]} edges @param {number[]} counts @param {(value: number) => string} colorOf */
  bars(edges, counts, colorOf) {
    const context = this.sheet.context;
    counts.forEach((count, i) => {
      const [x0, x1] = [this.px(edges[i]), this.px(edges[i + 1])];
      const y = this.py(count);
      context.fillStyle = colorOf((edges[i] + edges[i + 1]) / 2);
      context.fillRect(x0 + 0.5, y, Math.max(1, x1 - x0 - 1), this.inner.y + this.inner.h - y);
    });
  }
}

function decades(/** @type {UV} */ [low, high]) {
  const found = [];
  for (let p = Math.ceil(Math.log10(low) - 1e-9); p <= Math.log10(high) + 1e-9; p++) found.push(10 ** p);
  return found;
}

const DIGITS = "⁰¹²³⁴⁵⁶⁷⁸⁹";

function power(/** @type {number} */ value) {
  const p = Math.round(Math.log10(value));
  if (p >= -1 && p <= 4) return p < 0 ? "0.1" : String(10 ** p);
  return `10${p < 0 ? "⁻" : ""}${[...String(Math.abs(p))].map((d) => DIGITS[Number(d)]).join("")}`;
}
