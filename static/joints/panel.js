// Why the parts of the shape are joined: where the least evidence joins them, the views that saw it; the places at
// which a part may lie, one of which is decided on.

import { PagePart } from "../page/page.js";
import { nearest } from "../canvas/geometry.js";
import { drawSeamInScene, drawSeams, strokeLoop } from "../canvas/marks.js";
import { shapeOf } from "../canvas/overlap.js";
import { Pyramid } from "../canvas/pyramid.js";
import { drawCaption, drawMoved } from "../canvas/pieces.js";
import { askJson, Fetched } from "../page/connection.js";
import { byId, closeButton, hasKeys, heading, make, rebuild, setText, smallButton, swatch } from "../page/dom.js";
import { cm2, count, mm, number } from "../page/format.js";
import { fitOf, holds, JointOptions } from "./places.js";

const HIT_PX = 10;
const MOST_ROWS = 8;

/** @typedef {import("../page/messages").JointInfo} JointInfo */
/** @typedef {import("../page/messages").JointsInfo} JointsInfo */

export class JointsPanel extends PagePart {
  name = "joints";
  shown = false;
  /** @type {Fetched<JointsInfo>} */
  fetched = new Fetched(askJson, () => this.choose(this.joints.length ? 0 : null)); // the weakest is asked about first
  chosen = /** @type {number | null} */ (null);
  options = /** @type {JointOptions | null} */ (null); // where the part of the chosen one may lie
  notice = ""; // about the place that was clicked
  fitted = { key: "", text: "" };
  actions = { joints: () => this.toggle(), joint_next: () => this.next(), joint_decide: () => this.decide() };
  section = byId("joints");

  constructor(/** @type {Page} */ page) {
    super(page);
    page.joints = this;
    page.sourceMarks.push((view) => this.pixels(view));
    page.canvas.around.push(() => (this.held && this.options?.everywhere) || []);
  }

  get found() {
    return this.fetched.value;
  }

  get joints() {
    return this.found?.joints ?? [];
  }

  get joint() {
    return this.shown && this.chosen !== null ? (this.joints[this.chosen] ?? null) : null;
  }

  get pressed() {
    return { joints: this.shown };
  }

  get status() {
    const { chosen, held, options, canvas } = this;
    return {
      chosen,
      titles: options?.all.map(({ title }) => title),
      at: options?.at(canvas.motion),
      held: Boolean(held),
    };
  }

  toggle() {
    this.shown = !this.shown;
    this.choose(this.shown && this.joints.length ? 0 : null);
    if (this.shown) this.section.scrollIntoView({ block: "nearest" });
  }

  /** Ask what holds the parts of the shape; true: not known yet. */
  want() {
    if (this.fetched.want(addressOf(this.page.thisSide))) this.choose(null);
    return this.found === null;
  }

  update(/** @type {State} */ state) {
    this.section.hidden = !this.shown || !state.layers || state.mode === "camera";
    if (state.phase === "finished" && state.layers) this.want(); // what is doubtful is said at the end
    if (this.section.hidden) return;
    this.want();
    const at = this.held ? this.options?.at(this.canvas.motion) : null;
    rebuild(this.section, [this.found, this.chosen, at, this.notice, state.drawing], () => this.build(state.drawing));
    this.showFit();
  }

  /** The shape and its joints as the teaching mode shows them; null until they are known. @returns {ShapeLesson | null} */
  get lesson() {
    const { thisSide } = this.page;
    const { shown } = this.canvas.layer;
    if (this.want() || !shown || !thisSide.layers || this.canvas.side === "other") return null;
    const shape = shown.image instanceof Pyramid ? shown.image.at(1) : shown.image;
    return {
      picture: { shape },
      grid: shown.grid,
      joints: this.joints,
      area_cm2: thisSide.layers.area_cm2,
      views: thisSide.step,
    };
  }

  /** What most doubtful cloth hangs on, in words; "": nothing is doubtful; null: that is not known. */
  get doubt() {
    if (!this.found || this.found.trouble) return null;
    const joint = this.joints.find(({ weak }) => weak);
    if (!joint) return "";
    return `${cm2(joint.area_cm2)} hang on one joint that is right with a probability of ${number(100 * joint.probability, 1)} %`;
  }

  /** What is asked about the part that is held. */
  get question() {
    return `Where does this part lie? ${this.decision} (A), show the next place (.), or drag its ring or its cross.`;
  }

  // --- the panel ---------------------------------------------------------------------------------

  build(/** @type {boolean} */ drawing) {
    const { found, joints } = this;
    const waits = drawing || !found;
    return [
      heading(
        "Why joined",
        closeButton("Close why joined", () => this.toggle(), { key: "close-joints" }),
      ),
      waits && make("p.note", { role: "status" }, "Looking for what holds the parts …"),
      found?.trouble && make("p.note", found.trouble),
      !waits &&
        !found.trouble &&
        make(
          "p.note",
          joints.length
            ? "Parts that hang on the rest by little evidence, the most doubtful first. Click cloth to ask about it."
            : "No part of the shape hangs on so little evidence that it is in doubt.",
        ),
      this.notice && make("p.note", { role: "status" }, this.notice),
      make("ul", ...joints.map((joint, n) => this.row(joint, n))),
    ];
  }

