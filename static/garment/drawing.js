// The fitted outline and the named points over the flattened view: drawn, dragged, shown in the scene.

import { nearest } from "../canvas/geometry.js";
import { drawDot } from "../canvas/marks.js";
import { drawGarment, drawName } from "./marks.js";

const GRAB_PX = 10;
const CLICK_PX = 4;

/** @typedef {{ outline_uv_m: UV[]; points: GarmentPoint[] }} Outlined */

export class GarmentDrawing {
  /** `panel` says what was found, and takes what is decided. */
  constructor(/** @type {Page} */ page, /** @type {GarmentPanel} */ panel) {
    this.page = page;
    this.panel = panel;
    /** @type {Outlined | null} */
    this.preview = null; // outline and points while one of them is dragged
    this.grabbed = /** @type {(Point & { name: string; moved: boolean }) | null} */ (null);
    this.question = page.question(
      "garment_preview",
      (id, /** @type {Place & { name: string }} */ about) => page.send({ type: "preview_point", id, ...about }),
      (preview) => this.showPreview(preview),
    );
    this.revision = 0;
    page.draws(this);
  }

  update(/** @type {number} */ revision) {
    if (revision !== this.revision && !this.grabbed && !this.panel.moved) this.preview = null;
    this.revision = revision;
    this.page.redrawMarks();
  }

  /** What is drawn: the dragged outline, or the one that was found; null: nothing. */
  get drawn() {
    const { panel } = this;
    if (!panel.shown || !panel.found?.kind || this.page.hasCamera) return null;
    return this.preview ?? panel.found;
  }

  // --- a point is dragged: a tool of the canvas --------------------------------------------------

  press(/** @type {PointerPlace} */ at) {
    // Brushes, pairs and the proposal have the pointer while they are there.
    const taken = this.page.state?.pending || this.page.brush?.kind || this.page.canvas.side === "other";
    const near = taken ? null : this.near(at);
    if (!near) return false;
    this.grabbed = { name: near.name, x: at.x, y: at.y, moved: false };
    return true;
  }

  drag(/** @type {PointerPlace} */ at) {
    const { grabbed } = this;
    if (!grabbed) return;
    grabbed.moved ||= Math.hypot(at.x - grabbed.x, at.y - grabbed.y) > CLICK_PX;
    if (grabbed.moved) this.ask(grabbed.name, at.u, at.v);
  }

  release(/** @type {PointerPlace} */ at) {
    if (!this.grabbed) return;
    const { name, moved } = this.grabbed;
    this.grabbed = null;
    if (moved) this.panel.hold(name, at.u, at.v);
    else this.page.send({ type: "pick_point", name });
  }

  near(/** @type {Point} */ at) {
    const { transform } = this.page.canvas;
    return nearest(this.drawn?.points ?? [], (point) => [transform.toPane(...point.uv_m)], at, GRAB_PX);
  }

  // --- how the outline would lie -------------------------------------------------------------------

  /** The point itself follows at once. @param {string} name @param {number} u @param {number} v */
  ask(name, u, v) {
    const from = this.preview ?? this.panel.found;
    if (!from) return;
    this.preview = {
      ...from,
      points: from.points.map((point) => (point.name === name ? { ...point, uv_m: [u, v], held: true } : point)),
    };
    this.page.canvas.redraw();
    this.question.ask({ name, u_m: u, v_m: v });
  }

  showPreview(/** @type {GarmentPreview} */ preview) {
    if (!this.question.wanted && (this.grabbed || this.panel.moved)) this.preview = preview;
    this.page.canvas.redraw();
  }

  // --- drawn ---------------------------------------------------------------------------------------

  drawOver(/** @type {Context} */ context, /** @type {Style} */ style) {
    const { drawn } = this;
    if (drawn) drawGarment(this.page.canvas, context, style, drawn, this.grabbed?.name ?? this.panel.pointed);
  }

  /** @param {Context} context @param {Style} style @param {PlaceInScene} place */
  drawInScene(context, style, place) {
    if (!this.drawn) return;
    for (const point of this.drawn.points) {
      const [x, y, z] = point.xyz_m ?? [null, null, null];
      const at = x !== null && y !== null && z !== null && place([x, y, z]);
      if (!at) continue;
      const on = point.name === this.panel.pointed;
      drawDot(context, at, style.getPropertyValue("--garment"), on ? 8 : 3.5);
      if (on) drawName(context, style, at, point.name);
    }
  }
}
