// What placed a proposal: pairs of cloth, or the paper's corresponding lines.

import { PagePart } from "../page/page.js";
import { askJson, Fetched } from "../page/connection.js";
import { applied, endsOf, nearest } from "../canvas/geometry.js";
import { byId, setText } from "../page/dom.js";
import { degrees, number, count } from "../page/format.js";
import { symbols } from "../teaching/frame.js";

const STRETCH = 10; // lines of pairs on the canvas are drawn so many times as long: a millimetre would not be seen
const NEAR_PX = 14;
const COLORS = ["#2c7bb6", "#e67e00", "#b3261e"]; // below a third of the limit, below the limit, beyond it

export class Diagnostics extends PagePart {
  name = "diagnostics";
  actions = { diagnostics: () => this.toggle() };
  open = false;
  /** @type {Fetched<Known>} */
  fetched = new Fetched(askJson, () => this.show());
  marked = /** @type {number | null} */ (null); // number of a pair
  panel = byId("diagnostics");

  constructor(/** @type {Page} */ page) {
    super(page);
    byId("diagnostics-close").addEventListener("click", () => this.toggle());
  }

  toggle() {
    this.open = !this.open;
    this.page.changed();
  }

  get pressed() {
    return { diagnostics: this.open };
  }

  /** What is on the panel; null: it is closed, or nothing is known yet. */
  get known() {
    return this.panel.hidden ? null : this.fetched.value;
  }

  /** Take a state; what it is about is fetched while the panel is open. */
  update(/** @type {State} */ { layers, pending }) {
    const overlay = pending && layers?.overlay;
    const shown = this.open && Boolean(overlay);
    if (this.panel.hidden === shown) this.page.redrawMarks();
    this.panel.hidden = !shown;
    if (!shown || !overlay) return;
    setText(byId("diagnostics-title"), `What placed view ${pending.view_index}`);
    this.fetched.want(`diagnostics/${layers.revision}-${overlay.revision}.json`);
  }

  show() {
    if (!this.known) return;
    this.marked = null;
    const { pairs, reasons } = this.known;
    setText(byId("diagnostics-trouble"), pairs ? "" : reasons.trouble);
    byId("diagnostics-facts").replaceChildren(...(pairs ? [factsOf(pairs)] : symbols(this.linesOf(reasons))));
    this.page.redrawMarks();
  }

  /** What the paper's lines are, in a line. */
  linesOf(/** @type {Known["reasons"]} */ { front_view, side, turn_deg, correspondence: lines }) {
    const angle = degrees(this.page.state.views[front_view].angle_deg, 0);
    const facts = [
      `Continues view ${front_view} (${angle}) on the ${side}, turned by A = ${degrees(turn_deg, 0)}`,
      lines && `A_m = ${degrees(lines.a_m_deg)}, points at height ${number(1000 * lines.height_m, 0)} mm`,
    ];
    return facts.filter(Boolean).join(" · ");
  }

  /** The pair of cloth under the pointer. */
  hover(/** @type {Place | null} */ at) {
    const { pen } = this.canvas;
    const { pairs } = this.known ?? {};
    const places = pairs?.shape_uv_m ?? [];
    const pair = at ? nearest(places.keys(), (n) => [pen.at(places[n])], pen.at([at.u_m, at.v_m]), NEAR_PX) : null;
    if (pair === this.marked) return;
    this.marked = pair;
    setText(byId("diagnostics-column"), pairs && pair !== null ? textOf(pairs, pair) : "");
    this.page.redrawMarks();
  }

  // --- on the canvas and in 3D -------------------------------------------------------------------

  drawOver(/** @type {Pen} */ pen) {
    if (!this.known) return;
    const { pairs, reasons } = this.known;
    pairs?.shape_uv_m.forEach((from, n) => {
      const [u, v] = from.map((value, i) => value + STRETCH * (pairs.placed_uv_m[n][i] - value));
      this.drawPair(pen, pairs, n, pen.at(from), pen.at([u, v]), 1.25);
    });
    const { correspondence: lines, current_from_new: own } = reasons;
    if (pairs || !lines) return;
    drawLine(pen, lines.current, [0, 0, 0], "--kept");
    drawLine(pen, lines.new, [own.theta_rad, own.u_m, own.v_m], "--new");
  }

  drawInScene(/** @type {Pen} */ pen, /** @type {PlaceInScene} */ place) {
    const { pairs } = this.known ?? {};
    pairs?.shape_xyz_m.forEach((from, n) =>
      this.drawPair(pen, pairs, n, place(from), place(pairs.new_xyz_m[n]), 1.5),
    );
  }

  /**
   * @param {Pen} pen @param {Pairs} pairs @param {number} n @param {Point | null} a @param {Point | null} b
   * @param {number} width
   */
  drawPair(pen, { residual_mm, limit_mm }, n, a, b, width) {
    if (!a || !b) return;
    const color = colorAt(residual_mm[n], limit_mm);
    const on = n === this.marked;
    pen.line([a, b], color, on ? 3 : width);
    if (on) pen.dot(a, color, 6);
    else pen.squares([a], color, 2.5);
  }
}

/** @param {Pen} pen @param {ZLine} line @param {Motion} motion @param {string} color */
function drawLine(pen, line, motion, color) {
  const at = (/** @type {UV} */ uv) => pen.at(applied(motion, ...uv));
  pen.squares(line.pixels_uv_m.map(at), color, 2, 0.55);
  pen.line(endsOf(line).map(at), color, 2.5);
  pen.dot(at([line.point_uv_m[0], line.point_uv_m[1]]), color, 6);
}

/** What pairs of cloth say, in a line. */
const factsOf = (
  /** @type {Pairs} */ { total, median_mm, nine_tenths_mm, beyond_share, limit_mm, apart_median_mm },
) =>
  `${count(total, "pair")} of points that are the same cloth in the shape and in the proposal. ` +
  `Distance on the plane: median ${number(median_mm)} mm, 90 % within ${number(nine_tenths_mm)} mm, ` +
  `${number(100 * beyond_share, 0)} % over the limit of ${number(limit_mm, 0)} mm. ` +
  `Distance in space: median ${number(apart_median_mm)} mm. ` +
  `The lines on the canvas are drawn ${STRETCH} times as long, so that they can be seen.`;

const textOf = (/** @type {Pairs} */ { residual_mm, apart_mm }, /** @type {number} */ n) =>
  `This pair: ${number(residual_mm[n])} mm apart on the plane, ${number(apart_mm[n])} mm in space.`;

/** @param {number} mm @param {number | null} limit */
const colorAt = (mm, limit) => COLORS[limit === null || mm <= limit / 3 ? 0 : mm <= limit ? 1 : 2];
