// The drawing sheet of the teaching mode: panes, and what is drawn in them.

import { strokeLine, strokeRimmed, strokeScale } from "../canvas/marks.js";
import { contextOf, sized, within } from "../page/dom.js";
import { length, niceLength } from "../page/format.js";

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

export class Sheet {
  constructor(/** @type {HTMLCanvasElement} */ canvas, /** @type {(key: string, at: UV) => void} */ probe) {
    this.canvas = canvas;
    this.context = contextOf(canvas);
    this.panes = /** @type {PaneMap[]} */ ([]);
    this.color = /** @type {Record<string, string>} */ ({});
    this.em = this.weight = 1;
    this.family = "";
    const point = (/** @type {PointerEvent} */ { offsetX: x, offsetY: y }) => {
      const map = this.panes.findLast(({ rect: r }) => x >= r.x && y >= r.y && x <= r.x + r.w && y <= r.y + r.h);
      if (map) probe(map.key, map.from(x, y));
    };
    canvas.addEventListener("pointerdown", point);
    canvas.addEventListener("pointermove", point);
  }

  begin() {
    const { clientWidth: w, clientHeight: h } = this.canvas;
    sized(this.canvas, w, h);
    const style = getComputedStyle(this.canvas);
    this.color = Object.fromEntries(
      COLORS.split(" ").map((name) => [name, style.getPropertyValue(`--${name}`).trim()]),
    );
    this.em = parseFloat(style.fontSize);
    this.weight = within(h / 620, 1, 2); // strokes and dots grow with the sheet
    this.family = style.fontFamily;
    this.panes = [];
    return { x: 0, y: 0, w, h };
  }

  // --- texts -----------------------------------------------------------------------------------

  /**
   * Write a text; A_w in it is set as A with a small w. Returns its width.
   * @param {string} text @param {number} x @param {number} y @param {TextLook} look
   */
  text(text, x, y, look = {}) {
    const { color = this.color.text, size = 0.92, weight = 400, align = "left", plate = false } = look;
    const { context, em } = this;
    context.textBaseline = look.baseline ?? "alphabetic";
    const runs = text.split(/(?<=\b[A-Za-z])_([a-z0-9])\b/); // every other one is small
    const fontOf = (/** @type {number} */ n) => {
      context.font = `${weight} ${((n % 2 ? 0.76 : 1) * size * em).toFixed(1)}px ${this.family}`;
    };
    const widths = runs.map((run, n) => (fontOf(n), context.measureText(run).width));
    const width = widths.reduce((a, b) => a + b);
    let left = x - width * { left: 0, center: 0.5, right: 1 }[align];
    if (plate) this.plate(left - 3, y - (look.baseline ? 0.7 : 1) * size * em, width + 6, 1.35 * size * em);
    context.fillStyle = color;
    runs.forEach((run, n) => {
      fontOf(n);
      context.fillText(run, left, y + (n % 2 ? 0.28 * size * em : 0));
      left += widths[n];
    });
    return width;
  }

  /** What lies under a text. @param {[x: number, y: number, w: number, h: number]} rect */
  plate(...rect) {
    this.context.globalAlpha = 0.82;
    this.context.fillStyle = this.color.panel;
    this.context.fillRect(...rect);
    this.context.globalAlpha = 1;
  }

  /** A title above a pane, clipped to its width; returns what is left of it. */
  titled(/** @type {Rect} */ rect, /** @type {string} */ title, detail = "") {
    const { em } = this;
    this.clipped(rect, () => {
      const used = this.text(title, rect.x, rect.y + 1.05 * em, { weight: 600 });
      this.text(detail, rect.x + used + 0.6 * em, rect.y + 1.05 * em, { color: this.color.soft });
    });
    return inset(rect, 0, 1.7 * em, 0, 0);
  }

  // --- panes -----------------------------------------------------------------------------------

  /**
   * A pane that shows a box of its own units, y down; stretched, both directions have scales of their own.
   * @param {string} key @param {Box} box @param {Rect} rect
   */
  pane(key, { left, top, right, bottom }, rect, { margin = 6, stretch = false } = {}) {
    let scale = [(rect.w - 2 * margin) / (right - left || 1), (rect.h - 2 * margin) / (bottom - top || 1)];
    if (!stretch) scale = [Math.min(...scale), Math.min(...scale)];
    const x = rect.x + rect.w / 2 - (scale[0] * (left + right)) / 2;
    const y = rect.y + rect.h / 2 - (scale[1] * (top + bottom)) / 2;
    /** @type {PaneMap} */
    const map = {
      key,
      rect,
      scale,
      at: (u, v) => [x + scale[0] * u, y + scale[1] * v],
      from: (px, py) => [(px - x) / scale[0], (py - y) / scale[1]],
    };
    this.panes.push(map);
    return map;
  }

  /**
   * Draw in a pane, which gets a frame. Returns its map.
   * @param {string} key @param {Box} box @param {Rect} rect
   * @param {{ margin?: number; stretch?: boolean; bar?: boolean }} options with a scale bar?
   * @param {(map: PaneMap) => void} draw
   */
  show(key, box, rect, options, draw) {
    const map = this.pane(key, box, rect, options);
    this.clipped(rect, () => {
      draw(map);
      if (options.bar) this.scaleBar(map);
    });
    this.frame(rect);
    return map;
  }

  /** Show a picture in a pane. @param {string} key @param {Drawable} image @param {Box} box @param {Rect} rect */
  image(key, image, box, rect, options = {}) {
    return this.show(key, box, rect, options, (map) => this.picture(map, image, box));
  }

