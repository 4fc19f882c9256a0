// Repair of a proposal: how it fits while it is moved, refinement from there, and pairs of points to fit.

import { applied, unapplied } from "/static/canvas/geometry.js";
import { strokeRimmed } from "/static/canvas/marks.js";
import { byId, make, rebuild, setText } from "/static/page/dom.js";
import { number } from "/static/page/format.js";

const REACH_PX = 11;
const SEEN_EVERY_MS = 60;
const FAR_BELOW = 0.2; // of the score: so much below the best place is far from it
const LEAST_GAIN = 0.005; // of the score

/** @typedef {{ own: UV; shape: UV | null; weight: number }} Pair `own` is a place in the proposal's own plane */
/** @typedef {Point & { pair: Pair; index: number; end: "own" | "shape" }} End */

export class Repair {
  name = "repair";

  /** `page.canvas` shows the markers; `nudges` holds what the keys have moved but not told yet. */
  constructor(/** @type {Page} */ page, /** @type {KeyNudges} */ nudges) {
    this.page = page;
    this.canvas = page.canvas;
    this.actions = {
      pairs: () => this.toggle(),
      fit_pairs: () => {
        nudges.flush();
        this.sendPairs(true);
      },
      back_to_best: () => {
        nudges.flush();
        this.backToBest();
      },
      refine: () => {
        nudges.flush();
        page.send({ type: "refine", view_index: this.view });
      },
    };
    /** @type {Panel["messages"]} */
    this.messages = { preview: (message) => this.takePreview(message), pairs: (message) => this.takePairs(message) };
    this.picking = false;
    /** @type {number | null} */
    this.view = null; // the view that the pairs are about
    /** @type {Pair[]} */
    this.pairs = [];
    /** @type {import("/static/page/messages").PairsAnswer | null} */
    this.fit = null; // residuals as the server tells them
    /** @type {End | null} */
    this.held = null; // the marker that is being dragged
    this.asked = 0;
    this.answered = 0;
    /** @type {By | null} */
    this.wanted = null;
    /** @type {Pending | null} */
    this.pending = null;
    this.canvas.tools.push(this);
    this.canvas.drawers.push((_, context, style) => this.draw(context, style));
  }

  update(/** @type {State} */ state) {
    this.pending = state.pending;
    if (this.view !== (state.pending?.view_index ?? null)) {
      this.view = state.pending?.view_index ?? null;
      this.clear();
      this.picking = false;
    }
    byId("repair").hidden = !state.pending;
    if (!state.pending) return;
    rebuild(byId("repair-tools"), ["repair"], () => [
      this.page.button("pairs"),
      this.page.button("refine", "Refine"),
    ]);
    for (const name of ["pairs", "refine"]) {
      byId("repair-tools")
        .querySelector(`[data-action="${name}"]`)
        .setAttribute("aria-pressed", String(name === "pairs" && this.picking));
    }
    rebuild(byId("back-to-best"), ["best"], () => [this.page.button("back_to_best")]);
    this.showPieces(state.pending);
    this.showPairs();
  }

  backToBest() {
    const { hypotheses, view_index, nudge } = this.pending;
    if (hypotheses.length) return this.page.send({ type: "choose", view_index, index: 0 });
    const back = { theta_rad: (-nudge.theta_deg * Math.PI) / 180, u_m: -nudge.u_mm / 1000, v_m: -nudge.v_mm / 1000 };
    this.page.send({ type: "move", view_index, ...back });
  }

