// Marks over the 3D scene: all picks with their numbers, visible through the cloth, and the point under the pointer.
//
// They are drawn by this page on a canvas over viser's, with the camera that viser has at that moment: so a mark
// is never hidden, and follows the pointer without waiting for the scene.

import { drawDot } from "/static/canvas/marks.js";
import { byId, make } from "/static/page/dom.js";

const EDGE = 14;

export class SceneMarks {
  name = "sceneMarks";

  constructor(page) {
    this.page = page;
    this.frame = byId("viser");
    this.overlay = make("canvas", { class: "scene-marks", "aria-hidden": "true" });
    this.frame.after(this.overlay);
    this.picks = [];
    this.current = null;
    this.cursor = null; // a point in space that the pointer is at, on either side
    this.plane = null; // and where it lies on the plane
    this.lines = []; // [[from, to], color] in space
    this.drawers = []; // of panels: (context, style, place) draws what place(point in space) puts on the overlay
    this.drawn = []; // where marks were drawn, for tests
    this.id = 0;
    this.key = ""; // of what is drawn: the camera
    this.width = this.height = 0;
    this.busy = false;
    this.wanted = null;
    this.messages = { hover_ray: (message) => this.take(message), picked: (message) => this.highlight(message) };
    page.canvas.drawers.push((_, context, style) => this.drawOnPlane(context, style));
    this.frame.addEventListener("load", () => this.listen());
    const tick = () => {
      this.draw();
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  update(state) {
    this.picks = state.picks ?? [];
    this.current = state.pick?.id ?? null;
    this.dirty = true;
  }

  /** A new pick is shown at once; its name, its place on the plane and its numbers come with the next state. */
  highlight(pick) {
    this.picks = [...this.picks.filter(({ id }) => id !== pick.id), pick];
    this.current = pick.id;
    this.dirty = true;
  }

  /** The pointer is over the flattened view: its point in space has a cursor. */
  hovered(answer) {
    const at = answer?.shape ?? answer?.proposal ?? null;
    this.cursor = at ? at.xyz_mm.map((x) => x / 1000) : null;
    this.plane = null;
    this.dirty = true;
    this.page.canvas.redraw();
  }

  // --- the pointer in the scene ------------------------------------------------------------------

  listen() {
    const inside = this.frame.contentWindow;
    inside.addEventListener("pointermove", (event) => {
      const ray = event.buttons ? null : this.rayAt(event.clientX, event.clientY);
      this.wanted = ray;
      if (ray) this.ask();
    });
    inside.addEventListener("pointerout", (event) => !event.relatedTarget && this.leave());
  }

  leave() {
    this.wanted = null;
    this.id += 1;
    this.show(null, null);
  }

  ask() {
    if (this.busy || !this.wanted || !this.page.state?.layers || this.page.state.live?.playing) return;
    this.id += 1;
    this.busy = this.page.send({ type: "hover_ray", id: this.id, ...this.wanted });
    this.wanted = null;
  }

  take(message) {
    this.busy = false;
    if (message.id === this.id) this.show(message.xyz_m, message.uv_m);
    this.ask();
  }

  disconnected() {
    this.busy = false;
  }

  show(xyz, uv) {
    this.cursor = xyz;
    this.plane = uv;
    this.dirty = true;
    this.page.canvas.redraw();
  }

  /** viser's camera and the matrix from the object frame to its world; null until there is a scene. */
  get view() {
    const viser = this.frame.contentWindow?.__viserMutable;
    const node = viser?.nodeRefFromName?.["/live/cloud"];
    if (!node || !viser.camera || !viser.canvas) return null;
    return { camera: viser.camera, world: node.matrixWorld.elements, canvas: viser.canvas };
  }

  rayAt(x, y) {
    const { view } = this;
    if (!view) return null;
    const box = view.canvas.getBoundingClientRect();
    const [a, b] = [(2 * (x - box.left)) / box.width - 1, 1 - (2 * (y - box.top)) / box.height];
    const { matrixWorld, projectionMatrixInverse } = view.camera;
    const [px, py, pz] = applied(projectionMatrixInverse.elements, [a, b, 0.5]);
    /** @type {any} */
    const eye = [12, 13, 14].map((i) => matrixWorld.elements[i]);
    const through = applied(matrixWorld.elements, [px, py, pz]);
    const origin = unapplied(view.world, eye);
    const end = unapplied(view.world, through);
    const direction = end.map((value, i) => value - origin[i]);
    const length = Math.hypot(...direction);
    return { origin_m: origin, direction: direction.map((value) => value / length) };
  }

  /** Where a point of the object frame is seen on the overlay; null behind the eye. */
  place(view, point) {
    const seen = applied(view.camera.matrixWorldInverse.elements, applied(view.world, point));
    if (seen[2] >= 0) return null;
    const [x, y] = applied(view.camera.projectionMatrix.elements, seen);
    return { x: ((x + 1) / 2) * view.canvas.clientWidth, y: ((1 - y) / 2) * view.canvas.clientHeight };
  }

  // --- drawing -----------------------------------------------------------------------------------

  draw() {
    const { view } = this;
    if (!view) return;
    const key = `${view.camera.matrixWorldInverse.elements}${view.camera.projectionMatrix.elements}`;
    const [width, height] = [view.canvas.clientWidth, view.canvas.clientHeight];
    if (!this.dirty && key === this.key && width === this.width && height === this.height) return;
    this.dirty = false;
    this.key = key;
    this.width = width;
    this.height = height;
    const ratio = devicePixelRatio;
    this.overlay.width = Math.round(width * ratio);
    this.overlay.height = Math.round(height * ratio);
    this.overlay.style.width = `${width}px`;
    this.overlay.style.height = `${height}px`;
    const context = this.overlay.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const style = getComputedStyle(this.overlay);
    for (const [ends, color] of this.lines) this.drawLine(context, view, ends, color);
    for (const draw of this.drawers) draw(context, style, (point) => this.place(view, point));
    this.drawn = this.picks.map((pick) => this.drawPick(context, style, view, pick));
    const at = this.cursor && this.place(view, this.cursor);
    if (at) drawCursor(context, at, style.getPropertyValue("--accent"));
    this.cursorAt = at ?? null;
  }

  drawLine(context, view, ends, color) {
    const [a, b] = ends.map((point) => this.place(view, point));
    if (!a || !b) return;
    context.strokeStyle = color;
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(a.x, a.y);
    context.lineTo(b.x, b.y);
    context.stroke();
  }

  drawPick(context, style, view, pick) {
    const at = this.place(view, pick.position_held_m);
    if (!at) return null;
    const current = pick.id === this.current;
    drawDot(context, at, style.getPropertyValue("--pick"), current ? 6 : 4);
    drawNumber(context, at, pick.id, style, current);
    return { id: pick.id, x: at.x, y: at.y, inside: at.x > EDGE && at.x < this.width - EDGE };
  }

  drawOnPlane(context, style) {
    if (this.plane) {
      drawCursor(context, this.page.canvas.transform.toPane(...this.plane), style.getPropertyValue("--accent"));
    }
    for (const pick of this.page.canvas.marks) {
      const at = this.page.canvas.transform.toPane(...pick.uv_m);
      drawNumber(context, at, pick.id, style, pick.id === this.current);
    }
  }

  get status() {
    return { drawn: this.drawn, cursor: this.cursor, cursorAt: this.cursorAt ?? null, plane: this.plane };
  }
}

function drawNumber(context, { x, y }, number, style, current) {
  context.font = `${current ? 700 : 600} 12px system-ui, sans-serif`;
  context.textBaseline = "middle";
  const width = context.measureText(String(number)).width + 6;
  context.fillStyle = style.getPropertyValue("--panel");
  context.globalAlpha = 0.9;
  context.fillRect(x + 8, y - 18, width, 15);
  context.globalAlpha = 1;
  context.fillStyle = style.getPropertyValue("--pick");
  context.fillText(String(number), x + 11, y - 10);
}

function drawCursor(context, { x, y }, color) {
  for (const [stroke, width] of [
    ["#fff", 4],
    [color, 2],
  ]) {
    context.strokeStyle = stroke;
    context.lineWidth = width;
    context.beginPath();
    context.arc(x, y, 7, 0, 2 * Math.PI);
    context.stroke();
  }
}

/**
 * A point moved by a matrix of four columns, divided by its last row.
 *
 * @returns {any}
 */
function applied(m, [x, y, z]) {
  const w = m[3] * x + m[7] * y + m[11] * z + m[15];
  return [0, 1, 2].map((i) => (m[i] * x + m[i + 4] * y + m[i + 8] * z + m[i + 12]) / w);
}

/**
 * A point moved back by a rigid motion.
 *
 * @returns {any}
 */
function unapplied(m, point) {
  const from = point.map((value, i) => value - m[12 + i]);
  return [0, 1, 2].map((i) => m[4 * i] * from[0] + m[4 * i + 1] * from[1] + m[4 * i + 2] * from[2]);
}
