// Plots of the teaching mode: curves and bars over two axes.

import { number } from "../page/format.js";
import { inset } from "./draw.js";

/** Round numbers that divide a range into about `count` steps. */
function ticks(/** @type {number} */ low, /** @type {number} */ high, count = 5) {
  const rough = Math.max(1e-12, (high - low) / count);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= 0.999 * rough) ?? rough;
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, i) => (first + i) * step);
}

/** One plot: two axes, y up, on which `log` values are given by their logarithms. */
export class Plot {
  /** @param {Sheet} sheet @param {Rect} rect @param {UV} x @param {UV} y @param {PlotOptions} options */
  constructor(sheet, rect, x, y, { log = false, key = "plot", xLabel = "", yLabel = "", color = sheet.color.soft }) {
    const { em } = sheet;
    const inner = (this.inner = inset(rect, 3.9 * em, 1.9 * em, 0.8 * em, (xLabel ? 3.1 : 0.6) * em));
    this.sheet = sheet;
    const box = { left: x[0], right: x[1], top: y[1], bottom: y[0] };
    this.map = sheet.pane(key, box, inner, { margin: 0, stretch: true });
    sheet.frame(inner);
    const some = ticks(...y, Math.max(1, Math.min(5, inner.h / (2 * em))));
    for (const t of log ? some.filter(Number.isInteger) : some) {
      this.horizontal(t, sheet.color.line, 1);
      const text = log ? number(10 ** t, Math.max(0, -t)) : number(t, Math.abs(y[1] - y[0]) < 3 ? 1 : 0);
      const look = /** @type {TextLook} */ ({ color, size: 0.85, align: "right", baseline: "middle" });
      sheet.text(text, inner.x - 6, this.at(0, t)[1], look);
    }
    sheet.text(yLabel, inner.x, inner.y - 0.55 * em, { color, size: 0.85 });
    if (xLabel) this.xAxis(x, xLabel);
  }

  xAxis(/** @type {UV} */ x, /** @type {string} */ label) {
    const { sheet, inner } = this;
    const look = /** @type {TextLook} */ ({ color: sheet.color.soft, size: 0.85, align: "center", baseline: "top" });
    const bottom = inner.y + inner.h;
    for (const t of ticks(...x, Math.max(3, Math.round(inner.w / (7 * sheet.em)))))
      sheet.text(number(t, 0), this.at(t, 0)[0], bottom + 0.4 * sheet.em, look);
    sheet.text(label, inner.x + inner.w / 2, bottom + 1.75 * sheet.em, look);
  }

  at(/** @type {number} */ x, /** @type {number} */ y) {
    return this.map.at(x, y);
  }

  /**
   * A curve over arrays; null makes a gap.
   * @param {Numbers} xs @param {ArrayLike<number | null>} ys @param {string} color @param {number[]} dash
   */
  curve(xs, ys, color, width = 2, dash = []) {
    let part = /** @type {UV[]} */ ([]);
    this.sheet.clipped(inset(this.inner, -1), () => {
      for (let i = 0; i <= xs.length; i++) {
        const y = ys[i] ?? null;
        if (y !== null) part.push(this.at(xs[i], y));
        else part = (this.sheet.path(part, color, width, dash), []);
      }
    });
  }

  /** The area under a curve, between two indices. @param {Numbers} xs @param {Numbers} ys @param {string} color */
  area(xs, ys, color, from = 0, to = xs.length - 1, alpha = 0.3) {
    const path = (/** @type {Context} */ context) => {
      context.moveTo(...this.at(xs[from], 0));
      for (let i = from; i <= to; i++) context.lineTo(...this.at(xs[i], ys[i] || 0));
      context.lineTo(...this.at(xs[to], 0));
    };
    this.sheet.fill(color, path, alpha);
  }

  /** A bar, or a band. @param {UV} x from, to @param {UV} y from, to @param {string} color */
  block([x0, x1], [y0, y1], color, alpha = 1) {
    const [[left, top], [right, bottom]] = [this.at(x0, y1), this.at(x1, y0)];
    this.sheet.fill(color, (to) => to.rect(left, top, Math.max(1, right - left - 1), bottom - top), alpha);
  }

  /** @param {number} x @param {string} color */
  vertical(x, color, width = 2, bottom = this.inner.y + this.inner.h) {
    const [at] = this.at(x, 0);
    this.sheet.line([at, this.inner.y], [at, bottom], color, width);
  }

  /** @param {number} y @param {string} color @param {number[]} dash */
  horizontal(y, color, width = 1.5, dash = []) {
    const [, at] = this.at(0, y);
    this.sheet.line([this.inner.x, at], [this.inner.x + this.inner.w, at], color, width, dash);
  }
}