  clipped(/** @type {Rect} */ rect, /** @type {() => void} */ draw) {
    this.context.save();
    this.context.beginPath();
    this.context.rect(rect.x, rect.y, rect.w, rect.h);
    this.context.clip();
    draw();
    this.context.restore();
  }

  frame(/** @type {Rect} */ { x, y, w, h }, color = this.color.line) {
    this.context.strokeStyle = color;
    this.context.lineWidth = 1;
    this.context.strokeRect(Math.round(x) + 0.5, Math.round(y) + 0.5, Math.round(w) - 1, Math.round(h) - 1);
  }

  /** A scale bar in the corner of a pane of the plane, whose unit is the metre. */
  scaleBar(/** @type {PaneMap} */ { rect, scale }) {
    const mm = niceLength((1000 * Math.min(120, 0.4 * rect.w)) / scale[0]);
    const width = (mm / 1000) * scale[0];
    const [x, y] = [rect.x + 8, rect.y + rect.h - 7];
    this.plate(x - 5, y - 1.7 * this.em, Math.max(width, 4 * this.em) + 12, 1.7 * this.em + 5);
    strokeScale(this.context, x, y, width, this.color.text);
    this.text(length(mm), x + 4, y - 5, { size: 0.85 });
  }

  // --- what is drawn in them -------------------------------------------------------------------

  /**
   * A picture of a box of the plane, or of another plane that a motion brings here.
   * @param {PaneMap} map @param {Drawable} image @param {Box} box
   */
  picture(map, image, box, alpha = 1, /** @type {Motion} */ [theta, u, v] = [0, 0, 0]) {
    const { context } = this;
    const [across, down] = [map.scale[0] * (box.right - box.left), map.scale[1] * (box.bottom - box.top)];
    context.save();
    context.translate(...map.at(u, v));
    context.rotate(theta);
    context.globalAlpha = alpha;
    context.imageSmoothingEnabled = (devicePixelRatio * across) / image.width < 2.5;
    context.imageSmoothingQuality = "high";
    context.drawImage(image, map.scale[0] * box.left, map.scale[1] * box.top, across, down);
    context.restore();
  }

  /**
   * A picture made pixel by pixel: `colorAt(index)` is [r, g, b, alpha], or nothing.
   * @param {PaneMap} map @param {{ rows: number; cols: number }} size @param {Box} box
   * @param {(i: number) => number[] | null} colorAt
   */
  painted(map, { rows: down, cols }, box, colorAt) {
    const context = contextOf(new OffscreenCanvas(cols, down));
    const data = context.createImageData(cols, down);
    for (let i = 0; i < down * cols; i++) data.data.set(colorAt(i) ?? [], 4 * i);
    context.putImageData(data, 0, 0);
    this.picture(map, context.canvas, box);
  }

  /** @param {PaneMap} map @param {Numbers} points @param {number} radius @param {string} color */
  dots(map, points, radius, color) {
    const { context } = this;
    const r = radius * this.weight;
    context.beginPath();
    for (let i = 0; i < points.length; i += 2) {
      const [x, y] = map.at(points[i], points[i + 1]);
      context.moveTo(x + r, y);
      context.arc(x, y, r, 0, 2 * Math.PI);
    }
    context.fillStyle = color;
    context.fill();
  }

  /**
   * Lines between points by pairs of indices; `pick(pair)` says which are drawn.
   * @param {PaneMap} map @param {Numbers} points @param {Numbers} pairs @param {string} color @param {number} width
   */
  segments(map, points, pairs, color, width, pick = (/** @type {number} */ _pair) => true) {
    const { context } = this;
    context.beginPath();
    for (let e = 0; e < pairs.length; e += 2) {
      if (!pick(e / 2)) continue;
      const [a, b] = [2 * pairs[e], 2 * pairs[e + 1]];
      context.moveTo(...map.at(points[a], points[a + 1]));
      context.lineTo(...map.at(points[b], points[b + 1]));
    }
    context.strokeStyle = color;
    context.lineWidth = width * this.weight;
    context.stroke();
  }

  /** @param {UV} from @param {UV} to @param {string} color @param {number[]} dash */
  line(from, to, color, width = 1.5, dash = []) {
    this.path([from, to], color, width, dash);
  }

  /** A line through places of the sheet. @param {UV[]} places @param {string} color @param {number[]} dash */
  path(places, color, width = 1.5, dash = []) {
    const points = places.map(([x, y]) => ({ x, y }));
    strokeLine(this.context, points, color, width > 1 ? width * this.weight : width, dash);
  }

  /**
   * A closed line through places [u0, v0, u1, v1, ...] of a pane.
   * @param {PaneMap} map @param {Numbers} uv @param {string} color @param {number} width @param {number[]} dash
   */
  loop(map, uv, color, width, dash = []) {
    const places = Array.from({ length: uv.length / 2 }, (_, i) => map.at(uv[2 * i], uv[2 * i + 1]));
    this.path([...places, places[0]], color, width, dash);
  }

  /** Fill what `path` traces. @param {string} color @param {(to: Context) => void} path */
  fill(color, path, alpha = 1) {
    const { context } = this;
    context.globalAlpha = alpha;
    context.fillStyle = color;
    context.beginPath();
    path(context);
    context.fill();
    context.globalAlpha = 1;
  }

  /** A ring with a rim. @param {UV} place @param {number} radius @param {string} color */
  ring([x, y], radius, color, width = 2.5) {
    const circle = () => this.context.arc(x, y, radius * this.weight, 0, 2 * Math.PI);
    strokeRimmed(this.context, color, width * this.weight, circle, this.color.panel, 3 * this.weight);
  }
}
