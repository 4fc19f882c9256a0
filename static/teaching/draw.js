// The drawing sheet of the teaching mode: panes, and what is drawn in them.

import { strokeLine, strokeRimmed, strokeScale, traceCross } from "../canvas/marks.js";
import { contextOf, sized, within } from "../page/dom.js";
import { length, niceLength } from "../page/format.js";

const COLORS =
  "panel raised line text soft accent sample pair unused point short even long count mean before limit mark band " +
  "kept new";

/** Rectangles of CSS pixels: `{x, y, w, h}`. */
export function columns(/** @type {Rect} */ rect, /** @type {number[]} */ shares, gap = 16) {
  const total = shares.reduce((a, b) => a + b, 0);
  const room = rect.w - gap * (shares.length - 1);
  let x = rect.x;
  return shares.map((share) => {
    const w = (room * share) / total;
    const made = { x, y: rect.y, w, h: rect.h };
    x += w + gap;
    return made;
  });
}

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

/** @param {Rect} rect @param {number} x @param {number} y */
export const inside = (rect, x, y) => x >= rect.x && y >= rect.y && x <= rect.x + rect.w && y <= rect.y + rect.h;

/**
 * A picture made pixel by pixel: `colorAt(index)` is [r, g, b, alpha], or nothing.
 * @param {number} rowsCount @param {number} cols @param {(i: number) => number[] | null} colorAt
 */
export function painted(rowsCount, cols, colorAt) {
  const canvas = new OffscreenCanvas(cols, rowsCount);
  const context = contextOf(canvas);
  const data = context.createImageData(cols, rowsCount);
  for (let i = 0; i < rowsCount * cols; i++) {
    const color = colorAt(i);
    if (color) data.data.set(color, 4 * i);
  }
  context.putImageData(data, 0, 0);
  return canvas;
}

/** From a pane's own units to CSS pixels; both directions may have scales of their own. */
export class PaneMap {
  /**
   * @param {string} key @param {Rect} rect @param {number} scaleX @param {number} scaleY @param {number} x
   * @param {number} y
   */
  constructor(key, rect, scaleX, scaleY, x, y) {
    this.key = key;
    this.rect = rect;
    this.scaleX = scaleX;
    this.scaleY = scaleY;
    this.x = x;
    this.y = y;
  }

  /** @returns {UV} */
  at(/** @type {number} */ u, /** @type {number} */ v) {
    return [this.x + this.scaleX * u, this.y + this.scaleY * v];
  }

  /** @returns {UV} */
  from(/** @type {number} */ x, /** @type {number} */ y) {
    return [(x - this.x) / this.scaleX, (y - this.y) / this.scaleY];
  }
}

