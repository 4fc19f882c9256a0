// The ruler: drag on the flattened view; the length straight on it, along the cloth, and through the air.

import { drawDot, strokeLine } from "/static/canvas/marks.js";
import { byId, make } from "/static/page/dom.js";
import { number } from "/static/page/format.js";

const LEAST_PX = 3;

export class Ruler {
  name = "ruler";

  constructor(/** @type {Page} */ page) {
    this.page = page;
    this.canvas = page.canvas;
    this.actions = { ruler: () => this.toggle() };
    /** @type {Panel["messages"]} */
    this.messages = { measured: (message) => this.take(message), note: () => this.disconnected() };
    this.on = false;
    /** @type {{ from: { u: number; v: number }; to: { u: number; v: number } } | null} */
    this.line = null;
    /** @type {import("/static/page/messages").Measured | null} */
    this.measured = null;
    this.start = { x: 0, y: 0, u: 0, v: 0 };
    /** @type {number | undefined} */
    this.revision = undefined;
    this.id = 0;
    this.waiting = false;
    this.label = make("output.ruler-label", { hidden: true });
    byId("stage").append(this.label);
    this.canvas.tools.push(this);
    this.canvas.drawers.push((_, context, style) => this.draw(context, style));
  }

  toggle() {
    this.on = !this.on;
    if (!this.on) this.clear();
    this.page.changed();
  }

  /** Escape clears what is measured, then puts the ruler away; whether there was anything to do. */
  escape() {
    if (!this.on) return false;
    if (this.line) this.clear();
    else this.toggle();
    return true;
  }

  get pressed() {
    return { ruler: this.on };
  }

  clear() {
    this.line = this.measured = null;
    this.id += 1;
    this.canvas.redraw();
  }

  /** The shape at a revision is shown: what was measured on another holds no longer. */
  update(/** @type {State} */ state) {
    if (state.mode === "live") return;
    const revision = state.layers?.revision;
    if (revision === this.revision) return;
    this.revision = revision;
    if (this.line) this.ask();
  }

  // --- a tool of the canvas --------------------------------------------------------------------

  press(/** @type {PointerPlace} */ at) {
    if (!this.on || !this.canvas.layer.shown) return false;
    this.start = at;
    this.clear();
    return true;
  }

  drag(/** @type {PointerPlace} */ at) {
    if (!this.line && Math.hypot(at.x - this.start.x, at.y - this.start.y) < LEAST_PX) return;
    this.line = { from: { u: this.start.u, v: this.start.v }, to: { u: at.u, v: at.v } };
    this.ask();
    this.canvas.redraw();
  }

  release(/** @type {PointerPlace} */ at) {
    this.drag(at);
  }

  // --- the measure -----------------------------------------------------------------------------

  ask() {
    this.measured = null;
    if (this.waiting || !this.line) return;
    const { from, to } = this.line;
    this.id += 1;
    this.asked = this.line;
    this.waiting = this.page.send({
      type: "measure",
      id: this.id,
      from_u_m: from.u,
      from_v_m: from.v,
      to_u_m: to.u,
      to_v_m: to.v,
    });
  }

  take(/** @type {import("/static/page/messages").Measured} */ answer) {
    this.waiting = false;
    if (!this.line) return;
    if (this.asked === this.line && answer.id === this.id) this.measured = answer;
    else this.ask();
    this.canvas.redraw();
  }

  /** The connection was lost, or something was refused: what was asked may never be answered. */
  disconnected() {
    this.waiting = false;
  }

  draw(/** @type {Context} */ context, /** @type {Style} */ style) {
    this.label.hidden = !this.line;
    if (!this.line) return;
    const at = this.canvas.transform;
    const [a, b] = [this.line.from, this.line.to].map(({ u, v }) => at.toPane(u, v));
    const color = style.getPropertyValue("--accent");
    const path = (this.measured?.path_uv_m ?? []).map(([u, v]) => at.toPane(u, v));
    if (path.length > 2) stroke(context, path, color, [5, 4]);
    stroke(context, [a, b], color, []);
    for (const end of [a, b]) drawDot(context, end, color, 4);
    this.showLabel(b);
  }

  showLabel(/** @type {Point} */ end) {
    const { measured, canvas } = this;
    const { from, to } = /** @type {NonNullable<Ruler["line"]>} */ (this.line);
    const flat = measured?.flat_mm ?? 1000 * Math.hypot(to.u - from.u, to.v - from.v);
    /** @param {string} value @param {string} text */
    const row = (value, text) => make("span", make("b", value), ` ${text}`);
    const mm = (/** @type {number | null | undefined} */ value) =>
      value === null || value === undefined ? "–" : `${number(value)} mm`;
    const round = measured && measured.path_uv_m.length > 2 ? "along the cloth, round" : "along the cloth";
    this.label.replaceChildren(
      row(mm(flat), "flat"),
      row(mm(measured?.cloth_mm), round),
      row(mm(measured?.air_mm), "through the air"),
    );
    const left = Math.min(canvas.width - this.label.offsetWidth - 6, Math.max(6, end.x + 14));
    const top = Math.min(canvas.height - this.label.offsetHeight - 6, Math.max(6, end.y + 10));
    this.label.style.transform = `translate(${Math.round(left)}px, ${Math.round(top)}px)`;
  }
}

/**
 * A line that is seen on any cloth.
 * @param {Context} context @param {Point[]} points @param {string} color @param {number[]} dash
 */
function stroke(context, points, color, dash) {
  strokeLine(context, points, "#fff", 4);
  strokeLine(context, points, color, 2, dash);
}
