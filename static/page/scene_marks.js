// Marks over the 3D scene: all picks with their numbers, visible through the cloth, the normal and the gripper of the
// current one, and the point under the pointer.
//
// They are drawn by this page on a canvas over viser's, with the camera that viser has at that moment: so a mark
// is never hidden, and follows the pointer without waiting for the scene.

import { PagePart } from "./page.js";
import { drawDot, drawLabel, drawRing, strokeRimmed, strokeLine } from "../canvas/marks.js";
import { byId, sized } from "./dom.js";
import { number } from "./format.js";

const EDGE = 14;
const NORMAL_M = 0.06; // length of the arrow

/**
 * @typedef {{ id: number; position_held_m: XYZ }} MarkedPick
 * @typedef {{ elements: number[] }} Matrix4
 * @typedef {Record<
 *   "matrixWorld" | "matrixWorldInverse" | "projectionMatrix" | "projectionMatrixInverse", Matrix4
 * >} Camera of three.js
 * @typedef {{ camera: Camera; world: number[]; canvas: HTMLCanvasElement; redraw(): void }} SceneView of viser's page
 * @typedef {{
 *   nodeRefFromName?: Record<string, { matrixWorld: Matrix4 }>; camera?: Camera; canvas?: HTMLCanvasElement;
 *   requestRender?(): void
 * }} Viser what viser's page has of itself
 * @typedef {{ origin_m: XYZ; direction: XYZ }} Ray
 */

/** A vector that is so many times as long. @returns {XYZ} */
const scaled = (/** @type {XYZ} */ [x, y, z], /** @type {number} */ by) => [by * x, by * y, by * z];

export class SceneMarks extends PagePart {
  name = "sceneMarks";
  frame = byId("viser");
  overlay = byId("scene-marks");
  picks = /** @type {MarkedPick[]} */ ([]);
  current = /** @type {number | null} */ (null);
  pick = /** @type {CurrentPick | null} */ (null); // its numbers, once they are known
  cursor = /** @type {XYZ | null} */ (null); // a point in space that the pointer is at, on either side
  plane = /** @type {UV | null} */ (null); // and where it lies on the plane
  drawers = /** @type {SceneDrawer[]} */ ([]); // of panels
  drawn = /** @type {({ id: number; x: number; y: number; inside: boolean } | null)[]} */ ([]); // for tests
  cursorAt = /** @type {Point | null} */ (null);
  dirty = true;
  key = ""; // of what is drawn: the camera
  taken = ""; // the size that viser has taken
  width = 0;
  height = 0;
  question = this.page.question(
    "hover_ray",
    (id, /** @type {Ray} */ ray) => this.ask(id, ray),
    ({ xyz_m, uv_m, sheet }) => this.show(xyz_m, uv_m && this.canvas.shownAt(sheet, uv_m)),
  );
  /** @type {Panel["messages"]} */
  messages = { picked: (message) => this.highlight(message) };

