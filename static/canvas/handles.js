// Handles of the proposal, or of cloth in doubt: a ring turns it, its middle moves it; near a ghost, where it may
// belong, it snaps.

import { applied, boxOf, sumOf } from "./geometry.js";
import { traceCross } from "./pen.js";
import { PagePart } from "../page/page.js";
import { hasKeys, within } from "../page/dom.js";

const REACH_PX = hasKeys() ? 13 : 24; // of a mouse or a finger
const ABOVE_PX = 26; // of the ring over the proposal
const LABEL_PX = 26; // of a ghost, off its middle, away from the ring
const SNAP_PX = 16;
const SNAP_RAD = 0.14; // 8 degrees
const SAME = 1e-6;

export class Handles extends PagePart {
  name = "handles";
  snapped = /** @type {string | null} */ (null); // the title of the ghost
  /** @type {{ grip: "turn" | "drag"; from: PointerPlace; before: By } | null} */
  taken = null; // by the pointer, and where it was before

  /** @param {Page} page @param {() => boolean} isAway whether clicks mean something else now */
  constructor(page, isAway) {
    super(page);
    this.isAway = isAway;
  }

  /** The ring of handles is to be in sight. @returns {UV[]} */
  around() {
    const { held } = this;
    const [u, v] = this.canvas.center;
    return held ? [[u + held.arm[0], v + held.arm[1]]] : [];
  }

  /** What the handles hold. @returns {Held | null} */
  get held() {
    const { page, canvas } = this;
    const { shown } = canvas.overlay;
    if (canvas.side === "other" || page.brush?.side || this.isAway() || !page.state) return null;
    if (!page.state.pending) return page.doubts.held;
    if (!shown) return null;
    return {
      arm: [0, boxOf(shown.grid).top - canvas.center[1]],
      ghosts: [],
      draw: (motion) => canvas.drawPicture(shown, shown.outline ?? shown.image, false, motion),
    };
  }

  /** Where the handles are in the pane, with the preview. */
  get places() {
    const { canvas, held } = this;
    if (!held) return null;
    const { theta, u, v } = canvas.preview;
    const [cu, cv] = canvas.center;
    const middle = canvas.transform.toPane(cu + u, cv + v);
    const [ru, rv] = applied([theta, 0, 0], ...held.arm);
    const edge = canvas.transform.toPane(cu + u + ru, cv + v + rv);
    const far = Math.hypot(edge.x - middle.x, edge.y - middle.y) || 1;
    const way = { x: (edge.x - middle.x) / far, y: (edge.y - middle.y) / far };
    return { middle, edge, ring: { x: edge.x + ABOVE_PX * way.x, y: edge.y + ABOVE_PX * way.y } };
  }

  // --- the pointer -------------------------------------------------------------------------------

  /** Whether a place is on the proposal, and that is seen. */
  holds(/** @type {PointerPlace} */ { u, v }) {
    const { canvas, page } = this;
    const isSeen = page.comparison.mode !== "shape" && Boolean(page.state?.pending);
    return isSeen && canvas.overlay.covers(u - canvas.preview.u, v - canvas.preview.v);
  }

  /** Take hold of a handle, of a floating piece, or of the proposal, which Shift turns. */
  press(/** @type {PointerPlace} */ at, /** @type {boolean} */ withShift) {
    const { places } = this;
    const near = (/** @type {Point} */ place) => Math.hypot(place.x - at.x, place.y - at.y) < REACH_PX;
    const isRing = !withShift && places && near(places.ring);
    const isMiddle = !isRing && !withShift && ((places && near(places.middle)) || this.page.doubts.grabs(at.u, at.v));
    if (!isRing && !isMiddle && !this.holds(at)) return false;
    this.taken = { grip: isRing || withShift ? "turn" : "drag", from: at, before: this.canvas.preview };
    return true;
  }

