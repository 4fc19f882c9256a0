// What placed a proposal: pairs of cloth, or the paper's curves, linked to the canvas, and lines.

import { PagePart } from "../page/page.js";
import { ask } from "../page/connection.js";
import { applied, unapplied } from "../canvas/geometry.js";
import { drawDot, strokeLine } from "../canvas/marks.js";
import { byId, make, rebuild, setText, taken, tickBox, within } from "../page/dom.js";
import { degrees, number } from "../page/format.js";
import { ClothPairs } from "./cloth_pairs.js";
import { columns, inside, rows, Sheet } from "../teaching/draw.js";
import { symbols } from "../teaching/frame.js";
import { Plot } from "../teaching/plot.js";

/** @typedef {"current" | "new"} Side */

const PLOTS = /** @type {Side[]} */ (["current", "new"]);
const FAR_M = 4;
const CURVES = "Curves over the columns. The arrow keys move the marked column.";
const HISTOGRAMS = "How many pairs of cloth lie how far apart, on the plane and in space.";

export class Diagnostics extends PagePart {
  name = "diagnostics";
  actions = { diagnostics: () => this.toggle() };
  open = false;
  wantsCurves = false; // though pairs are known
  known = /** @type {Known | null} */ (null); // what the server said
  asked = /** @type {string | null} */ (null);
  marked = /** @type {Partial<Record<Side, number>>} */ ({}); // column (mm) of each plot
  plots = /** @type {Partial<Record<Side, Plot>>} */ ({});
  /** @type {UV} */
  angles = [0, 1];
  panel = byId("diagnostics");
  plotCanvas = byId("diagnostics-canvas");
  sheet = new Sheet(this.plotCanvas, { redraw: () => this.draw(), probe: () => {} });
  title = byId("diagnostics-title");
  facts = byId("diagnostics-facts");
  trouble = byId("diagnostics-trouble");
  column = byId("diagnostics-column");
  choices = byId("diagnostics-choices");
  pairs = new ClothPairs(this.canvas, this.sheet);

