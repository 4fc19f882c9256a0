// Plots of the teaching mode: curves over columns or iterations, bars, and a map of costs.

import { number } from "/static/page/format.js";
import { inset } from "/static/teaching/draw.js";

/** Round numbers that divide a range into about `count` steps. */
export function ticks(/** @type {number} */ low, /** @type {number} */ high, count = 5) {
  const rough = Math.max(1e-12, (high - low) / count);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= 0.999 * rough);
  const found = [];
  for (let t = Math.ceil(low / step - 1e-9) * step; t <= high + 1e-9 * step; t += step)
    found.push(Math.abs(t) < 1e-9 * step ? 0 : t);
  return found;
}

const decimals = (/** @type {number[]} */ values) => (values.length > 1 && values[1] - values[0] < 1 ? 1 : 0);

/** One plot: two axes, y up. `y2` is a second scale at the right. */
export class Plot {
  /** @param {Sheet} sheet @param {Rect} rect @param {PlotOptions} parts */
  constructor(
    sheet,
    rect,
    {
      x,
      y,
      y2 = null,
      log = false,
      xLabel = "",
      yLabel = "",
      y2Label = "",
      yColor = null,
      y2Color = null,
      xTicks = null,
      yTicks = null,
      xAxis = true,
    },
  ) {
    const em = sheet.em;
    this.sheet = sheet;
    this.log = log;
    this.inner = inset(rect, 3.9 * em, 1.9 * em, y2 ? 3.7 * em : 0.8 * em, (xAxis ? 3.1 : 0.6) * em);
    this.x = x;
    this.y = y;
    this.y2 = y2;
    this.axes({ xLabel, yLabel, y2Label, yColor, y2Color, xTicks, yTicks, xAxis });
  }

  px(/** @type {number} */ value) {
    const [low, high] = this.x;
    return this.inner.x + (this.inner.w * (value - low)) / (high - low || 1);
  }

  py(/** @type {number} */ value, scale = this.y) {
    const [low, high] = this.log ? scale.map(Math.log10) : scale;
    const at = this.log ? Math.log10(Math.max(value, 1e-12)) : value;
    return this.inner.y + this.inner.h * (1 - (at - low) / (high - low || 1));
  }

  /** @param {number} x @param {number} y @param {UV} [scale] @returns {UV} */
  at(x, y, scale) {
    return [this.px(x), this.py(y, scale)];
  }

  axes(/** @type {Axes} */ { xLabel, yLabel, y2Label, yColor, y2Color, xTicks, yTicks, xAxis }) {
    const { sheet, inner } = this;
    const { soft, line } = sheet.color;
    const em = sheet.em;
    sheet.frame(inner);
    const small = { color: soft, size: 0.85 };
    const yt = yTicks ?? (this.log ? decades(this.y) : ticks(...this.y));
    for (const t of yt) {
      const y = this.py(t);
      sheet.line([inner.x, y], [inner.x + inner.w, y], line, 1);
      sheet.text(this.log ? power(t) : number(t, decimals(yt)), inner.x - 6, y, {
        ...small,
        color: yColor ?? soft,
        align: "right",
        baseline: "middle",
      });
    }
    if (this.y2) {
      const y2t = ticks(...this.y2);
      for (const t of y2t)
        sheet.text(number(t, decimals(y2t)), inner.x + inner.w + 6, this.py(t, this.y2), {
          ...small,
          color: y2Color ?? soft,
          baseline: "middle",
        });
    }
    if (xAxis) {
      const xt = xTicks ?? ticks(...this.x, Math.max(2, Math.round(inner.w / (7 * em))));
      for (const t of xt)
        sheet.text(number(t, decimals(xt)), this.px(t), inner.y + inner.h + 0.4 * em, {
          ...small,
          align: "center",
          baseline: "top",
        });
      sheet.text(xLabel, inner.x + inner.w / 2, inner.y + inner.h + 1.75 * em, {
        ...small,
        align: "center",
        baseline: "top",
      });
    }
    sheet.text(yLabel, inner.x, inner.y - 0.55 * em, { ...small, color: yColor ?? soft });
    if (y2Label)
      sheet.text(y2Label, inner.x + inner.w, inner.y - 0.55 * em, {
        ...small,
        color: y2Color ?? soft,
        align: "right",
      });
  }

  /**
   * A curve over arrays; NaN makes a gap.
   * @param {Numbers} xs @param {Numbers} ys @param {string} color
   * @param {{ width?: number; scale?: UV; dash?: number[] }} parts
   */
  curve(xs, ys, color, { width = 2, scale = this.y, dash = [] } = {}) {
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
  area(xs, ys, color, from = 0, to = xs.length - 1, scale = this.y, alpha = 0.3) {
    const context = this.sheet.context;
    this.sheet.within(this.inner, () => {
      context.globalAlpha = alpha;
      context.fillStyle = color;
      context.beginPath();
      context.moveTo(this.px(xs[from]), this.py(Math.max(0, scale[0]), scale));
      for (let i = from; i <= to; i++) context.lineTo(...this.at(xs[i], Number.isFinite(ys[i]) ? ys[i] : 0, scale));
      context.lineTo(this.px(xs[to]), this.py(Math.max(0, scale[0]), scale));
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