  drag(/** @type {PointerPlace} */ at, /** @type {boolean} */ moved) {
    if (!this.taken || !moved) return;
    const { grip, from, before } = this.taken;
    const turn = grip === "turn" ? this.angleAt(at) - this.angleAt(from) : 0;
    const by = grip === "drag" ? { u: at.u - from.u, v: at.v - from.v } : { u: 0, v: 0 };
    this.canvas.showPreview(this.snap(sumOf(before, { theta: Math.atan2(Math.sin(turn), Math.cos(turn)), ...by })));
  }

  /** The direction from the middle of what is held, on the plane. */
  angleAt(/** @type {PointerPlace} */ { u, v }) {
    const [cu, cv] = this.canvas.center;
    const { u: du, v: dv } = this.taken?.before ?? this.canvas.preview;
    return Math.atan2(v - cv - dv, u - cu - du);
  }

  /** One gesture is one decision. */
  release(/** @type {PointerPlace} */ _at, /** @type {boolean} */ moved) {
    const { preview } = this.canvas;
    const { before } = this.taken ?? { before: preview };
    this.taken = null;
    this.page.doubts.dropped(moved);
    if (moved)
      this.page.move({ theta: preview.theta - before.theta, u: preview.u - before.u, v: preview.v - before.v });
    return moved;
  }

  cancel() {
    if (!this.taken) return;
    this.taken = null;
    this.canvas.resetPreview();
    this.page.doubts.dropped(false);
  }

  // --- ghosts ------------------------------------------------------------------------------------

  /** Whether what is held lies there already. */
  isAt(/** @type {Ghost} */ ghost) {
    const { theta, u, v } = this.canvas.byOf(ghost.motion);
    const { preview } = this.canvas;
    return Math.hypot(theta - preview.theta, u - preview.u, v - preview.v) < SAME;
  }

  /** A motion of what is held, or that to a ghost which is near. @returns {By} */
  snap(/** @type {By} */ by) {
    this.snapped = null;
    for (const ghost of this.held?.ghosts ?? []) {
      const to = this.canvas.byOf(ghost.motion);
      const off = Math.hypot(to.u - by.u, to.v - by.v) * this.canvas.transform.scale;
      const turn = Math.abs(Math.atan2(Math.sin(to.theta - by.theta), Math.cos(to.theta - by.theta)));
      if (off > SNAP_PX || turn > SNAP_RAD) continue;
      this.snapped = ghost.title;
      return to;
    }
    return by;
  }

  drawOver(/** @type {Pen} */ pen) {
    const { places, held } = this;
    if (!places || !held) return;
    const named = /** @type {Rect[]} */ ([]);
    for (const ghost of held.ghosts) if (!this.isAt(ghost)) this.drawGhost(pen, held, ghost, named);
    pen.line([places.edge, places.ring], "--accent");
    pen.ring(places.ring, "--accent", 6);
    pen.rimmed("--accent", 2, (to) => {
      to.arc(places.middle.x, places.middle.y, 8, 0, 2 * Math.PI);
      traceCross(to, places.middle, 8, 13);
    });
  }

  /**
   * A ghost with its name, below those that are `named` already.
   * @param {Pen} pen @param {Held} held @param {Ghost} ghost @param {Rect[]} named
   */
  drawGhost(pen, held, ghost, named) {
    const { canvas } = this;
    const { motion } = ghost;
    pen.context.globalAlpha = ghost.title === this.snapped ? 0.85 : 0.4;
    held.draw(motion);
    pen.context.globalAlpha = 1;
    const { x, y } = pen.at(applied(motion, canvas.center[0] + ghost.at[0], canvas.center[1] + ghost.at[1]));
    const width = pen.widthOf(ghost.title);
    const { ring, edge } = this.places ?? { ring: { y }, edge: { y } };
    const left = within(x - width / 2, 0, canvas.width - width);
    const at = { x: left, y: ring.y > edge.y ? y - LABEL_PX : y + LABEL_PX, w: width, h: 18 }; // off its middle
    while (named.some((one) => Math.abs(one.y - at.y) < 19 && one.x < at.x + at.w && at.x < one.x + one.w)) at.y += 2;
    named.push(at);
    pen.label(ghost.title, at);
  }
}
