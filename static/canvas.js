// The flattened view: layers, proposal, marks and scale bar; pan, zoom, pick and drag of the proposal.

import { byId } from "/static/dom.js";
import { contains, grown, Transform, union } from "/static/geometry.js";
import { length, niceLength } from "/static/format.js";
import { Picture } from "/static/picture.js";

const CLICK_PX = 4;
const BLINK_MS = 450;
const MARGIN_PX = 34;
const SLACK_M = 0.05;

export class FlatCanvas {
  /** `handlers`: pick(u, v), hover(u, v) or hover(null), nudge({theta, u, v}), mayDrag(). */
  constructor(handlers) {
    this.handlers = handlers;
    this.canvas = byId("canvas");
    this.context = this.canvas.getContext("2d");
    this.transform = new Transform();
    this.layer = new Picture(() => this.layerReady());
    this.overlay = new Picture(() => this.overlayReady());
    this.fitted = true; // until the operator pans or zooms
    this.boxes = new Map(); // of live mode: where each view lay when it was shown last
    this.reach = null; // what all of them need together
    this.marks = [];
    this.pick = null;
    this.showOverlay = true;
    this.opacity = 0.7;
    this.blink = false;
    this.blinkOn = true;
    this.preview = { theta: 0, u: 0, v: 0 }; // of the proposal, before the server has moved it
    this.center = [0, 0];
    this.dirty = false;
    new ResizeObserver(() => this.resize()).observe(byId("stage"));
    matchMedia("(resolution: 1dppx)").addEventListener("change", () => this.resize());
    this.listen();
  }

  get layerRevision() {
    return this.layer.shown?.revision ?? 0;
  }

  /** Take what a state says about the pictures, and show the named layer. */
  update(state, layerName) {
    const layers = state.layers;
    if (!layers) {
      this.layer.clear();
      this.overlay.clear();
    } else {
      this.layer.show(`/layers/${layers.revision}/${layerName}.png`, layers.revision, layers, false);
      const overlay = state.pending ? layers.overlay : null;
      if (overlay && overlay.view_index === state.pending.view_index) {
        this.center = overlay.center_uv_m;
        this.overlay.show(`/overlay/${overlay.revision}.png`, overlay.revision, overlay, true);
      } else {
        this.overlay.clear();
      }
    }
    this.marks = state.picks.filter((p) => p.uv_m);
    this.pick = state.pick?.in_shape ? state.pick : null;
    this.redraw();
  }

  /** Live mode: show a frame (or none) where it lies on its plane. The zoom holds all frames, and stays still. */
  showFrame(shown, view, pickUv) {
    this.layer.shown = shown;
    this.pick = pickUv ? { uv_m: pickUv } : null;
    if (!shown) return;
    this.boxes.set(view, shown.box);
    const reach = [...this.boxes.values()].reduce(union);
    if (this.reach && contains(this.reach, reach) && !contains(reach, grown(this.reach, -2 * SLACK_M))) return;
    this.reach = grown(reach, SLACK_M);
    if (this.fitted) this.fit();
  }

  /** Live mode: the picks that lie on the frame; none while frames pass by faster than they are told. */
  showMarks(picks) {
    this.marks = picks.filter((p) => p.uv_m);
    this.redraw();
  }

  layerReady() {
    if (this.fitted) this.fit();
    this.redraw();
  }

  resetPreview() {
    this.preview = { theta: 0, u: 0, v: 0 };
    this.redraw();
  }

  overlayReady() {
    this.resetPreview();
    if (this.fitted) this.fit();
    this.redraw();
  }

  resize() {
    const stage = byId("stage");
    const ratio = devicePixelRatio;
    this.width = stage.clientWidth;
    this.height = stage.clientHeight;
    this.canvas.width = Math.max(1, Math.round(this.width * ratio));
    this.canvas.height = Math.max(1, Math.round(this.height * ratio));
    if (this.fitted) this.fit();
    this.draw(); // at once: a new size has cleared the canvas
  }

  fit() {
    this.fitted = true;
    const box = this.reach ?? union(this.layer.shown?.box, this.overlay.shown?.box);
    if (box && this.width) this.transform.fit(box, this.width, this.height, MARGIN_PX);
    this.redraw();
  }

  zoomBy(factor) {
    this.fitted = false;
    this.transform.zoom(factor, this.width / 2, this.height / 2);
    this.redraw();
  }

