// What placed a proposal: pairs of cloth, or the paper's corresponding lines.

import { PagePart } from "../page/page.js";
import { askJson, Fetched } from "../page/connection.js";
import { applied, nearest } from "../canvas/geometry.js";
import { drawDot, strokeLine } from "../canvas/marks.js";
import { byId, setText } from "../page/dom.js";
import { degrees, number, count } from "../page/format.js";
import { symbols } from "../teaching/frame.js";

export class Diagnostics extends PagePart {
  name = "diagnostics";
  actions = { diagnostics: () => this.toggle() };
  open = false;
  /** @type {Fetched<Known>} */
  fetched = new Fetched(askJson, () => this.show());
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
    if (this.open && !this.panel.hidden && this.known) this.pairs.paintInSpace(context, place);
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
    setText(byId("diagnostics-title"), `What placed view ${pending.view_index}`);
    this.fetched.want(`diagnostics/${layers.revision}-${overlay.revision}.json`);
  }

  /** What the server said; null until then. */
  get known() {
    return this.fetched.value;
  }

  show() {
    if (!this.known) return;
    this.pairs.pairs = this.known.pairs;
    this.pairs.marked = null;
    this.showFacts(this.known);
    this.page.redrawMarks();
  }

  /** What is on the panel, for tests. */
  get status() {
    return { open: this.open, known: this.known, pair: this.pairs.marked };
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

// --- The pairs of cloth that fixed a proposal's place ------------------------------------------

const STRETCH = 10; // lines on the canvas are drawn so many times as long: a millimetre would not be seen
const NEAR_PX = 14;
const COLORS = ["#2c7bb6", "#e67e00", "#b3261e"]; // below a third of the limit, below the limit, beyond it

class ClothPairs {
  constructor(/** @type {FlatCanvas} */ canvas) {
    this.canvas = canvas;
    this.pairs = /** @type {Pairs | null} */ (null); // none before the first proposal, or if curves placed it
    this.marked = /** @type {number | null} */ (null); // number of a pair
  }

  /** What the pairs say, in a line. */
  get facts() {
    if (!this.pairs) return "";
    const { total, median_mm, nine_tenths_mm, beyond_share, limit_mm, apart_median_mm } = this.pairs;
    return (
      `${count(total, "pair")} of points that are the same cloth in the shape and in the proposal. ` +
      `Distance on the plane: median ${number(median_mm)} mm, 90 % within ${number(nine_tenths_mm)} mm, ` +
      `${number(100 * beyond_share, 0)} % over the limit of ${number(limit_mm, 0)} mm. ` +
      `Distance in space: median ${number(apart_median_mm)} mm. ` +
      `The lines on the canvas are drawn ${STRETCH} times as long, so that they can be seen.`
    );
  }

  textOf(/** @type {number | null} */ n) {
    if (n === null || !this.pairs) return "";
    const { residual_mm: off, apart_mm: apart } = this.pairs;
    return `This pair: ${number(off[n])} mm apart on the plane, ${number(apart[n])} mm in space.`;
  }

  // --- on the canvas and in 3D -------------------------------------------------------------------

  /** The pair at a place of the plane, null if none is near. */
  nearest(/** @type {Place | null} */ at) {
    if (!at || !this.pairs) return null;
    const { transform } = this.canvas;
    const { shape_uv_m: places } = this.pairs;
    const placesOf = (/** @type {number} */ n) => [transform.toPane(...places[n])];
    return nearest(places.keys(), placesOf, transform.toPane(at.u_m, at.v_m), NEAR_PX);
  }

  paint(/** @type {Context} */ context) {
    const { shape_uv_m: from, placed_uv_m: to } = this.pairs ?? { shape_uv_m: [], placed_uv_m: [] };
    from.forEach((uv, n) => {
      const [u, v] = uv.map((value, i) => value + STRETCH * (to[n][i] - value));
      this.paintPair(context, n, this.canvas.transform.toPane(...uv), this.canvas.transform.toPane(u, v), 1.25);
    });
  }

  paintInSpace(/** @type {Context} */ context, /** @type {PlaceInScene} */ place) {
    const { shape_xyz_m: from, new_xyz_m: to } = this.pairs ?? { shape_xyz_m: [], new_xyz_m: [] };
    from.forEach((point, n) => this.paintPair(context, n, place(point), place(to[n]), 1.5));
  }

  /**
   * @param {Context} context @param {number} n @param {Point | null} a @param {Point | null} b
   * @param {number} width
   */
  paintPair(context, n, a, b, width) {
    if (!a || !b || !this.pairs) return;
    const color = colorAt(this.pairs.residual_mm[n], this.pairs.limit_mm);
    const on = n === this.marked;
    strokeLine(context, [a, b], color, on ? 3 : width);
    if (on) return drawDot(context, a, color, 6);
    context.fillStyle = color;
    context.fillRect(a.x - 1, a.y - 1, 2.5, 2.5);
  }
}

/** @param {number} mm @param {number | null} limit */
const colorAt = (mm, limit) => COLORS[limit === null || mm <= limit / 3 ? 0 : mm <= limit ? 1 : 2];