export class Sheet {
  /** `handlers`: redraw(), probe(pane key, place in its units). */
  constructor(/** @type {HTMLCanvasElement} */ canvas, /** @type {SheetHandlers} */ handlers) {
    this.canvas = canvas;
    this.context = contextOf(canvas);
    this.handlers = handlers;
    this.panes = /** @type {PaneMap[]} */ ([]);
    this.color = /** @type {Record<string, string>} */ ({});
    this.em = this.weight = 1;
    this.family = "";
    this.listen();
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

  font(size = 1, weight = 400) {
    this.context.font = `${weight} ${(size * this.em).toFixed(1)}px ${this.family}`;
  }

  /**
   * Write a text; A_w in it is set as A with a small w.
   *
   * @param {string} text @param {number} x @param {number} y @param {TextLook} look
   */
  text(text, x, y, look = {}) {
    const { color = this.color.text, size = 0.92, weight = 400, align = "left", plate = false } = look;
    const context = this.context;
    const runs = text.split(/(?<=\b[A-Za-z])_([a-z0-9])\b/).map((run, i) => ({ run, small: i % 2 === 1, width: 0 }));
    context.textAlign = "left";
    context.textBaseline = look.baseline ?? "alphabetic";
    for (const part of runs) {
      this.font(part.small ? 0.76 * size : size, weight);
      part.width = context.measureText(part.run).width;
    }
    const width = runs.reduce((sum, part) => sum + part.width, 0);
    let left = x - width * { left: 0, center: 0.5, right: 1 }[align];
    if (plate) {
      this.font(size, weight);
      const { fontBoundingBoxAscent: a, fontBoundingBoxDescent: d } = context.measureText(text);
      this.plate(left - 3, y - a - 1, width + 6, a + d + 2);
    }
    context.fillStyle = color;
    for (const { run, small, width: wide } of runs) {
      this.font(small ? 0.76 * size : size, weight);
      context.fillText(run, left, y + (small ? 0.28 * size * this.em : 0));
      left += wide;
    }
  }

  /** What lies under a text. @param {[x: number, y: number, w: number, h: number]} rect */
  plate(...rect) {
    this.context.save();
    this.context.globalAlpha = 0.82;
    this.context.fillStyle = this.color.panel;
    this.context.fillRect(...rect);
    this.context.restore();
  }

  /** What of a text has room in a width, as it is written next. */
  fitted(/** @type {string} */ text, /** @type {number} */ wide) {
    const fits = (/** @type {string} */ part) => this.context.measureText(part).width <= wide;
    let shown = text;
    for (let n = text.length - 1; n >= 0 && !fits(shown); n--) shown = n ? `${text.slice(0, n).trimEnd()}\u2026` : "";
    return shown;
  }

  /** A title above a pane; returns what is left of it. */
  titled(/** @type {Rect} */ rect, /** @type {string} */ title, detail = "") {
    const high = 1.7 * this.em;
    this.font(0.92, 600);
    const shown = this.fitted(title, rect.w);
    const used = this.context.measureText(shown).width + 0.6 * this.em;
    this.text(shown, rect.x, rect.y + 1.05 * this.em, { weight: 600 });
    this.font(0.92);
    const more = shown === title ? this.fitted(detail, rect.w - used) : "";
    this.text(more, rect.x + used, rect.y + 1.05 * this.em, { color: this.color.soft });
    return inset(rect, 0, high, 0, 0);
  }

  /**
   * A pane that shows a box of its own units, y down.
   * @param {string} key @param {Box} box @param {Rect} rect
   */
  pane(key, box, rect, { margin = 6, stretch = false } = {}) {
    const across = Math.max(1e-9, box.right - box.left);
    const down = Math.max(1e-9, box.bottom - box.top);
    let scaleX = (rect.w - 2 * margin) / across;
    let scaleY = (rect.h - 2 * margin) / down;
    if (!stretch) scaleX = scaleY = Math.max(1e-6, Math.min(scaleX, scaleY));
    const spare = rect.w - 2 * margin - scaleX * across;
    const map = new PaneMap(
      key,
      rect,
      scaleX,
      scaleY,
      rect.x + margin + spare / 2 - scaleX * box.left,
      rect.y + rect.h / 2 - (scaleY * (box.top + box.bottom)) / 2,
    );
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
    this.within(rect, () => {
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

  within(/** @type {Rect} */ rect, /** @type {() => void} */ draw) {
    const context = this.context;
    context.save();
    context.beginPath();
    context.rect(rect.x, rect.y, rect.w, rect.h);
    context.clip();
    draw();
    context.restore();
  }

  frame(/** @type {Rect} */ rect, color = this.color.line) {
    this.context.strokeStyle = color;
    this.context.lineWidth = 1;
    this.context.strokeRect(
      Math.round(rect.x) + 0.5,
      Math.round(rect.y) + 0.5,
      Math.round(rect.w) - 1,
      Math.round(rect.h) - 1,
    );
  }

  /** @param {PictureMap} map @param {Drawable} image @param {Box} box */
  picture(map, image, box, alpha = 1) {
    const [x0, y0] = map.at(box.left, box.top);
    const [x1, y1] = map.at(box.right, box.bottom);
    const context = this.context;
    context.save();
    context.globalAlpha = alpha;
    context.imageSmoothingEnabled = (devicePixelRatio * (x1 - x0)) / image.width < 2.5;
    context.imageSmoothingQuality = "high";
    context.drawImage(image, x0, y0, x1 - x0, y1 - y0);
    context.restore();
  }

  /**
   * A picture of another plane, moved here by (theta, u, v).
   * @param {PaneMap} map @param {Drawable} image @param {Box} box @param {Motion} parts
   */
  movedPicture(map, image, box, [theta, u, v], alpha = 1) {
    const context = this.context;
    context.save();
    context.translate(...map.at(u, v));
    context.rotate(theta);
    this.picture({ at: (a, b) => [map.scaleX * a, map.scaleY * b] }, image, box, alpha);
    context.restore();
  }

  /** @param {PictureMap} map @param {Numbers} points @param {number} radius @param {string} color */
  dots(map, points, radius, color) {
    const context = this.context;
    context.beginPath();
    const r = radius * this.weight;
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
   * @param {PictureMap} map @param {Numbers} points @param {Numbers} pairs @param {string} color
   * @param {number} width
   */
  segments(map, points, pairs, color, width, /** @type {((pair: number) => boolean) | null} */ pick = null) {
    const context = this.context;
    context.beginPath();
    for (let e = 0; e < pairs.length; e += 2) {
      if (pick && !pick(e / 2)) continue;
      const [a, b] = [2 * pairs[e], 2 * pairs[e + 1]];
      context.moveTo(...map.at(points[a], points[a + 1]));
      context.lineTo(...map.at(points[b], points[b + 1]));
    }
    this.stroke(color, width);
  }

  /** @param {UV} from @param {UV} to @param {string} color @param {number[]} dash */
  line(from, to, color, width = 1.5, dash = []) {
    const ends = [from, to].map(([x, y]) => ({ x, y }));
    strokeLine(this.context, ends, color, width > 1 ? width * this.weight : width, dash);
  }

  /**
   * A closed line through places [u0, v0, u1, v1, ...].
   * @param {PaneMap} map @param {Numbers} uv @param {string} color @param {number} width @param {number[]} dash
   */
  loop(map, uv, color, width, dash = []) {
    for (let i = 0, j = uv.length - 2; i < uv.length; j = i, i += 2)
      this.line(map.at(uv[j], uv[j + 1]), map.at(uv[i], uv[i + 1]), color, width, dash);
  }

  /** @param {UV} from @param {UV} to @param {string} color */
  arrow(from, to, color, width = 2) {
    const angle = Math.atan2(to[1] - from[1], to[0] - from[0]);
    const head = (4 + 2 * width) * this.weight;
    this.line(from, [to[0] - 0.7 * head * Math.cos(angle), to[1] - 0.7 * head * Math.sin(angle)], color, width);
    const context = this.context;
    context.beginPath();
    context.moveTo(...to);
    for (const side of [-0.45, 0.45])
      context.lineTo(to[0] - head * Math.cos(angle + side), to[1] - head * Math.sin(angle + side));
    context.fillStyle = color;
    context.fill();
  }

  /** @param {UV} place @param {number} radius @param {string} color */
  ring(place, radius, color, width = 2.5) {
    this.rimmed(color, width, () => this.context.arc(...place, radius * this.weight, 0, 2 * Math.PI));
  }

  /** Stroke what `path` traces, with a rim. @param {string} color @param {number} width @param {() => void} path */
  rimmed(color, width, path) {
    strokeRimmed(this.context, color, width * this.weight, path, this.color.panel, 3 * this.weight);
  }

  stroke(/** @type {string} */ color, /** @type {number} */ width) {
    this.context.strokeStyle = color;
    this.context.lineWidth = width * this.weight;
    this.context.stroke();
  }

  cross(/** @type {UV} */ [x, y], /** @type {string} */ color) {
    this.rimmed(color, 2, () => traceCross(this.context, x, y, 4 * this.weight, 13 * this.weight));
    this.ring([x, y], 8, color, 2);
  }

  /** A scale bar in the corner of a pane of the plane, whose unit is the metre. */
  scaleBar(/** @type {PaneMap} */ map) {
    const { rect } = map;
    const mm = niceLength((1000 * Math.min(120, 0.4 * rect.w)) / map.scaleX);
    const width = (mm / 1000) * map.scaleX;
    const [x, y] = [rect.x + 8, rect.y + rect.h - 7];
    this.font(0.85);
    const wide = Math.max(width, this.context.measureText(length(mm)).width);
    this.plate(x - 5, y - 1.7 * this.em, wide + 12, 1.7 * this.em + 5);
    strokeScale(this.context, x, y, width, this.color.text);
    this.text(length(mm), x + 4, y - 5, { size: 0.85 });
  }

  // --- the pointer ---------------------------------------------------------------------------

  listen() {
    const point = (/** @type {PointerEvent} */ event) => {
      const at = this.canvas.getBoundingClientRect();
      const [x, y] = [event.clientX - at.left, event.clientY - at.top];
      const map = this.panes.findLast(({ rect }) => inside(rect, x, y));
      if (map) this.handlers.probe(map.key, map.from(x, y));
    };
    this.canvas.addEventListener("pointerdown", point);
    this.canvas.addEventListener("pointermove", point);
  }
}