  constructor(/** @type {Page} */ page) {
    super(page);
    this.frame.addEventListener("load", () => this.listen());
    const tick = () => {
      this.draw();
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  update(/** @type {State} */ state) {
    this.picks = state.picks ?? [];
    this.current = state.pick?.id ?? null;
    this.pick = state.pick;
    this.dirty = true;
  }

  /** A new pick is shown at once, here and on the plane; its name and its numbers come with the next state. */
  highlight(/** @type {import("./messages").Picked} */ pick) {
    const { canvas } = this.page;
    const at = canvas.shownAt(pick.side, pick.uv_m);
    if (at) canvas.marks = [...canvas.marks.filter(({ id }) => id !== pick.id), { id: pick.id, uv_m: at }];
    canvas.redraw();
    this.picks = [...this.picks.filter(({ id }) => id !== pick.id), pick];
    this.current = pick.id;
    this.dirty = true;
  }

  /** The pointer is over the flattened view: its point in space has a cursor. */
  hovered(/** @type {HoverAnswer | null} */ answer) {
    const at = answer?.shape ?? answer?.proposal ?? null;
    this.show(at ? scaled(at.xyz_mm, 1 / 1000) : null, null);
  }

  // --- the pointer in the scene ------------------------------------------------------------------

  listen() {
    const inside = /** @type {Window} */ (this.frame.contentWindow);
    inside.addEventListener("pointermove", (event) => {
      const ray = event.buttons ? null : this.rayAt(event.clientX, event.clientY);
      if (ray) this.question.ask(ray);
    });
    inside.addEventListener("pointerout", (event) => !event.relatedTarget && this.leave());
  }

  leave() {
    this.question.drop();
    this.show(null, null);
  }

  ask(/** @type {number} */ id, /** @type {Ray} */ ray) {
    const { layers, capture } = this.page.state ?? {};
    return Boolean(layers) && !capture?.playing && this.page.send({ type: "hover_ray", id, ...ray });
  }

  show(/** @type {XYZ | null} */ xyz, /** @type {UV | null} */ uv) {
    this.cursor = xyz;
    this.plane = uv;
    this.dirty = true;
    this.page.canvas.redraw();
  }

  /**
   * viser's camera and the matrix from the object frame to its world, in which up is +y; null until there is a scene.
   * A new node has no place yet: viser sets that, and its camera, when it draws the next time.
   */
  get view() {
    const inside = /** @type {{ __viserMutable?: Viser } | null} */ (this.frame.contentWindow);
    const viser = inside?.__viserMutable;
    const node = viser?.nodeRefFromName?.["/live/cloud"];
    if (!node || !viser?.camera || !viser.canvas || !isUpright(node.matrixWorld)) return null;
    const redraw = () => viser.requestRender?.();
    return { camera: viser.camera, world: node.matrixWorld.elements, canvas: viser.canvas, redraw };
  }

  rayAt(/** @type {number} */ x, /** @type {number} */ y) {
    const { view } = this;
    if (!view) return null;
    const box = view.canvas.getBoundingClientRect();
    const [a, b] = [(2 * (x - box.left)) / box.width - 1, 1 - (2 * (y - box.top)) / box.height];
    const { matrixWorld, projectionMatrixInverse } = view.camera;
    const [px, py, pz] = applied(projectionMatrixInverse.elements, [a, b, 0.5]);
    const [ex, ey, ez] = matrixWorld.elements.slice(12, 15);
    const through = applied(matrixWorld.elements, [px, py, pz]);
    const back = [...new DOMMatrix(view.world).inverse().toFloat64Array()];
    const origin = applied(back, [ex, ey, ez]);
    const end = applied(back, through);
    /** @type {XYZ} */
    const direction = [end[0] - origin[0], end[1] - origin[1], end[2] - origin[2]];
    return { origin_m: origin, direction: scaled(direction, 1 / Math.hypot(...direction)) };
  }

  /** Where a point of the object frame is seen on the overlay; null behind the eye. */
  place(/** @type {SceneView} */ view, /** @type {XYZ} */ point) {
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
    const taken = `${view.canvas.width} ${view.canvas.height}`;
    if (taken !== this.taken) view.redraw(); // another size has cleared viser's picture, as that of a hidden pane
    this.taken = taken;
    if (!this.dirty && key === this.key && width === this.width && height === this.height) return;
    this.dirty = false;
    this.key = key;
    this.width = width;
    this.height = height;
    Object.assign(this.overlay.style, { width: `${width}px`, height: `${height}px` });
    const context = sized(this.overlay, width, height);
    const style = getComputedStyle(this.overlay);
    for (const draw of this.drawers) draw(context, style, (point) => this.place(view, point));
    this.drawn = this.picks.map((pick) => this.drawPick(context, style, view, pick));
    const at = this.cursor && this.place(view, this.cursor);
    if (at) drawRing(context, at, style.getPropertyValue("--accent"), 7);
    this.cursorAt = at ?? null;
  }

  /** @param {Context} context @param {Style} style @param {SceneView} view @param {MarkedPick} pick */
  drawPick(context, style, view, pick) {
    const at = this.place(view, pick.position_held_m);
    if (!at) return null;
    const current = pick.id === this.current;
    if (this.pick && current && this.pick.id === pick.id) this.drawGrip(context, style, view, this.pick);
    drawDot(context, at, style.getPropertyValue("--pick"), current ? 6 : 4);
    drawNumber(context, at, pick.id, style, current);
    return { id: pick.id, x: at.x, y: at.y, inside: at.x > EDGE && at.x < this.width - EDGE };
  }

  /**
   * The normal of a pick as an arrow, and the gripper on it.
   * @param {Context} context @param {Style} style @param {SceneView} view @param {CurrentPick} pick
   */
  drawGrip(context, style, view, { position_held_m: foot, normal_held: normal, grip }) {
    const lines = (grip?.gripper_m ?? []).map((line) => line.map((point) => this.place(view, point)));
    const tip = foot.map((x, i) => x + NORMAL_M * (normal[i] ?? NaN));
    const arrow = [foot, /** @type {XYZ} */ (tip)].map((point) => this.place(view, point));
    const [from, to] = arrow;
    if (from && to && Number.isFinite(to.x)) {
      lines.push(arrow);
      const [x, y] = [(from.x - to.x) / 5, (from.y - to.y) / 5]; // the barbs are as wide as they are long
      for (const side of [-1, 1]) lines.push([to, { x: to.x + x - side * y, y: to.y + y + side * x }]);
    }
    strokeRimmed(context, style.getPropertyValue("--pick"), 2, () => {
      for (const [start, end] of lines) {
        if (!start || !end) continue;
        context.moveTo(start.x, start.y);
        context.lineTo(end.x, end.y);
      }
    });
  }

  drawOver(/** @type {Context} */ context, /** @type {Style} */ style) {
    if (this.plane) {
      drawRing(context, this.page.canvas.transform.toPane(...this.plane), style.getPropertyValue("--accent"), 7);
    }
    for (const pick of this.page.canvas.marks) {
      if (pick.id === null) continue;
      const at = this.page.canvas.transform.toPane(...pick.uv_m);
      drawNumber(context, at, pick.id, style, pick.id === this.current);
    }
  }

  get status() {
    return { drawn: this.drawn, cursor: this.cursor, cursorAt: this.cursorAt, plane: this.plane };
  }
}

/**
 * @param {Context} context @param {Point} parts @param {number} number @param {Style} style
 * @param {boolean} current
 */
function drawNumber(context, { x, y }, number, style, current) {
  context.font = `${current ? 700 : 600} 12px system-ui, sans-serif`;
  context.textBaseline = "middle";
  /** @type {[number, number, number, number]} */
  const box = [x + 8, y - 18, context.measureText(String(number)).width + 6, 15];
  drawLabel(context, style, String(number), [x + 11, y - 10], box, { color: "--pick", alpha: 0.9 });
}

/** Whether a matrix from the object frame, in which up is -y, turns up to +y: the identity does not. */
const isUpright = (/** @type {Matrix4} */ { elements }) => elements[5] < 0;

/** A point moved by a matrix of four columns, divided by its last row. @returns {XYZ} */
function applied(/** @type {number[]} */ matrix, /** @type {XYZ} */ [x, y, z]) {
  const at = new DOMMatrix(matrix).transformPoint({ x, y, z });
  return [at.x / at.w, at.y / at.w, at.z / at.w];
}

// --- In the corners of the 3D scene ------------------------------------------------------------

const RADIUS = 36;
const MARGIN = 22;
const AXIS_PX = 26;
const ABOVE_RAD = 0.6;
/** @type {Record<string, [shade: string, unit: XYZ]>} */
const AXES = { x: ["--bad", [1, 0, 0]], y: ["--good", [0, 1, 0]], z: ["--accent", [0, 0, 1]] };

export class Dial extends PagePart {
  /** @param {Context} context @param {Style} style */
  drawInScene(context, style) {
    const { state, sceneMarks } = this.page;
    if (this.page.hasCamera || sceneMarks.width < 200) return;
    context.font = "14px system-ui, sans-serif";
    context.textBaseline = "middle";
    const from = { x: sceneMarks.width - RADIUS - MARGIN, y: RADIUS + MARGIN };
    const color = (/** @type {string} */ name) => style.getPropertyValue(name);
    const dot = (/** @type {Point} */ { x, y }, /** @type {number} */ radius, /** @type {string} */ name) => {
      context.beginPath();
      context.arc(x, y, radius, 0, 2 * Math.PI);
      context.fillStyle = color(name);
      context.fill();
    };
    const at = (/** @type {number} */ deg, far = RADIUS) => {
      const turn = (deg * Math.PI) / 180;
      return { x: from.x - far * Math.sin(turn), y: from.y + far * Math.cos(turn) };
    };
    strokeLine(
      context,
      [...Array(73).keys()].map((n) => at(5 * n)),
      color("--line"),
      1,
    );
    for (const { angle_deg, state: was } of state.views) {
      if (was === "unused") dot(at(angle_deg), 1.5, "--soft");
      else dot(at(angle_deg), 4, was === "rejected" ? "--bad" : "--good");
    }
    const present = state.views[state.present_view ?? -1]?.angle_deg;
    if (present === undefined) return;
    strokeLine(context, [at(present, 24), at(present, RADIUS + 12)], color("--text"), 3);
    const next = state.active?.angle_deg ?? present;
    strokeLine(context, [at(present, 26), at(next, 26)], color("--accent"), 2, [4, 3]);
    drawLabel(context, style, `${number(present, 0)}°`, [from.x - 14, from.y], [from.x - 16, from.y - 9, 34, 18]);
    this.drawAxes(context, color);
  }

  /** The object frame from a little above the camera; an axis that points at it or away has no letter. */
  drawAxes(/** @type {Context} */ context, /** @type {(name: string) => string} */ color) {
    const { view } = this.page.sceneMarks;
    if (!view) return;
    const seen = (/** @type {XYZ} */ point) =>
      applied(view.camera.matrixWorldInverse.elements, applied(view.world, point));
    const from = seen([0, 0, 0]);
    Object.entries(AXES).forEach(([name, [shade, unit]]) => {
      const [x, y, z] = seen(unit).map((value, i) => value - from[i]);
      const at = (/** @type {number} */ far) => {
        return { x: 48 + far * x, y: 48 + far * (Math.sin(ABOVE_RAD) * z - Math.cos(ABOVE_RAD) * y) };
      };
      strokeLine(context, [at(0), at(AXIS_PX)], color(shade), 2);
      context.fillStyle = color(shade);
      if (Math.hypot(x, y) > 0.5) context.fillText(name, at(1.4 * AXIS_PX).x - 4, at(1.4 * AXIS_PX).y);
    });
  }
}