  row(/** @type {JointInfo} */ joint, /** @type {number} */ n) {
    const on = n === this.chosen;
    const right = joint.probability < 1 ? `${number(100 * joint.probability, 1)} % sure` : "firm";
    return make(
      "li",
      make(
        "button.button.small.joint",
        {
          pressed: on,
          key: `joint-${n}`,
          tip: "A part, and where it is joined to the rest. Click: show what holds it.",
          click: () => this.choose(on ? null : n),
        },
        swatch(on ? "var(--accent)" : joint.weak ? "var(--warn)" : "var(--seam)"),
        make("b", cm2(joint.area_cm2)),
        make("small", joint.kept ? "kept" : right),
      ),
      on && this.detail(joint, n),
    );
  }

  /** Where a part may lie, with the decision about it, and what holds it. */
  detail(/** @type {JointInfo} */ joint, /** @type {number} */ n) {
    const pairs = joint.views.reduce((sum, view) => sum + view.pairs, 0);
    return make(
      "div.seam-detail",
      { role: "group", label: `Part ${n + 1}` },
      this.held && this.options && this.places(this.options),
      make(
        "p.note",
        `Held by ${count(pairs, "pair")} of ${count(joint.views.length, "view")}, ` +
          `evidence ${number(joint.evidence, 1)}.${joint.kept ? " You kept it." : ""}`,
      ),
      make(
        "table",
        make("tr", ...["View", "Pairs", "Residual"].map((text) => make("th", { scope: "col" }, text))),
        ...joint.views.slice(0, MOST_ROWS).map((view) => this.view(view)),
      ),
      joint.views.length > MOST_ROWS && make("p.note", `and ${joint.views.length - MOST_ROWS} more`),
    );
  }

  /** The places at which the part may lie, that which is shown pressed, and the decision for it. */
  places(/** @type {JointOptions} */ options) {
    const at = options.at(this.canvas.motion);
    const row = (/** @type {JointOptions["all"][number]} */ { title, share }, /** @type {number} */ n) =>
      make(
        "button.button.small.joint",
        { pressed: n === at, key: `joint-place-${n}`, click: () => this.look(n) },
        title,
        make("small", share),
      );
    return [
      make("div.places", { role: "group", label: "Where the part lies" }, ...options.all.map(row)),
      make("p#joint-fit.note", { role: "status" }),
      make("div.group", this.decideButton(), this.page.smallButton("joint_next")),
    ];
  }

  decideButton() {
    const button = this.page.smallButton("joint_decide", this.decision);
    button.classList.toggle("primary", this.canvas.isMoved);
    return button;
  }

  view(/** @type {JointInfo["views"][number]} */ { view_index, angle_deg, pairs, residual_mm, rc }) {
    return make(
      "tr",
      make(
        "td",
        smallButton(
          `${view_index} · ${number(angle_deg, 0)}°`,
          () => (rc.length ? this.page.each("lookAt", view_index, rc[Math.floor(rc.length / 2)]) : null),
          { key: `joint-view-${view_index}`, tip: "Show the pairs in this view's source image and in 3D." },
        ),
      ),
      make("td", String(pairs)),
      make("td", mm(residual_mm[0])),
    );
  }

  // --- where the part lies -----------------------------------------------------------------------

  /** Choose a part, or none, with a notice about the place that was clicked. */
  choose(/** @type {number | null} */ chosen, notice = "") {
    this.chosen = chosen;
    this.notice = notice;
    this.options = this.joint && new JointOptions(this.joint);
    if (!this.page.state?.pending) {
      if (this.options) this.canvas.center = this.options.pivot;
      this.canvas.resetPreview();
    }
    this.page.changed();
    this.page.redrawMarks();
    this.canvas.refit();
  }

  /** What the handles hold: the part of the chosen joint, unless something else is being decided. */
  get held() {
    const { options, canvas, page } = this;
    if (!options || !this.joint || page.state?.pending || page.hasCamera || canvas.side === "other") return null;
    /** @type {Held} */
    const held = { arm: options.arm, ghosts: options.ghosts, draw: (by) => this.drawAt(by) };
    return held;
  }

  /** Show the part at one of its places. */
  look(/** @type {number} */ n) {
    const { options, canvas } = this;
    if (!options) return;
    canvas.preview = canvas.byOf(options.all[n].motion);
    canvas.redraw();
    this.page.changed();
  }

  next() {
    const { options, canvas } = this;
    if (!this.held || !options) return this.page.notify("info", "Choose a part first: why joined.");
    this.look((options.at(canvas.motion) + 1) % options.all.length);
  }

