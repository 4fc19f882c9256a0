// Why the parts of the shape are joined: where the least evidence joins them, the views that saw it; cut or keep.

import { PagePart } from "../page/page.js";
import { nearest } from "../canvas/geometry.js";
import { drawSeamInScene, drawSeams, strokeLoop } from "../canvas/marks.js";
import { askJson, Fetched } from "../page/connection.js";
import { byId, closeButton, heading, make, rebuild, smallButton, swatch } from "../page/dom.js";
import { cm2, count, number } from "../page/format.js";

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
  notice = ""; // about the place that was clicked
  actions = { joints: () => this.toggle() };
  section = byId("joints");

  constructor(/** @type {Page} */ page) {
    super(page);
    page.sourceMarks.push((view) => this.pixels(view));
  }

  get found() {
    return this.fetched.value;
  }

  get joints() {
    return this.found?.joints ?? [];
  }

  get pressed() {
    return { joints: this.shown };
  }

  toggle() {
    this.shown = !this.shown;
    this.choose(null);
    if (this.shown) this.section.scrollIntoView({ block: "nearest" });
  }

  update(/** @type {State} */ state) {
    this.section.hidden = !this.shown || !state.layers || state.mode === "camera";
    if (this.section.hidden) return;
    if (this.fetched.want(addressOf(this.page.thisSide))) this.chosen = null;
    rebuild(this.section, [this.found, this.chosen, this.notice, state.drawing], () => this.build(state.drawing));
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
      make("ul", ...joints.map((joint, n) => this.row(joint, n, waits))),
    ];
  }

  row(/** @type {JointInfo} */ joint, /** @type {number} */ n, /** @type {boolean} */ waits) {
    const on = n === this.chosen;
    const sure = joint.kept ? "kept" : joint.weak ? `${number(100 * joint.probability, 1)} % sure` : "firm";
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
        `by ${count(joint.views.length, "view")}`,
        make("small", sure),
      ),
      on && this.detail(joint, n, waits),
    );
  }

  /** What holds a part, and the decision about it. */
  detail(/** @type {JointInfo} */ joint, /** @type {number} */ n, /** @type {boolean} */ waits) {
    const pairs = joint.views.reduce((sum, view) => sum + view.pairs, 0);
    return make(
      "div.seam-detail",
      { role: "group", label: `Part ${n + 1}` },
      make(
        "p.note",
        `Held by ${count(pairs, "pair")} of ${count(joint.views.length, "view")}. ` +
          `With their evidence, ${number(joint.evidence, 1)}, the joint is right with a probability of ` +
          `${number(100 * joint.probability, 1)} %.`,
      ),
      joint.kept && make("p.note", "You kept it."),
      make("div.group", this.decide("Cut here", true, n, waits), this.decide("Keep", false, n, waits)),
      make(
        "table",
        make("tr", ...["View", "Pairs", "Residual", "90 % below"].map((text) => make("th", { scope: "col" }, text))),
        ...joint.views.slice(0, MOST_ROWS).map((view) => this.view(view)),
      ),
      joint.views.length > MOST_ROWS && make("p.note", `and ${joint.views.length - MOST_ROWS} more`),
    );
  }

  view(/** @type {JointInfo["views"][number]} */ { view_index, angle_deg, pairs, residual_mm, rc }) {
    const [median, most] = residual_mm;
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
      make("td", `${number(median, 1)} mm`),
      make("td", `${number(most, 1)} mm`),
    );
  }

  /** @param {string} title @param {boolean} cut @param {number} n @param {boolean} waits */
  decide(title, cut, n, waits) {
    const tip = cut
      ? "Take the part off: it floats, and can be placed again."
      : "The part stays joined, whatever speaks against it.";
    const message = /** @type {const} */ ({
      type: "decide_joint",
      revision: this.found?.revision ?? 0,
      index: n,
      cut,
    });
    return this.page.decision(title, message, tip, waits, { key: cut ? "joint-cut" : "joint-keep" });
  }

  /** Choose a part, or none, with a notice about the place that was clicked. */
  choose(/** @type {number | null} */ joint, notice = "") {
    this.chosen = joint;
    this.notice = notice;
    this.page.changed();
    this.page.redrawMarks();
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
    const joint = this.shown && this.chosen !== null ? this.joints[this.chosen] : null;
    return joint?.views.find(({ view_index }) => view_index === view)?.rc ?? [];
  }

  escape() {
    if (!this.shown) return false;
    this.toggle();
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
  seamOf = (joint) => joint.seam_uv_m.map((uv) => this.canvas.transform.toPane(...uv));

  drawOver(/** @type {Context} */ context, /** @type {Style} */ style) {
    const { joints, chosen, shown } = this;
    if (!shown || this.page.hasCamera || this.canvas.side === "other") return;
    for (const loop of chosen === null ? [] : joints[chosen].outline_uv_m)
      strokeLoop(this.canvas, loop, style.getPropertyValue("--accent"), 2, { rim: 1.5, dash: [6, 4] });
    const seams = joints.map((joint) => ({ at: this.seamOf(joint), doubted: joint.weak }));
    drawSeams(context, style, seams, chosen);
  }

  /** @param {Context} context @param {Style} style @param {PlaceInScene} place */
  drawInScene(context, style, place) {
    const { joints, chosen, shown } = this;
    if (!shown || chosen === null) return;
    drawSeamInScene(context, style, joints[chosen].seam_xyz_m, place);
  }
}

/** Where the joints of the shape are; a garment that is recognised later may doubt others. */
export const addressOf = (/** @type {State} */ { layers, garment }) =>
  layers && `joints/${layers.revision}.json?garment=${garment?.revision ?? 0}`;

/** Whether the outlines of a part hold a place: an odd number of their edges is crossed on the way out. */
function holds(/** @type {JointInfo} */ { outline_uv_m }, /** @type {number} */ u, /** @type {number} */ v) {
  let inside = false;
  for (const loop of outline_uv_m)
    loop.forEach(([u1, v1], n) => {
      const [u0, v0] = loop[(n + loop.length - 1) % loop.length];
      if (v0 > v !== v1 > v && u < u0 + ((v - v0) / (v1 - v0)) * (u1 - u0)) inside = !inside;
    });
  return inside;
}
