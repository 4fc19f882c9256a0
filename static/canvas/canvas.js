// The flattened view: what is drawn where; pan, zoom, turn, pick and drag of the proposal.

import { Beside } from "../both/beside.js";
import { drawPick } from "./marks.js";
import { Pen } from "./pen.js";
import { byId, contextOf, onWheel, sized } from "../page/dom.js";
import { applied, contains, cornersOf, grown, Transform } from "./geometry.js";
import { Picture } from "./picture.js";
import { Pyramid } from "./pyramid.js";

const CLICK_PX = 4;
const MARGIN_PX = 34;
const SLACK_M = 0.05;
const FOOT_PX = 40; // of the scale and of what is said beside it
const LEGEND_GAP_PX = 12;
const LEAST_FREE_SHARE = 0.5; // a legend that leaves less of the pane lies over the cloth

/** @typedef {{ tool?: Tool; isMain: boolean; from: Point; last: Point; moved: boolean }} Gesture */

export class FlatCanvas {
  /** The panels of the page draw over the pictures, and are offered each press of the pointer first. */
  constructor(/** @type {Page} */ page) {
    this.page = page;
    this.canvas = byId("canvas");
    this.context = contextOf(this.canvas);
    this.width = this.height = 0; // of the pane, CSS pixels
    this.transform = new Transform();
    this.pen = new Pen(this.context, ([u, v]) => this.transform.toPane(u, v));
    this.layer = new Picture(() => {
      this.refit();
      page.each("pictured");
    });
    this.overlay = new Picture((anew) => this.overlayReady(anew));
    this.fitted = true; // until the operator pans or zooms
    this.extent = /** @type {Box | null} */ (null); // what is held in sight of frames that come and go
    this.marks = /** @type {{ id: number | null; uv_m: UV }[]} */ ([]);
    this.marksDrawn = this.marks; // for tests
    this.pick = /** @type {{ uv_m: UV; grip?: CurrentPick["grip"] } | null} */ (null);
    this.gesture = /** @type {Gesture | null} */ (null);
    this.side = /** @type {SideName} */ ("this"); // of the item, which is shown
    this.beside = new Beside(this); // the other side, where both are shown
    this.preview = { theta: 0, u: 0, v: 0 }; // of the proposal, before the server has moved it
    this.center = [0, 0];
    this.dirty = false;
    new ResizeObserver(() => this.resize()).observe(byId("stage"));
    new ResizeObserver(() => this.refit()).observe(byId("legend"));
    matchMedia("(resolution: 1dppx)").addEventListener("change", () => this.resize());
    this.listen();
  }

  get layerRevision() {
    return this.layer.shown?.revision ?? 0;
  }

  /** Take what a state says about the pictures, and show the named layer. */
  update(/** @type {State} */ state, /** @type {string} */ layerName) {
    const layers = state.layers;
    if (!layers) {
      this.layer.clear();
      this.overlay.clear();
    } else {
      this.layer.show(`${this.folder}/${layers.revision}/${layerName}.png`, layers.revision, layers, false);
      const overlay = state.pending ? layers.overlay : null;
      if (overlay && overlay.view_index === state.pending?.view_index) {
        this.center = overlay.center_uv_m;
        // In the colours of the shape, which span another range when the shape changes.
        const address = `overlay/${overlay.revision}.png?layer=${layerName}&shape=${layers.revision}`;
        this.overlay.show(address, overlay.revision, overlay, true);
      } else {
        this.overlay.clear();
      }
    }
    this.beside.update(state, layerName);
    this.showMarks(state.picks);
    const at = state.pick?.uv_m ? this.shownAt(state.pick.side, state.pick.uv_m) : null;
    this.pick = state.pick && at && { ...state.pick, uv_m: at };
    this.redraw();
  }

  /** The folder of the pictures of the shown side. */
  get folder() {
    return this.side === "other" ? "other" : "layers";
  }

  /** Which side of the item a place of the canvas belongs to, and where it is there. */
  located(/** @type {number} */ u, /** @type {number} */ v) {
    const other = this.beside.at(u, v);
    /** @type {{ sheet: SideName; u_m: number; v_m: number }} */
    const place = other ? { sheet: "other", u_m: other[0], v_m: other[1] } : { sheet: this.side, u_m: u, v_m: v };
    return place;
  }

  /** Where a place of a side is on the canvas; null: that side is not shown. */
  shownAt(/** @type {SideName} */ sheet, /** @type {UV} */ uv) {
    return sheet === this.side ? uv : sheet === "other" ? this.beside.shown(uv) : null;
  }

  /**
   * Show a view of the offline page (or none) where it lies on its plane.
   * @param {Shown | null} shown
   */
  showFrame(shown) {
    this.layer.shown = shown;
    this.pick = null;
    if (shown) this.hold(shown.box);
  }

