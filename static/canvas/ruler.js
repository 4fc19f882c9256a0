// The ruler: drag on the flattened view; the length straight on it, along the cloth, and through the air.

import { PagePart } from "../page/page.js";
import { byId, make } from "../page/dom.js";
import { mm } from "../page/format.js";

const LEAST_PX = 3;

/** @typedef {{ from: { u: number; v: number }; to: { u: number; v: number } }} Line */

export class Ruler extends PagePart {
  actions = { ruler: () => this.toggle() };
  on = false;
  line = /** @type {Line | null} */ (null);
  measured = /** @type {Measured | null} */ (null);
  start = { x: 0, y: 0, u: 0, v: 0 };
  revision = "";
  question = this.page.question(
    "measured",
    (id, /** @type {Line} */ line) => this.send(id, line),
    (answer) => this.take(answer),
  );
  messages = { note: () => this.question.lost() }; // what was asked may have been refused
  label = byId("ruler-label");

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
    this.question.drop();
    this.canvas.redraw();
  }

  /** The shape at a revision is shown: what was measured on another holds no longer. */
  update(/** @type {State} */ state) {
    byId("canvas").classList.toggle("measuring", this.on);
    if (state.mode === "camera") return;
    const revision = `${this.canvas.side} ${state.layers?.revision}`;
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

  /** What was measured on one side is not on the other. */
  turned() {
    this.clear();
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
    if (this.line) this.question.ask(this.line);
  }

  send(/** @type {number} */ id, /** @type {Line} */ { from, to }) {
    const [a, b] = [from, to].map(({ u, v }) => this.canvas.located(u, v));
    if (a.sheet !== b.sheet) return false; // no length of cloth is between both sides
    const ends = { from_u_m: a.u_m, from_v_m: a.v_m, to_u_m: b.u_m, to_v_m: b.v_m };
    return this.page.send({ type: "measure", id, ...ends, sheet: a.sheet });
  }

  take(/** @type {Measured} */ answer) {
    if (this.line && !this.question.wanted) this.measured = answer;
    this.canvas.redraw();
  }

  drawOver(/** @type {Pen} */ pen) {
    this.label.hidden = !this.line;
    if (!this.line) return;
    const [a, b] = [this.line.from, this.line.to].map(({ u, v }) => pen.at([u, v]));
    const { sheet } = this.canvas.located(this.line.from.u, this.line.from.v);
    const path = (this.measured?.path_uv_m ?? []).flatMap((uv) => {
      const there = this.canvas.shownAt(sheet, uv);
      return there ? [pen.at(there)] : [];
    });
    for (const { line, dash } of [
      { line: path, dash: [5, 4] },
      { line: [a, b], dash: [] },
    ]) {
      if (line === path && path.length <= 2) continue;
      pen.line(line, "#fff", 4); // so that it is seen on any cloth
      pen.line(line, "--accent", 2, dash);
    }
    for (const end of [a, b]) pen.dot(end, "--accent", 4);
    this.showLabel(this.line, b);
  }

  showLabel(/** @type {Line} */ { from, to }, /** @type {Point} */ end) {
    const { measured, canvas, label } = this;
    const flat = measured?.flat_mm ?? 1000 * Math.hypot(to.u - from.u, to.v - from.v);
    const round = measured && measured.path_uv_m.length > 2 ? "along the cloth, round" : "along the cloth";
    /** @type {[number | null | undefined, string][]} */
    const rows = [
      [flat, "flat"],
      [measured?.cloth_mm, round],
      [measured?.air_mm, "through the air"],
    ];
    label.replaceChildren(
      ...rows.map(([value, text]) =>
        make("span", make("b", value === undefined || value === null ? "–" : mm(value)), ` ${text}`),
      ),
    );
    const left = Math.min(canvas.width - label.offsetWidth - 6, Math.max(6, end.x + 14));
    const top = Math.min(canvas.height - label.offsetHeight - 6, Math.max(6, end.y + 10));
    label.style.transform = `translate(${Math.round(left)}px, ${Math.round(top)}px)`;
  }
}
