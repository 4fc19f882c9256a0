// Repair of a proposal: how it fits while it is moved, refinement from there, and pairs of points to fit.

import { PagePart } from "../page/page.js";
import { applied, unapplied } from "../canvas/geometry.js";
import { byId, closeButton, make, section, setText } from "../page/dom.js";
import { cm2, number } from "../page/format.js";

const REACH_PX = 11;
const SEEN_EVERY_MS = 60;
const LEAST_GAIN = 0.005; // of the score

/** @typedef {{ own: UV; shape: UV | null }} Pair `own` is a place in the proposal's own plane */
/** @typedef {Point & { pair: Pair; index: number; end: "own" | "shape" }} End */

export class Repair extends PagePart {
  actions = {
    pairs: () => this.toggle(),
    fit_pairs: () => this.sendPairs(true),
    refine: () => this.view !== null && this.page.send({ type: "refine", view_index: this.view }),
  };
  question = this.page.question(
    "preview",
    (id, /** @type {By} */ by) => this.askFit(id, by),
    (answer) => this.showFit(answer),
    SEEN_EVERY_MS,
  );
  /** @type {Panel["messages"]} */
  messages = { pairs: (message) => this.takePairs(message) };
  picking = false;
  view = /** @type {number | null} */ (null); // that the pairs are about
  pairs = /** @type {Pair[]} */ ([]);
  fit = /** @type {PairsAnswer | null} */ (null); // residuals as the server tells them
  held = /** @type {End | null} */ (null); // the marker that is being dragged

  update(/** @type {State} */ { pending }) {
    const view = pending?.view_index ?? null;
    if (this.view !== view) {
      this.view = view;
      this.clear();
      this.picking = false;
    }
    byId("repair").hidden = !pending;
    if (!pending) return;
    this.showPieces(pending);
    this.showPairs();
  }

  /** The connected parts of the view, if it has several: which one is placed. */
  showPieces(/** @type {Pending} */ { pieces, view_index }) {
    const key = pieces.length > 1 && [pieces, view_index];
    section("pieces", key, () => pieces.map((piece) => this.piece(piece, view_index)));
  }

  piece(/** @type {Pending["pieces"][number]} */ piece, /** @type {number} */ view_index) {
    const { component, area_cm2, waits, chosen } = piece;
    return make(
      "button.button",
      {
        pressed: chosen,
        key: `piece-${component}`,
        tip: waits
          ? "Nothing connects this part to the shape yet; it floats until something does.\nClick: place it by hand."
          : "Place this part of the view.",
        click: () => chosen || this.page.send({ type: "take_part", view_index, component }),
      },
      make("span.unseen", "Part "),
      make("b", String(component + 1)),
      ` ${cm2(area_cm2)}${waits ? " floats" : ""}`,
    );
  }

  /** The proposal is drawn anew where the server has moved it: its fit and residuals are others now. */
  placed() {
    this.moving({ theta: 0, u: 0, v: 0 });
    this.askResiduals();
  }

  clear() {
    this.pairs = [];
    this.fit = null;
    setText(byId("fit-here"), "");
    this.canvas.redraw();
  }

  // --- how it fits -----------------------------------------------------------------------------

  /** Ask how the proposal would fit, moved by `by`. */
  moving(/** @type {By} */ by) {
    this.question.ask({ ...by });
  }

  askFit(/** @type {number} */ id, /** @type {By} */ { theta, u, v }) {
    const { view } = this;
    return (
      view !== null && this.page.send({ type: "preview", id, view_index: view, theta_rad: theta, u_m: u, v_m: v })
    );
  }

  showFit(/** @type {PreviewAnswer} */ message) {
    if (this.view === null) return;
    /** @param {number | null} score @param {number | null} mm */
    const fit = (score, mm) => `${number(score, 2)}${mm === null ? "" : `, ${number(mm)} mm apart`}`;
    const [score, refined] = [message.score ?? 0, message.refined_score ?? 0];
    const better = `Refined from here: ${fit(refined, message.refined_apart_mm)}.`;
    const here = this.canvas.isMoved ? `At this place: score ${fit(message.score, message.apart_mm)}. ` : "";
    setText(byId("fit-here"), message.why || here + (refined - score < LEAST_GAIN ? "" : better));
  }

  // --- pairs -----------------------------------------------------------------------------------

  toggle() {
    this.picking = !this.picking;
    this.canvas.redraw();
    this.page.changed();
  }

  escape() {
    if (!this.picking) return false;
    this.toggle();
    return true;
  }

  get pressed() {
    return { pairs: this.picking };
  }

  /** A click on the plane; returns whether it was meant for a pair. */
  click(/** @type {number} */ u, /** @type {number} */ v) {
    if (!this.picking || this.view === null) return false;
    const open = this.pairs.at(-1);
    if (open && !open.shape) {
      open.shape = [u, v];
      this.askResiduals();
    } else if (this.canvas.overlay.covers(...this.unmoved(u, v))) {
      this.pairs.push({ own: this.toOwn(u, v), shape: null });
      this.fit = null;
    } else {
      this.page.notify("info", "Click a point on the proposal first, then where it belongs on the shape.");
    }
    this.showPairs();
    this.canvas.redraw();
    return true;
  }