  constructor(/** @type {Page} */ page) {
    super(page);
    byId("diagnostics-close").addEventListener("click", () => this.toggle());
    this.plotCanvas.addEventListener("pointermove", (event) => this.point(event));
    this.plotCanvas.addEventListener("pointerleave", () => this.mark({}));
    this.plotCanvas.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.open && this.draw()).observe(this.plotCanvas);
  }

  /** Whether pairs of cloth are shown, or else the paper's curves. */
  get showsPairs() {
    return Boolean(this.known?.pairs) && !this.wantsCurves;
  }

  /** @param {Context} context @param {Style} _ @param {PlaceInScene} place */
  drawInScene(context, _, place) {
    if (this.open && !this.panel.hidden && this.showsPairs) this.pairs.paintInSpace(context, place);
  }

  /** Draw the panel, the canvas and the scene again. */
  drawAll() {
    this.draw();
    this.page.redrawMarks();
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
    this.showChoices();
    const key = `${layers.revision}-${overlay.revision}`;
    if (key !== this.asked) this.ask(key, pending.view_index);
  }

  async ask(/** @type {string} */ key, /** @type {number} */ view) {
    this.asked = key;
    setText(this.title, `What placed view ${view}`);
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
    this.showChoices();
    this.drawAll();
  }

  /** What is on the panel, for tests. */
  get status() {
    const { open, known, marked, asked } = this;
    return { open, known, marked, asked, pair: this.showsPairs ? this.pairs.marked : null };
  }

  showChoices() {
    const change = (/** @type {boolean} */ on) => {
      this.wantsCurves = on;
      this.mark({});
      if (this.known) this.showFacts(this.known);
      this.showChoices();
      this.drawAll();
    };
    const tip = "The paper's curves and lines in place of the pairs of cloth";
    rebuild(this.choices, [this.showsPairs, Boolean(this.known?.pairs)], () => [
      this.known?.pairs && make("label", { tip }, tickBox(!this.showsPairs, change, { key: "Curves" }), "Curves"),
    ]);
  }

  showFacts(/** @type {Known} */ k) {
    setText(this.trouble, this.showsPairs ? "" : k.reasons.trouble);
    this.plotCanvas.setAttribute("aria-label", this.showsPairs ? HISTOGRAMS : CURVES);
    if (this.showsPairs) return setText(this.facts, this.pairs.facts);
    const name = (/** @type {number} */ view) =>
      `view ${view} (${number(this.page.state.views[view].angle_deg, 0)}°)`;
    const { reasons: found } = k;
    const lines = found.correspondence;
    const facts = [
      `Continues ${name(found.front_view)} on the ${found.side}, turned by A = ${degrees(found.turn_deg, 0)}`,
      `S_0 ${number(k.overlap_cm2, 0)} cm² at u_b = ${number(1000 * found.u_b_m, 0)} mm`,
      `A_0 = ${degrees(found.a_0_deg)}, so the paper would turn by ${degrees(found.rotation_deg, 0)}`,
      lines && `A_m = ${degrees(lines.a_m_deg)}, points at height ${number(1000 * lines.height_m, 0)} mm`,
    ];
    this.facts.replaceChildren(...symbols(facts.filter(Boolean).join(" · ")));
  }

  // --- the curves ------------------------------------------------------------------------------

  draw() {
    if (!this.open) return;
    const rect = this.sheet.begin();
    this.plots = {};
    if (!this.known) return;
    if (this.showsPairs) return this.pairs.drawPlots(rect);
    const { known } = this;
    const { limit_deg: limit, reasons } = known;
    const turn = reasons.turn_deg;
    const measured = PLOTS.flatMap((of) => curvesOf(known, of).a).filter((x) => x !== null);
    const all = [-limit, limit, -limit - turn, limit - turn, ...measured];
    this.angles = [30 * Math.floor((Math.min(...all) - 4) / 30), 30 * Math.ceil((Math.max(...all) + 4) / 30)];
    const split = rect.w > 1.3 * rect.h ? columns : rows;
    split(rect, [1, 1], 6).forEach((place, i) => this.drawPlot(PLOTS[i], place, known));
  }

  drawPlot(/** @type {Side} */ of, /** @type {Rect} */ place, /** @type {Known} */ k) {
    const { sheet } = this;
    const { color } = sheet;
    const { u, h, a } = curvesOf(k, of);
    const { reasons, limit_deg } = k;
    const lines = reasons.correspondence;
    const turn = of === "new" ? reasons.turn_deg : 0;
    const title = of === "new" ? `New: view ${reasons.view_index}` : `Shape, at view ${reasons.front_view}`;
    const inner = sheet.titled(place, title);
    const most = Math.max(1, ...h);
    /** @type {UV} */
    const ends = u.length ? [u[0], u[u.length - 1]] : [0, 1];
    const plot = new Plot(sheet, inner, {
      x: ends,
      y: this.angles,
      y2: [0, 1.08 * most],
      xLabel: "u (mm)",
      yLabel: turn ? "A_z − A (°)" : "A_z (°)",
      y2Label: "h (px)",
      yColor: color.mean,
      y2Color: color.count,
    });
    this.plots[of] = plot;
    plot.area(u, h, color.count, 0, u.length - 1, plot.y2, 0.14);
    plot.curve(u, h, color.count, { scale: plot.y2, width: 1.5 });
    if (lines) plot.band(...lines.common_range_deg, color.soft, 0.18);
    for (const limit of [-limit_deg, limit_deg]) plot.horizontal(limit - turn, color.limit, limit > 0 ? "A_w" : "");
    const shifted = (/** @type {number} */ by) => a.map((x) => (x === null ? NaN : x - by));
    if (turn) plot.curve(u, shifted(0), color.before, { width: 1.2, dash: [4, 3] });
    plot.curve(u, shifted(turn), color.mean);
    if (lines) plot.horizontal(lines.a_m_deg, color.band, "A_m", [2, 3]);
    if (of === "current" && reasons.u_b_m !== null) {
      const end = 1000 * reasons.u_b_m;
      const b = nearest(u, end);
      const isLeft = reasons.side === "left";
      plot.area(u, h, color.accent, isLeft ? 0 : b, isLeft ? b : u.length - 1, plot.y2, 0.2);
      plot.vertical(end, color.accent, "u_b", 1.5, [], true);
      const [x, y] = plot.at(end, reasons.a_0_deg ?? NaN);
      sheet.ring([x, y], 4, color.accent, 2);
      sheet.text("A_0", x + 7, y - 5, { color: color.accent, weight: 600, plate: true });
    }
    const marked = this.marked[of] ?? NaN;
    if (marked >= ends[0] && marked <= ends[1]) plot.vertical(marked, color.mark, "", 1.5);
  }

  /** Mark columns, {current, new} in mm, in the plots and on the canvas. */
  mark(/** @type {Partial<Record<Side, number>>} */ marked) {
    this.marked = marked;
    const { known } = this;
    if (!known) return;
    const texts = PLOTS.flatMap((of) => {
      const x = marked[of];
      if (x === undefined) return [];
      const { u, h, a, pixelMm } = curvesOf(known, of);
      const at = nearest(u, x);
      const off = at < 0 || Math.abs(u[at] - x) > pixelMm;
      const values = off ? "no cloth" : `h ${h[at]} px, A_z ${degrees(a[at])}`;
      return [`${of === "new" ? "New" : "Shape"} u ${number(x, 0)} mm: ${values}`];
    });
    this.column.replaceChildren(...symbols(texts.join("  ·  ")));
    this.draw();
    this.canvas.redraw();
  }

  markPair(/** @type {number | null} */ n) {
    if (n === this.pairs.marked) return;
    this.pairs.marked = n;
    setText(this.column, this.pairs.textOf(n));
    this.drawAll();
  }

  point(/** @type {PointerEvent} */ event) {
    if (this.showsPairs) return;
    const [x, y] = [event.offsetX, event.offsetY];
    for (const of of PLOTS) {
      const plot = this.plots[of];
      if (!plot || !inside(plot.inner, x, y)) continue;
      const [low, high] = plot.x;
      return this.mark({ [of]: low + ((x - plot.inner.x) / plot.inner.w) * (high - low) });
    }
    this.mark({});
  }

  key(/** @type {KeyboardEvent} */ event) {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!step || !this.known || this.showsPairs) return;
    taken(event); // here the arrows move the column, not the proposal
    const of = PLOTS.find((name) => this.marked[name] !== undefined) ?? "current";
    const { u } = curvesOf(this.known, of);
    const marked = this.marked[of];
    const at = marked === undefined ? 0 : nearest(u, marked) + step * (event.shiftKey ? 10 : 1);
    this.mark({ [of]: u[within(at, 0, u.length - 1)] });
  }

  /** The pointer is at a place of the plane: its column is marked in both plots. */
  hover(/** @type {Place | null} */ at) {
    if (!this.open || !this.known) return;
    if (this.showsPairs) return this.markPair(this.pairs.nearest(at));
    if (!at) return this.mark({});
    const front = applied(motionOf(this.known.reasons.front_from_current), at.u_m, at.v_m);
    const own = unapplied(motionOf(this.known.reasons.current_from_new), at.u_m, at.v_m);
    this.mark({ current: 1000 * front[0], new: 1000 * own[0] });
  }

  // --- on the canvas ---------------------------------------------------------------------------

  drawOver(/** @type {Context} */ context) {
    if (!this.open || this.panel.hidden || !this.known) return;
    const { correspondence: lines, front_from_current: front, current_from_new: own } = this.known.reasons;
    /** @type {Record<Side, (u: number, v: number) => UV>} */
    const toPlane = {
      current: (u, v) => unapplied(motionOf(front), u, v),
      new: (u, v) => applied(motionOf(own), u, v),
    };
    if (this.showsPairs) return this.pairs.paint(context);
    if (lines) {
      this.paintLine(context, lines.current, (u, v) => [u, v], this.sheet.color.kept);
      this.paintLine(context, lines.new, toPlane.new, this.sheet.color.new);
    }
    for (const of of PLOTS) {
      const u_mm = this.marked[of];
      if (u_mm === undefined) continue;
      const ends = [-FAR_M, FAR_M].map((v) => this.at(toPlane[of](u_mm / 1000, v)));
      strokeLine(context, ends, this.sheet.color.mark, 1.5, of === "new" ? [6, 4] : []);
    }
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

/** Curves as they are plotted: columns in mm, h and A_z. @param {Known} known @param {Side} of */
function curvesOf({ reasons }, of) {
  const curves = of === "new" ? reasons.new_curves : reasons.curves;
  const { u_m, column_count: h, column_mean_z_angle_deg: a, pixel_size_m } = curves;
  return { u: u_m.map((u) => 1000 * u), h, a, pixelMm: 1000 * pixel_size_m };
}

/** @param {import("../page/messages").Rigid2} motion @returns {Motion} */
const motionOf = ({ theta_rad, u_m, v_m }) => [theta_rad, u_m, v_m];

/** The index of the value nearest to x in an even sequence, -1 if it is empty. */
function nearest(/** @type {Numbers} */ values, /** @type {number} */ x) {
  if (!values.length) return -1;
  const step = values.length > 1 ? values[1] - values[0] : 1;
  return within(Math.round((x - values[0]) / step), 0, values.length - 1);
}