  /** The connected parts of the view, if it has several: which one is placed. */
  showPieces(/** @type {Pending} */ { pieces, view_index }) {
    const box = byId("pieces");
    box.hidden = pieces.length < 2;
    rebuild(box, [pieces, view_index], () =>
      pieces.map((piece) =>
        make(
          "button.button",
          {
            pressed: piece.chosen,
            label: `Part ${piece.component + 1}, ${number(piece.area_cm2, 0)} cm²` + (piece.waits ? ", waits" : ""),
            key: `piece-${piece.component}`,
            tip: piece.waits
              ? "Nothing connects this part to the shape yet; it floats until something does.\n" +
                "Click: place it by hand."
              : "Place this part of the view.",
            click: () =>
              piece.chosen || this.page.send({ type: "take_part", view_index, component: piece.component }),
          },
          make("b", String(piece.component + 1)),
          `${number(piece.area_cm2, 0)} cm²${piece.waits ? " …" : ""}`,
        ),
      ),
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

  /** Ask how the proposal would fit, moved by `by`; while an answer is on its way only the newest is kept. */
  moving(/** @type {By} */ by) {
    this.wanted = { ...by };
    if (this.asked === this.answered) this.sendWanted();
  }

  sendWanted() {
    if (!this.wanted || this.view === null) return;
    const { theta, u, v } = this.wanted;
    this.wanted = null;
    this.asked += 1;
    const sent = this.page.send({
      type: "preview",
      id: this.asked,
      view_index: this.view,
      theta_rad: theta,
      u_m: u,
      v_m: v,
    });
    if (!sent) this.answered = this.asked;
  }

  takePreview(/** @type {import("/static/page/messages").PreviewAnswer} */ message) {
    if (message.id !== this.asked) return;
    setTimeout(() => {
      this.answered = this.asked;
      this.sendWanted();
    }, SEEN_EVERY_MS);
    if (!this.pending) return;
    /** @param {number | null} score @param {number} mm */
    const fit = (score, mm) => `${number(score, 2)}${mm === null ? "" : `, ${number(mm)} mm apart`}`;
    const here = fit(message.score, message.apart_mm);
    const refined = fit(message.refined_score, message.refined_apart_mm);
    const best = this.pending.hypotheses[0]?.score ?? this.pending.proposed_score;
    const gains = message.refined_score - message.score >= LEAST_GAIN;
    const far = best !== null && Math.max(message.score, message.refined_score) < best - FAR_BELOW;
    const more = gains
      ? `Refined from here: ${refined}.`
      : far
        ? "You are far from the best place: back to it?"
        : "Refine would not improve it.";
    setText(byId("fit-here"), message.why || `At this place: score ${here}. ${more}`);
    byId("back-to-best").hidden = !far;
  }

  /** After a lost connection nobody answers any more. */
  reconnected() {
    this.answered = this.asked;
    this.wanted = null;
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

  get status() {
    return { ends: this.ends().map(({ x, y }) => [x, y]) };
  }

  /** A click on the plane; returns whether it was meant for a pair. */
  click(/** @type {number} */ u, /** @type {number} */ v) {
    if (!this.picking || this.view === null) return false;
    const open = this.pairs.at(-1);
    if (open && !open.shape) {
      open.shape = [u, v];
      this.askResiduals();
    } else if (this.onProposal(u, v)) {
      this.pairs.push({ own: this.toOwn(u, v), shape: null, weight: 1 });
      this.fit = null;
    } else {
      this.page.notify("info", "Click a point on the proposal first, then where it belongs on the shape.");
    }
    this.showPairs();
    this.canvas.redraw();
    return true;
  }

  onProposal(/** @type {number} */ u, /** @type {number} */ v) {
    const at = this.unmoved(u, v);
    return this.canvas.overlay.covers(at[0], at[1]);
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
      shape_uv_m: whole.map((p) => p.shape),
      weights: whole.map((p) => p.weight),
    });
  }

  takePairs(/** @type {import("/static/page/messages").PairsAnswer} */ message) {
    if (message.residual_mm.length !== this.whole().length) return; // of pairs before
    this.fit = message;
    this.showPairs();
  }

  whole() {
    return this.pairs.filter((p) => p.shape);
  }

  showPairs() {
    const box = byId("pairs");
    box.hidden = !this.picking && !this.pairs.length;
    const enough = this.whole().length > 1;
    rebuild(
      box,
      [this.picking, this.pairs.length, this.pairs.map((p) => [Boolean(p.shape), p.weight]), this.fit],
      () => [
        make("p.note", this.nextClick()),
        this.pairs.length > 0 && make("ol.pairs", ...this.pairs.map((pair, i) => this.row(pair, i))),
        enough &&
          this.page.button("fit_pairs", this.fit ? `Fit pairs: ${number(this.fit.rms_mm)} mm rms` : "Fit pairs"),
      ],
    );
  }

  nextClick() {
    if (!this.picking) return "Press Pairs (P) to pick more.";
    return this.pairs.at(-1) && !this.pairs.at(-1).shape
      ? "Now click where it belongs on the shape."
      : "Click a point on the proposal.";
  }

  row(/** @type {Pair} */ pair, /** @type {number} */ index) {
    const residual = this.fit?.residual_mm[index];
    const told = !pair.shape
      ? "…"
      : residual === undefined
        ? "–"
        : `${number(residual)} mm, fitted ${number(this.fit.fitted_mm[index])}`;
    const weigh = (/** @type {ChangeEvent} */ event) => {
      const weight = event.target.valueAsNumber;
      if (weight > 0) pair.weight = weight;
      else event.target.value = String(pair.weight);
      this.askResiduals();
    };
    return make(
      "li",
      make("b", String(index + 1)),
      make("span", told),
      make("input", {
        type: "number",
        min: 0.1,
        max: 10,
        step: 0.1,
        value: pair.weight,
        label: `Weight of pair ${index + 1}`,
        key: `weight-${index}`,
        tip: "Weight of this pair",
        change: weigh,
      }),
      make("button.close", {
        label: `Remove pair ${index + 1}`,
        key: `unpair-${index}`,
        tip: "Remove",
        click: () => this.remove(index),
        text: "×",
      }),
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
    this.held.pair[this.held.end] = this.held.end === "own" ? this.toOwn(u, v) : [u, v];
    this.canvas.redraw();
  }

  release() {
    this.held = null;
    this.askResiduals();
  }

  /** @returns {End[]} */
  ends() {
    return this.pairs.flatMap((pair, index) => [
      { pair, index, end: /** @type {const} */ ("own"), ...this.canvas.transform.toPane(...this.fromOwn(pair.own)) },
      ...(pair.shape
        ? [{ pair, index, end: /** @type {const} */ ("shape"), ...this.canvas.transform.toPane(...pair.shape) }]
        : []),
    ]);
  }

  draw(/** @type {Context} */ context, /** @type {Style} */ style) {
    const ends = this.ends();
    context.font = "600 11px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    for (const { pair, x, y, end } of ends) {
      if (end !== "own" || !pair.shape) continue;
      const to = this.canvas.transform.toPane(...pair.shape);
      strokeRimmed(context, style.getPropertyValue("--accent"), 2, () => {
        context.moveTo(x, y);
        context.lineTo(to.x, to.y);
      });
    }
    for (const { index, end, x, y } of ends) {
      context.beginPath();
      context.arc(x, y, 9, 0, 2 * Math.PI);
      context.fillStyle = end === "own" ? "#e67e00" : style.getPropertyValue("--accent");
      context.strokeStyle = "#fff";
      context.lineWidth = 2;
      context.fill();
      context.stroke();
      context.fillStyle = end === "own" ? "#241300" : style.getPropertyValue("--on-accent");
      context.fillText(String(index + 1), x, y + 0.5);
    }
    context.textAlign = "start";
  }

  // --- between the proposal's own plane and the shape's ------------------------------------------

  /** @returns {UV} */
  fromOwn(/** @type {UV} */ [x, y]) {
    const at = this.canvas.overlay.shown?.grid.placement;
    return at ? this.previewed(...applied([at.theta_rad, at.u_m, at.v_m], x, y)) : [x, y];
  }

  toOwn(/** @type {number} */ u, /** @type {number} */ v) {
    const { theta_rad, u_m, v_m } = this.canvas.overlay.shown.grid.placement;
    return unapplied([theta_rad, u_m, v_m], ...this.unmoved(u, v));
  }

  previewed(/** @type {number} */ u, /** @type {number} */ v) {
    const { theta, u: du, v: dv } = this.canvas.preview;
    const [cu, cv] = this.canvas.center;
    return applied([theta, cu + du, cv + dv], u - cu, v - cv);
  }

  /** @returns {UV} */
  unmoved(/** @type {number} */ u, /** @type {number} */ v) {
    const { theta, u: du, v: dv } = this.canvas.preview;
    const [cu, cv] = this.canvas.center;
    const [x, y] = unapplied([theta, cu + du, cv + dv], u, v);
    return [x + cu, y + cv];
  }
}