  /** Let the zoom stay while it holds what is shown: a frame of a camera, a step of the offline page. */
  hold(/** @type {Box} */ box) {
    if (this.extent && contains(this.extent, box)) return;
    this.extent = grown(box, SLACK_M);
    this.refit();
  }

  showMarks(/** @type {{ id: number | null; uv_m: UV | null; side?: SideName }[]} */ picks) {
    this.marks = picks.flatMap(({ id, uv_m, side }) => {
      const at = uv_m && this.shownAt(side ?? "this", uv_m);
      return at ? [{ id, uv_m: at }] : [];
    });
    this.redraw();
  }

  /** Show all of a new picture; not while somebody drags: what is dragged would move from under the pointer. */
  refit() {
    if (this.fitted && !this.gesture) this.fit();
    this.redraw();
  }

  resetPreview() {
    this.preview = { theta: 0, u: 0, v: 0 };
    this.redraw();
  }

  /** How what is held is being moved on the plane. @returns {Motion} */
  get motion() {
    return this.motionOf(this.preview);
  }

  /** A motion about the centre as one of the plane. @param {By} by @returns {Motion} */
  motionOf({ theta, u, v }) {
    const [cu, cv] = this.center;
    const [du, dv] = applied([theta, 0, 0], -cu, -cv);
    return [theta, cu + u + du, cv + v + dv];
  }

  /** The reverse. @param {Motion} motion @returns {By} */
  byOf(motion) {
    const [cu, cv] = this.center;
    const [u, v] = applied(motion, cu, cv);
    return { theta: motion[0], u: u - cu, v: v - cv };
  }

  overlayReady(/** @type {boolean} */ anew) {
    if (anew) {
      this.resetPreview();
      this.page.each("placed");
    }
    this.refit();
  }

  resize() {
    const stage = byId("stage");
    this.width = stage.clientWidth;
    this.height = stage.clientHeight;
    if (this.fitted) this.fit();
    this.draw(); // at once: a new size has cleared the canvas
  }

  /** Places that all that is drawn lies between. @returns {UV[]} */
  get rims() {
    const cloth = [...this.layer.rim, ...this.overlay.rim, ...this.beside.rim];
    return cloth.length ? [...cloth, ...this.page.gather("around")] : [];
  }

  /** Show all of it; beside the legend where the cloth would lie under that. */
  fit() {
    this.fitted = true;
    const places = this.extent ? cornersOf(this.extent) : this.rims;
    if (places.length && this.width) {
      const legend = byId("legend");
      const free = this.width - (legend.hidden ? 0 : legend.offsetWidth + LEGEND_GAP_PX);
      const height = this.height - FOOT_PX;
      this.transform.fit(places, this.width, height, MARGIN_PX);
      const right = Math.max(...places.map(([u, v]) => this.transform.toPane(u, v).x));
      if (right > free && free > LEAST_FREE_SHARE * this.width) this.transform.fit(places, free, height, MARGIN_PX);
    }
    this.redraw();
  }

  zoomBy(/** @type {number} */ factor) {
    this.fitted = false;
    this.transform.zoom(factor, this.width / 2, this.height / 2);
    this.redraw();
  }

  /** Bring a place of the plane to the middle. */
  centerOn(/** @type {number} */ u, /** @type {number} */ v) {
    this.fitted = false;
    const { x, y } = this.transform.toPane(u, v);
    this.transform.pan(this.width / 2 - x, this.height / 2 - y);
    this.redraw();
  }

  /** Turn what is seen; the data stay as they are. */
  turnTo(/** @type {number} */ angle) {
    this.transform.turn(angle, this.width / 2, this.height / 2);
    if (this.fitted) this.fit();
    this.redraw();
  }

  /** Place of the plane in the page's CSS pixels. */
  toScreen(/** @type {number} */ u, /** @type {number} */ v) {
    const at = this.canvas.getBoundingClientRect();
    const { x, y } = this.transform.toPane(u, v);
    return { x: at.left + x, y: at.top + y };
  }

  toPlane(/** @type {number} */ x, /** @type {number} */ y) {
    const at = this.canvas.getBoundingClientRect();
    return this.transform.toPlane(x - at.left, y - at.top);
  }

  /** Show the proposal moved by so much; the server is told by the caller. */
  showPreview(/** @type {By} */ by) {
    this.preview = by;
    this.page.each("moving", by);
    this.redraw();
  }

  /**
   * A turn (clockwise) and a step (metres right and down) as they are seen, as a motion on the plane.
   * @param {number} turn @param {number} right @param {number} down
   */
  asSeen(turn, right, down) {
    const { scale } = this.transform;
    return { theta: turn, ...this.transform.toPlaneVector(scale * right, scale * down) };
  }

  redraw() {
    if (this.dirty) return;
    this.dirty = true;
    requestAnimationFrame(() => {
      this.dirty = false;
      this.draw();
    });
  }

