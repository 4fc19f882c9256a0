// Handles of the proposal: a ring turns it, its middle moves it; near a ghost, where the piece may belong, it snaps.

import { applied, boxOf, unapplied } from "./geometry.js";
import { drawLabel, drawRing, strokeLine, strokeRimmed, traceCross } from "./marks.js";
import { byId, rebuild, smallButton } from "../page/dom.js";
import { mm } from "../page/format.js";

const REACH_PX = matchMedia("(pointer: coarse)").matches ? 24 : 13;
const ABOVE_PX = 26; // of the ring over the proposal
const LABEL_PX = 26; // of a ghost, below its middle
const SNAP_PX = 16;
const SNAP_RAD = 0.14; // 8 degrees

/** @typedef {Pending["ghosts"][number]} Ghost */

export class Handles {
  name = "handles";

  /** @param {Page} page @param {() => boolean} isAway whether clicks mean something else now */
  constructor(page, isAway) {
    this.page = page;
    this.isAway = isAway;
    this.canvas = page.canvas;
    this.snapped = /** @type {Ghost | null} */ (null);
    this.canvas.snap = (by) => this.snap(by);
    this.canvas.gripAt = (at) => this.gripAt(at);
  }

  update(/** @type {State} */ { pending }) {
    const ghosts = pending?.ghosts ?? [];
    rebuild(byId("ghosts"), [pending?.view_index, ghosts], () =>
      ghosts.map((ghost) =>
        smallButton(`Lay ${TITLES[ghost.source]} ± ${mm(ghost.std_mm, 0)}`, () => this.layAt(ghost), {
          key: `ghost-${ghost.source}`,
          tip: "Lay the piece where its ghost is drawn. Dragged near there, it snaps to it.",
        }),
      ),
    );
  }

  get pending() {
    const { state, brush } = this.page;
    if (!state?.pending || !this.canvas.overlay.shown || this.canvas.side === "other") return null;
    return brush?.kind || this.isAway() ? null : state.pending;
  }

  /** Where the handles are in the pane, with the preview. */
  get places() {
    const { canvas } = this;
    const shown = canvas.overlay.shown;
    if (!this.pending || !shown) return null;
    const { top } = boxOf(shown.grid);
    const { theta, u, v } = canvas.preview;
    const [cu, cv] = canvas.center;
    const middle = canvas.transform.toPane(cu + u, cv + v);
    const [ru, rv] = applied([theta, 0, 0], 0, top - cv);
    const edge = canvas.transform.toPane(cu + u + ru, cv + v + rv);
    const far = Math.hypot(edge.x - middle.x, edge.y - middle.y) || 1;
    const way = { x: (edge.x - middle.x) / far, y: (edge.y - middle.y) / far };
    return { middle, edge, ring: { x: edge.x + ABOVE_PX * way.x, y: edge.y + ABOVE_PX * way.y } };
  }

  /** What a press at a place of the pane takes hold of; null: no handle. @returns {"turn" | "drag" | null} */
  gripAt(/** @type {Point} */ at) {
    const { places } = this;
    if (!places) return null;
    const near = (/** @type {Point} */ place) => Math.hypot(place.x - at.x, place.y - at.y) < REACH_PX;
    return near(places.ring) ? "turn" : near(places.middle) ? "drag" : null;
  }

  // --- ghosts ------------------------------------------------------------------------------------

  /** The motion that leads the proposal from where the server has it to a ghost. @returns {By} */
  towards(/** @type {Ghost} */ { placement }) {
    const { canvas } = this;
    const { theta_rad, u_m, v_m } = /** @type {Motionlike} */ (canvas.overlay.shown?.grid.placement);
    const own = unapplied([theta_rad, u_m, v_m], canvas.center[0], canvas.center[1]);
    const [u, v] = applied([placement.theta_rad, placement.u_m, placement.v_m], ...own);
    const turn = placement.theta_rad - theta_rad;
    return { theta: Math.atan2(Math.sin(turn), Math.cos(turn)), u: u - canvas.center[0], v: v - canvas.center[1] };
  }

  /** A motion of the proposal, or that to a ghost which is near. @returns {By} */
  snap(/** @type {By} */ by) {
    this.snapped = null;
    for (const ghost of this.pending?.ghosts ?? []) {
      const to = this.towards(ghost);
      const off = Math.hypot(to.u - by.u, to.v - by.v) * this.canvas.transform.scale;
      const turn = Math.abs(Math.atan2(Math.sin(to.theta - by.theta), Math.cos(to.theta - by.theta)));
      if (off > SNAP_PX || turn > SNAP_RAD) continue;
      this.snapped = ghost;
      return to;
    }
    return by;
  }

  /** Lay the proposal at a ghost. */
  layAt(/** @type {Ghost} */ ghost) {
    this.canvas.handlers.nudge(this.towards(ghost));
  }

  drawOver(/** @type {Context} */ context, /** @type {Style} */ style) {
    const { places, canvas } = this;
    const shown = canvas.overlay.shown;
    if (!places || !shown) return;
    for (const ghost of this.pending?.ghosts ?? []) this.drawGhost(context, style, ghost);
    const color = style.getPropertyValue("--accent");
    strokeLine(context, [places.edge, places.ring], color, 1.5);
    drawRing(context, places.ring, color, 6);
    strokeRimmed(context, color, 2, () => {
      context.arc(places.middle.x, places.middle.y, 8, 0, 2 * Math.PI);
      traceCross(context, places.middle.x, places.middle.y, 8, 13);
    });
  }

  /** @param {Context} context @param {Style} style @param {Ghost} ghost */
  drawGhost(context, style, ghost) {
    const { canvas } = this;
    const shown = canvas.overlay.shown;
    if (!shown) return;
    const { theta, u, v } = this.towards(ghost);
    const [cu, cv] = canvas.center;
    const [du, dv] = applied([theta, 0, 0], -cu, -cv);
    context.globalAlpha = ghost === this.snapped ? 0.85 : 0.4;
    canvas.drawPicture(shown, shown.outline ?? shown.image, false, [theta, cu + u + du, cv + v + dv]);
    context.globalAlpha = 1;
    const { x, y } = canvas.transform.toPane(cu + u, cv + v);
    const text = `${TITLES[ghost.source]} ± ${mm(ghost.std_mm, 0)}`;
    context.font = "600 12px system-ui, sans-serif";
    context.textBaseline = "middle";
    const width = context.measureText(text).width + 8;
    const below = y + LABEL_PX; // the middle is a handle
    drawLabel(context, style, text, [x - width / 2 + 4, below], [x - width / 2, below - 9, width, 18]);
  }

  get status() {
    const { places, snapped } = this;
    const ghosts = this.pending?.ghosts.map((ghost) => this.towards(ghost)) ?? [];
    return { places, ghosts, snapped: snapped?.source ?? null, scale: this.canvas.transform.scale };
  }
}

/** @typedef {{ theta_rad: number; u_m: number; v_m: number }} Motionlike */

/** @type {Record<string, string>} */
export const TITLES = { garment: "by the garment", seams: "by seams" };