  /** Place of the plane in the page's CSS pixels. */
  toScreen(u, v) {
    const at = this.canvas.getBoundingClientRect();
    const { x, y } = this.transform.toPane(u, v);
    return { x: at.left + x, y: at.top + y };
  }

  setBlink(on) {
    this.blink = on;
    this.blinkOn = true;
    clearInterval(this.blinkTimer);
    if (on) {
      this.blinkTimer = setInterval(() => {
        this.blinkOn = !this.blinkOn;
        if (this.overlay.shown) this.redraw();
      }, BLINK_MS);
    }
    this.redraw();
  }

  /** Move the proposal's preview; the server is told by the caller. */
  movePreview(by) {
    this.preview.theta += by.theta;
    this.preview.u += by.u;
    this.preview.v += by.v;
    this.redraw();
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
    const context = this.context;
    const ratio = devicePixelRatio;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, this.width, this.height);
    const style = getComputedStyle(this.canvas);
    if (this.layer.shown) this.drawPicture(this.layer.shown, this.layer.shown.image);
    const proposal = this.overlay.shown;
    if (proposal && this.showOverlay && this.blinkOn) {
      context.save();
      this.turnToPreview();
      context.globalAlpha = this.blink ? 1 : this.opacity;
      this.drawPicture(proposal, proposal.image);
      context.globalAlpha = 1;
      this.drawPicture(proposal, proposal.outline);
      context.restore();
    }
    if (this.layer.shown) {
      for (const mark of this.marks) this.drawMark(mark, style);
      if (this.pick) this.drawCurrent(style);
      this.drawScale(style);
    }
  }

  turnToPreview() {
    const { theta, u, v } = this.preview;
    const c = this.transform.toPane(this.center[0], this.center[1]);
    const s = this.transform.scale;
    this.context.translate(c.x + s * u, c.y + s * v);
    this.context.rotate(theta);
    this.context.translate(-c.x, -c.y);
  }

  drawPicture(shown, image) {
    const from = this.transform.toPane(shown.box.left, shown.box.top);
    const to = this.transform.toPane(shown.box.right, shown.box.bottom);
    // A pixel of cloth is a measurement: zoomed in, it is shown as the square it stands for.
    this.context.imageSmoothingEnabled = this.transform.scale * shown.grid.pixel_size_m * devicePixelRatio < 2;
    this.context.imageSmoothingQuality = "high";
    this.context.drawImage(image, from.x, from.y, to.x - from.x, to.y - from.y);
  }

  drawMark(mark, style) {
    const { x, y } = this.transform.toPane(...mark.uv_m);
    const context = this.context;
    context.beginPath();
    context.arc(x, y, 4, 0, 2 * Math.PI);
    context.fillStyle = style.getPropertyValue("--pick");
    context.strokeStyle = "#fff";
    context.lineWidth = 1.5;
    context.fill();
    context.stroke();
  }

  drawCurrent(style) {
    const { x, y } = this.transform.toPane(...this.pick.uv_m);
    const context = this.context;
    for (const [color, width] of [["#fff", 4.5], [style.getPropertyValue("--pick"), 2]]) {
      context.strokeStyle = color;
      context.lineWidth = width;
      context.beginPath();
      context.arc(x, y, 9, 0, 2 * Math.PI);
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
        context.moveTo(x + 5 * dx, y + 5 * dy);
        context.lineTo(x + 14 * dx, y + 14 * dy);
      }
      context.stroke();
    }
    if (this.pick.grip?.axis_uv) this.drawGrip(x, y, this.pick.grip, style);
  }

  /** The gripper's axis as a line through the pick, its fingers as bars on both sides of it. */
  drawGrip(x, y, grip, style) {
    const context = this.context;
    const [du, dv] = grip.axis_uv;
    const half = (grip.opening_m / 2) * this.transform.scale;
    for (const [color, width] of [["#fff", 5], [style.getPropertyValue("--pick"), 2.5]]) {
      context.strokeStyle = color;
      context.lineWidth = width;
      context.beginPath();
      for (const side of [-1, 1]) {
        context.moveTo(x + 15 * side * du, y + 15 * side * dv);
        context.lineTo(x + 30 * side * du, y + 30 * side * dv);
        const [fx, fy] = [x - side * half * dv, y + side * half * du];
        context.moveTo(fx - 8 * du, fy - 8 * dv);
        context.lineTo(fx + 8 * du, fy + 8 * dv);
      }
      context.stroke();
    }
  }

  drawScale(style) {
    const context = this.context;
    const mm = niceLength((1000 * Math.min(150, 0.3 * this.width)) / this.transform.scale);
    const width = (mm / 1000) * this.transform.scale;
    const x = 14;
    const y = this.height - 16;
    context.font = "12px system-ui, sans-serif";
    context.textBaseline = "bottom";
    const label = length(mm);
    context.globalAlpha = 0.85;
    context.fillStyle = style.getPropertyValue("--panel");
    context.fillRect(x - 8, y - 24, Math.max(width, context.measureText(label).width) + 16, 34);
    context.globalAlpha = 1;
    context.fillStyle = context.strokeStyle = style.getPropertyValue("--text");
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(x, y - 5);
    context.lineTo(x, y);
    context.lineTo(x + width, y);
    context.lineTo(x + width, y - 5);
    context.stroke();
    context.fillText(label, x + 4, y - 4);
  }

  // --- the pointer ---------------------------------------------------------------------------

  listen() {
    const canvas = this.canvas;
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.release(event));
    canvas.addEventListener("pointercancel", () => (this.gesture = null));
    canvas.addEventListener("pointerleave", () => this.handlers.hover(null));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const { x, y } = this.inPane(event);
      const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
      this.fitted = false;
      this.transform.zoom(Math.exp(-event.deltaY * lines * (event.ctrlKey ? 0.01 : 0.0016)), x, y);
      this.redraw();
    }, { passive: false });
  }

  inPane(event) {
    const at = this.canvas.getBoundingClientRect();
    return { x: event.clientX - at.left, y: event.clientY - at.top };
  }

  overProposal(x, y) {
    const { u, v } = this.transform.toPlane(x, y);
    return this.showOverlay && this.handlers.mayDrag() && this.overlay.covers(u - this.preview.u, v - this.preview.v);
  }

  press(event) {
    if (event.button > 2) return;
    const { x, y } = this.inPane(event);
    this.canvas.setPointerCapture(event.pointerId);
    const kind = event.button === 0 && this.overProposal(x, y) ? (event.shiftKey ? "turn" : "drag") : "pan";
    this.gesture = { kind, button: event.button, x, y, lastX: x, lastY: y, moved: false, by: { theta: 0, u: 0, v: 0 } };
  }

  move(event) {
    const { x, y } = this.inPane(event);
    const gesture = this.gesture;
    if (!gesture) {
      this.canvas.style.cursor = this.overProposal(x, y) ? "move" : "crosshair";
      const { u, v } = this.transform.toPlane(x, y);
      this.handlers.hover(u, v);
      return;
    }
    gesture.moved ||= Math.hypot(x - gesture.x, y - gesture.y) > CLICK_PX;
    if (!gesture.moved) return;
    const dx = x - gesture.lastX;
    const dy = y - gesture.lastY;
    if (gesture.kind === "pan") {
      this.fitted = false;
      this.canvas.style.cursor = "grabbing";
      this.transform.pan(dx, dy);
      this.redraw();
    } else {
      const by = gesture.kind === "drag"
        ? { theta: 0, u: dx / this.transform.scale, v: dy / this.transform.scale }
        : { theta: this.angleAt(x, y) - this.angleAt(gesture.lastX, gesture.lastY), u: 0, v: 0 };
      if (by.theta > Math.PI) by.theta -= 2 * Math.PI;
      if (by.theta < -Math.PI) by.theta += 2 * Math.PI;
      for (const name of ["theta", "u", "v"]) gesture.by[name] += by[name];
      this.movePreview(by);
    }
    gesture.lastX = x;
    gesture.lastY = y;
  }

  angleAt(x, y) {
    const c = this.transform.toPane(this.center[0] + this.preview.u, this.center[1] + this.preview.v);
    return Math.atan2(y - c.y, x - c.x);
  }

  release(event) {
    const gesture = this.gesture;
    this.gesture = null;
    if (!gesture) return;
    if (!gesture.moved && gesture.button === 0) {
      const { u, v } = this.transform.toPlane(gesture.x, gesture.y);
      if (this.layer.shown) this.handlers.pick(u, v);
    } else if (gesture.moved && gesture.kind !== "pan") {
      this.handlers.nudge(gesture.by); // one gesture, one decision
    }
    this.move(event);
  }
}
