// What placed a proposal: pairs of cloth, or the paper's corresponding lines.

import { PagePart } from "../page/page.js";
import { ask } from "../page/connection.js";
import { applied } from "../canvas/geometry.js";
import { drawDot, strokeLine } from "../canvas/marks.js";
import { byId, setText } from "../page/dom.js";
import { degrees, number } from "../page/format.js";
import { ClothPairs } from "./cloth_pairs.js";
import { symbols } from "../teaching/frame.js";

export class Diagnostics extends PagePart {
  name = "diagnostics";
  actions = { diagnostics: () => this.toggle() };
  open = false;
  known = /** @type {Known | null} */ (null); // what the server said
  asked = /** @type {string | null} */ (null);
  panel = byId("diagnostics");
  facts = byId("diagnostics-facts");
  trouble = byId("diagnostics-trouble");
  pairs = new ClothPairs(this.canvas);

  constructor(/** @type {Page} */ page) {
    super(page);
    byId("diagnostics-close").addEventListener("click", () => this.toggle());
  }

  /** @param {Context} context @param {Style} _ @param {PlaceInScene} place */
  drawInScene(context, _, place) {
    if (this.open && !this.panel.hidden) this.pairs.paintInSpace(context, place);
  }

  toggle() {
    this.open = !this.open;
    this.page.changed();
  }

  get pressed() {
    return { diagnostics: this.open };
  }

  /** Take a state; what it is about is fetched while the panel is open. */
  update(/** @type {State} */ state) {
    const { layers, pending } = state;
    const overlay = pending && layers?.overlay;
    const shown = this.open && Boolean(overlay);
    if (this.panel.hidden === shown) this.page.redrawMarks();
    this.panel.hidden = !shown;
    if (!shown || !overlay) return;
    const key = `${layers.revision}-${overlay.revision}`;
    if (key !== this.asked) this.ask(key, pending.view_index);
  }

  async ask(/** @type {string} */ key, /** @type {number} */ view) {
    this.asked = key;
    setText(byId("diagnostics-title"), `What placed view ${view}`);
    const answer = await ask(`diagnostics/${key}.json`);
    if (this.asked !== key) return;
    this.known = answer?.ok ? /** @type {Known} */ (await answer.json()) : null;
    if (this.known) {
      this.pairs.pairs = this.known.pairs;
      this.pairs.marked = null;
      this.showFacts(this.known);
    } else {
      setText(this.trouble, (await answer?.text()) ?? "There is no connection.");
      if (answer?.status === 410) this.asked = null; // the next state asks again
    }
    this.page.redrawMarks();
  }

  /** What is on the panel, for tests. */
  get status() {
    const { open, known, asked } = this;
    return { open, known, asked, pair: this.pairs.marked };
  }

  showFacts(/** @type {Known} */ { pairs, reasons: found }) {
    setText(this.trouble, pairs ? "" : found.trouble);
    if (pairs) return setText(this.facts, this.pairs.facts);
    const angle = number(this.page.state.views[found.front_view].angle_deg, 0);
    const lines = found.correspondence;
    const facts = [
      `Continues view ${found.front_view} (${angle}°) on the ${found.side}, turned by A = ${degrees(found.turn_deg, 0)}`,
      lines && `A_m = ${degrees(lines.a_m_deg)}, points at height ${number(1000 * lines.height_m, 0)} mm`,
    ];
    this.facts.replaceChildren(...symbols(facts.filter(Boolean).join(" · ")));
  }

  /** The pair of cloth under the pointer. */
  hover(/** @type {Place | null} */ at) {
    const pair = this.open ? this.pairs.nearest(at) : null;
    if (pair === this.pairs.marked) return;
    this.pairs.marked = pair;
    setText(byId("diagnostics-column"), this.pairs.textOf(pair));
    this.page.redrawMarks();
  }

  // --- on the canvas ---------------------------------------------------------------------------

  /** @param {Context} context @param {Style} style */
  drawOver(context, style) {
    if (!this.open || this.panel.hidden || !this.known) return;
    if (this.known.pairs) return this.pairs.paint(context);
    const { correspondence: lines, current_from_new: own } = this.known.reasons;
    if (!lines) return;
    this.paintLine(context, lines.current, (u, v) => [u, v], style.getPropertyValue("--kept"));
    const place = (/** @type {number} */ u, /** @type {number} */ v) =>
      applied([own.theta_rad, own.u_m, own.v_m], u, v);
    this.paintLine(context, lines.new, place, style.getPropertyValue("--new"));
  }

  at(/** @type {UV} */ [u, v]) {
    return this.canvas.transform.toPane(u, v);
  }

  /**
   * @param {Context} context @param {ZLine} line @param {(u: number, v: number) => UV} place
   * @param {string} color
   */
  paintLine(context, line, place, color) {
    context.fillStyle = color;
    context.globalAlpha = 0.55;
    for (const [u, v] of line.pixels_uv_m) {
      const { x, y } = this.at(place(u, v));
      context.fillRect(x - 1, y - 1, 2, 2);
    }
    context.globalAlpha = 1;
    const [cu, cv] = line.center_uv_m;
    const [du, dv] = line.direction;
    const along = line.pixels_uv_m.map(([u, v]) => (u - cu) * du + (v - cv) * dv);
    const ends = [Math.min(...along), Math.max(...along)].map((t) => this.at(place(cu + t * du, cv + t * dv)));
    strokeLine(context, ends, color, 2.5);
    drawDot(context, this.at(place(line.point_uv_m[0], line.point_uv_m[1])), color, 6);
  }
}