  remove(/** @type {number} */ index) {
    this.pairs.splice(index, 1);
    this.fit = null;
    this.showPairs();
    this.askResiduals();
    this.canvas.redraw();
  }

  askResiduals() {
    if (this.whole().length > 1) this.sendPairs(false);
  }

  sendPairs(/** @type {boolean} */ fit) {
    if (this.view === null) return;
    const whole = this.whole();
    this.page.send({
      type: "pairs",
      view_index: this.view,
      fit,
      new_uv_m: whole.map((p) => p.own),
      shape_uv_m: whole.map((p) => /** @type {UV} */ (p.shape)),
    });
  }

  takePairs(/** @type {PairsAnswer} */ message) {
    if (message.residual_mm.length !== this.whole().length) return; // of pairs before
    this.fit = message;
    this.showPairs();
  }

  whole() {
    return this.pairs.filter((p) => p.shape);
  }

  showPairs() {
    const enough = this.whole().length > 1;
    const isShown = this.picking || this.pairs.length > 0;
    section("pairs", isShown && [this.picking, this.pairs.map((p) => Boolean(p.shape)), this.fit], () => [
      make("p.note", this.nextClick()),
      this.pairs.length > 0 && make("ol.pairs", ...this.pairs.map((pair, i) => this.row(pair, i))),
      enough &&
        this.page.button("fit_pairs", this.fit ? `Fit pairs: ${number(this.fit.rms_mm)} mm rms` : "Fit pairs"),
    ]);
  }

  nextClick() {
    if (!this.picking) return "Press Pairs (P) to pick more.";
    return this.pairs.at(-1)?.shape === null
      ? "Now click where it belongs on the shape."
      : "Click a point on the proposal.";
  }

  row(/** @type {Pair} */ pair, /** @type {number} */ index) {
    const residual = this.fit?.residual_mm[index];
    const text = !pair.shape
      ? "…"
      : residual === undefined
        ? "–"
        : `${number(residual)} mm, fitted ${number(this.fit?.fitted_mm[index])}`;
    return make(
      "li",
      make("b", String(index + 1)),
      make("span", text),
      closeButton(`Remove pair ${index + 1}`, () => this.remove(index), { key: `unpair-${index}`, tip: "Remove" }),
    );
  }

  // --- the markers -----------------------------------------------------------------------------

  press(/** @type {Point} */ { x, y }) {
    if (!this.picking) return false;
    const near = this.ends().find((end) => Math.hypot(x - end.x, y - end.y) < REACH_PX);
    this.held = near ?? null;
    return Boolean(near);
  }

  drag(/** @type {PointerPlace} */ { u, v }) {
    if (!this.held) return;
    const { pair, end } = this.held;
    pair[end] = end === "own" ? this.toOwn(u, v) : [u, v];
    this.canvas.redraw();
  }

  release() {
    this.held = null;
    this.askResiduals();
  }

  ends() {
    return this.pairs.flatMap((pair, index) => [
      this.end(pair, index, "own", this.fromOwn(pair.own)),
      ...(pair.shape ? [this.end(pair, index, "shape", pair.shape)] : []),
    ]);
  }

  /** @param {Pair} pair @param {number} index @param {End["end"]} end @param {UV} place @returns {End} */
  end(pair, index, end, place) {
    return { pair, index, end, ...this.canvas.transform.toPane(...place) };
  }

  drawOver(/** @type {Pen} */ pen) {
    const ends = this.ends();
    const { context } = pen;
    context.font = "600 12px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    for (const { pair, x, y, end } of ends) {
      if (end !== "own" || !pair.shape) continue;
      const to = pen.at(pair.shape);
      pen.rimmed("--accent", 2, () => {
        context.moveTo(x, y);
        context.lineTo(to.x, to.y);
      });
    }
    for (const { index, end, x, y } of ends) {
      pen.dot({ x, y }, end === "own" ? "--text" : "--accent", 9, 2);
      context.fillStyle = pen.color(end === "own" ? "--panel" : "--on-accent");
      context.fillText(String(index + 1), x, y + 0.5);
    }
    context.textAlign = "start";
  }

  // --- between the proposal's own plane and the shape's ------------------------------------------

  /** @returns {UV} */
  fromOwn(/** @type {UV} */ [x, y]) {
    const { placement } = this;
    return placement ? applied(this.canvas.motion, ...applied(placement, x, y)) : [x, y];
  }

  toOwn(/** @type {number} */ u, /** @type {number} */ v) {
    return unapplied(this.placement ?? [0, 0, 0], ...this.unmoved(u, v));
  }

  /** Where the server has laid the proposal. @returns {Motion | null} */
  get placement() {
    const at = this.canvas.overlay.shown?.grid.placement;
    return at ? [at.theta_rad, at.u_m, at.v_m] : null;
  }

  unmoved(/** @type {number} */ u, /** @type {number} */ v) {
    return unapplied(this.canvas.motion, u, v);
  }
}