  /** The place that is shown, one of those that are known or another. */
  get place() {
    const { options, canvas } = this;
    const known = options?.all[options.at(canvas.motion)];
    return known ?? { decide: "Place it here", cut: true, place: canvas.motion };
  }

  /** What deciding for it means. */
  get decision() {
    return this.place.decide;
  }

  /** Decide that the part lies where it is shown. */
  decide() {
    const { chosen, found, page } = this;
    if (!this.held || chosen === null) return;
    if (page.state.drawing || !found) return page.notify("info", "The shape is being drawn; wait a moment.");
    const { cut, place } = this.place;
    page.send({ type: "decide_joint", revision: found.revision, index: chosen, cut, place });
  }

  moving() {
    if (this.held) this.page.changed();
  }

  /** How the part fits where it is shown; found once for each place. */
  get fit() {
    const { joint, canvas, place } = this;
    if (!joint || (place.cut && !place.place)) return ""; // cut off, it lies nowhere
    const key = `${canvas.layer.shown?.address} ${this.chosen} ${canvas.motion}`;
    if (this.fitted.key !== key) {
      const colorAt = this.page.layer === "color" ? canvas.layer.colorAt : null;
      this.fitted = { key, text: fitOf(joint, canvas.motion, shapeOf(this.page), colorAt) };
    }
    return this.fitted.text;
  }

  showFit() {
    const box = document.getElementById("joint-fit");
    if (box) setText(box, this.fit);
  }

  // --- on the cloth ------------------------------------------------------------------------------

  /** A click asks about the cloth there. */
  click(/** @type {number} */ u, /** @type {number} */ v) {
    if (!this.shown || !this.found || this.page.state.pending || this.page.canvas.side === "other") return false;
    const joint = this.jointAt(u, v);
    const none = "This cloth belongs to the largest part: nothing within it is joined by little evidence.";
    this.choose(joint, joint === null ? none : "");
    return true;
  }

  /** The pixels of a view's image at which the chosen part is joined. */
  pixels(/** @type {number} */ view) {
    return this.joint?.views.find(({ view_index }) => view_index === view)?.rc ?? [];
  }

  escape() {
    if (!this.shown) return false;
    if (this.held && this.canvas.isMoved) this.look(0);
    else this.toggle();
    return true;
  }

  /** The joint at a place: one whose seam is near, else the smallest part that has it; null: none. */
  jointAt(/** @type {number} */ u, /** @type {number} */ v) {
    const { joints } = this;
    const [holding] = joints.filter((joint) => holds(joint, u, v)).sort((a, b) => a.area_cm2 - b.area_cm2);
    const found = nearest(joints, this.seamOf, this.canvas.transform.toPane(u, v), HIT_PX) ?? holding;
    return found ? joints.indexOf(found) : null;
  }

  /** Where a joint is, in the pane. @param {JointInfo} joint */
  seamOf = (joint) =>
    joint.ends_uv_m.map(([[u, v], [s, t]]) => this.canvas.transform.toPane((u + s) / 2, (v + t) / 2));

  drawOver(/** @type {Context} */ context, /** @type {Style} */ style) {
    const { joints, joint, canvas } = this;
    if (!this.shown || this.page.hasCamera || canvas.side === "other") return;
    if (joint && this.held && canvas.isMoved) {
      drawMoved(canvas, style, joint.outline_uv_m, canvas.motion);
      const told = canvas.gesture ? this.fit : `${this.decision}${hasKeys() ? " (A)" : ""}?`;
      drawCaption(canvas, style, told);
    }
    this.drawAt([0, 0, 0], "--accent");
    const seams = joints.map((each) => ({ at: this.seamOf(each), doubted: each.weak }));
    drawSeams(context, style, seams, this.chosen);
  }

  /** The outline of the part, moved by so much. */
  drawAt(/** @type {Motion} */ by, color = "--warn") {
    const style = getComputedStyle(this.canvas.canvas);
    for (const loop of this.options?.loopsAt(by) ?? [])
      strokeLoop(this.canvas, loop, style.getPropertyValue(color), 2, { rim: 1.5, dash: [6, 4] });
  }

  /** @param {Context} context @param {Style} style @param {PlaceInScene} place */
  drawInScene(context, style, place) {
    if (!this.joint) return;
    context.fillStyle = style.getPropertyValue("--warn");
    for (const at of this.joint.part_xyz_m.map(place)) if (at) context.fillRect(at.x - 1, at.y - 1, 2, 2);
    drawSeamInScene(context, style, this.joint.seam_xyz_m, place);
  }
}

/** Where the joints of the shape are; a garment or seams that are known later may doubt others. */
const addressOf = (/** @type {State} */ { layers, garment, other }) =>
  layers && `joints/${layers.revision}.json?garment=${garment?.revision ?? 0}&other=${other?.revision ?? 0}`;