  draw() {
    sized(this.canvas, this.width, this.height);
    if (this.page.comparison) this.page.comparison.paint(this);
    else this.drawShape();
    this.beside.paint();
    this.page.each("drawOver", this.pen);
    if (!this.layer.shown) return;
    for (const { uv_m } of this.marks) this.pen.dot(this.pen.at(uv_m), "--pick", 4);
    this.marksDrawn = this.marks;
    if (this.pick) drawPick(this, this.pick);
    this.pen.scale({ x: 14, y: this.height - 16 }, Math.min(150, 0.3 * this.width), this.transform.scale);
  }

  drawShape() {
    if (this.layer.shown) this.drawPicture(this.layer.shown, this.layer.shown.image);
  }

  /** The proposal where it is, or is being moved to; `outlined` also its outline, which is never pale. */
  drawProposal(opacity = 1, outlined = false) {
    const proposal = this.overlay.shown;
    if (!proposal) return;
    this.context.globalAlpha = opacity;
    this.drawPicture(proposal, proposal.image, true);
    this.context.globalAlpha = 1;
    if (outlined && proposal.outline) this.drawPicture(proposal, proposal.outline, true);
  }

  /**
   * Draw a picture where it lies on the plane; `moved`: with the proposal, when that is being moved.
   * @param {{ box: Box; grid: Grid }} parts @param {Drawable | Pyramid} image
   * @param {Motion | null} motion of the picture on the plane
   */
  drawPicture({ box, grid }, image, moved = false, motion = null) {
    const context = this.context;
    context.save();
    this.transform.apply(context);
    const by = moved ? this.motion : motion;
    if (by) {
      context.translate(by[1], by[2]);
      context.rotate(by[0]);
    }
    // A pixel of cloth is a measurement: zoomed in, it is shown as the square it stands for.
    const scale = this.transform.scale * grid.pixel_size_m * devicePixelRatio;
    const source = image instanceof Pyramid ? image.at(scale) : image;
    context.imageSmoothingEnabled = scale < 2;
    context.imageSmoothingQuality = "low";
    context.drawImage(source, box.left, box.top, box.right - box.left, box.bottom - box.top);
    context.restore();
  }

  get isMoved() {
    const { theta, u, v } = this.preview;
    return theta !== 0 || u !== 0 || v !== 0;
  }

  // --- the pointer ---------------------------------------------------------------------------

  listen() {
    const canvas = this.canvas;
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.release(event));
    canvas.addEventListener("pointercancel", () => this.cancel());
    canvas.addEventListener("pointerleave", () => this.page.each("hover", null));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    onWheel(canvas, (factor, event) => {
      event.preventDefault();
      const { x, y } = this.inPane(event);
      this.fitted = false;
      this.transform.zoom(factor, x, y);
      this.redraw();
    });
  }

  cancel() {
    this.gesture = null;
    this.page.each("cancel");
  }

  inPane(/** @type {MouseEvent} */ event) {
    const at = this.canvas.getBoundingClientRect();
    return { x: event.clientX - at.left, y: event.clientY - at.top };
  }

  press(/** @type {PointerEvent} */ event) {
    if (event.button > 2) return;
    const at = this.at(event);
    // The pointer of the keys has nothing to capture.
    if (event.isTrusted) this.canvas.setPointerCapture(event.pointerId);
    const isMain = event.button === 0;
    const tool = isMain ? this.page.panels.find((panel) => panel.press?.(at, event.shiftKey)) : undefined;
    this.gesture = { tool: /** @type {Tool} */ (tool), isMain, from: at, last: at, moved: false };
  }

  move(/** @type {PointerEvent} */ event) {
    const at = this.at(event);
    const { gesture } = this;
    if (!gesture) {
      const holds = this.page.panels.some((panel) => panel.holds?.(at));
      this.canvas.style.cursor = holds ? "move" : "crosshair";
      return this.page.each("hover", { u_m: at.u, v_m: at.v });
    }
    const { tool, from, last } = gesture;
    gesture.moved ||= Math.hypot(at.x - from.x, at.y - from.y) > CLICK_PX;
    if (tool) return tool.drag(at, gesture.moved);
    if (!gesture.moved) return;
    this.fitted = false;
    this.canvas.style.cursor = "grabbing";
    this.transform.pan(at.x - last.x, at.y - last.y);
    this.redraw();
    gesture.last = at;
  }

  /** Where the pointer is in the pane and on the plane. */
  at(/** @type {MouseEvent} */ event) {
    const { x, y } = this.inPane(event);
    return { x, y, ...this.transform.toPlane(x, y) };
  }

  release(/** @type {PointerEvent} */ event) {
    const { gesture } = this;
    this.gesture = null;
    if (!gesture) return;
    const { tool, isMain, from, moved } = gesture;
    const isTaken = tool ? tool.release(this.at(event), moved) !== false : moved || !isMain;
    const { u, v } = this.transform.toPlane(from.x, from.y);
    if (!isTaken && this.layer.shown) this.page.handlers.pick(u, v);
    this.move(event);
  }
}
