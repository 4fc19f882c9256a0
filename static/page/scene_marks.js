// Marks over the 3D scene: all picks with their numbers, visible through the cloth, the normal and the gripper of the
// current one, and the point under the pointer.
//
// They are drawn by this page on a canvas over viser's, with the camera that viser has at that moment: so a mark
// is never hidden, and follows the pointer without waiting for the scene.

import { PagePart } from "./page.js";
import { unit } from "../canvas/geometry.js";
import { Pen } from "../canvas/pen.js";
import { byId, sized } from "./dom.js";
import { number } from "./format.js";

const EDGE = 14;
const NORMAL_M = 0.06; // length of the arrow

/**
 * @typedef {{ id: number; position_held_m: XYZ }} MarkedPick
 * @typedef {{ elements: number[] }} Matrix4
 * @typedef {{ inCamera: DOMMatrix; seen: DOMMatrix; canvas: HTMLCanvasElement; redraw(): void }} SceneView from the
 *   object frame to the camera's, and to where it is seen
 * @typedef {{
 *   nodeRefFromName?: Record<string, { matrixWorld: Matrix4 }>; canvas?: HTMLCanvasElement; requestRender?(): void;
 *   camera?: Record<"matrixWorldInverse" | "projectionMatrix", Matrix4>
 * }} Viser what viser's page has of itself
 * @typedef {{ origin_m: XYZ; direction: XYZ }} Ray
 */

export class SceneMarks extends PagePart {
  name = "sceneMarks";
  frame = byId("viser");
  overlay = byId("scene-marks");
  picks = /** @type {MarkedPick[]} */ ([]);
  current = /** @type {number | null} */ (null);
  pick = /** @type {CurrentPick | null} */ (null); // its numbers, once they are known
  cursor = /** @type {XYZ | null} */ (null); // a point in space that the pointer is at, on either side
  plane = /** @type {UV | null} */ (null); // and where it lies on the plane
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
    this.show(at && /** @type {XYZ} */ (at.xyz_mm.map((x) => x / 1000)), null);
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
    const { projectionMatrix, matrixWorldInverse } = viser.camera;
    const [project, toCamera, world] = [projectionMatrix, matrixWorldInverse, node.matrixWorld].map(
      ({ elements }) => new DOMMatrix(elements),
    );
    const inCamera = toCamera.multiply(world);
    return {
      inCamera,
      seen: project.multiply(inCamera),
      canvas: viser.canvas,
      redraw: () => viser.requestRender?.(),
    };
  }

  /** The line of sight through a place of the window of the scene, in the object frame. */
  rayAt(/** @type {number} */ x, /** @type {number} */ y) {
    const { view } = this;
    if (!view) return null;
    const box = view.canvas.getBoundingClientRect();
    const [a, b] = [(2 * (x - box.left)) / box.width - 1, 1 - (2 * (y - box.top)) / box.height];
    const eye = moved(view.inCamera.inverse(), [0, 0, 0]);
    const far = moved(view.seen.inverse(), [a, b, 1]);
    return /** @type {Ray} */ ({ origin_m: eye, direction: unit(far.map((value, i) => value - eye[i])) });
  }

  /** Where a point of the object frame is seen on the overlay; null behind the eye. */
  place(/** @type {SceneView} */ { seen, canvas }, /** @type {XYZ} */ [px, py, pz]) {
    const { x, y, w } = seen.transformPoint({ x: px, y: py, z: pz });
    if (w <= 0) return null;
    return { x: ((x / w + 1) / 2) * canvas.clientWidth, y: ((1 - y / w) / 2) * canvas.clientHeight };
  }

  // --- drawing -----------------------------------------------------------------------------------

  draw() {
    const { view } = this;
    if (!view) return;
    const key = view.seen.toFloat64Array().join();
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
    const pen = new Pen(sized(this.overlay, width, height));
    const place = (/** @type {XYZ} */ point) => this.place(view, point);
    this.page.each("drawInScene", pen, place);
    this.drawn = this.picks.map((pick) => this.drawPick(pen, place, pick));
    const at = this.cursor && place(this.cursor);
    if (at) pen.ring(at, "--accent", 7);
    this.cursorAt = at ?? null;
  }

  /** @param {Pen} pen @param {PlaceInScene} place @param {MarkedPick} pick */
  drawPick(pen, place, pick) {
    const at = place(pick.position_held_m);
    if (!at) return null;
    const current = pick.id === this.current;
    if (this.pick && current && this.pick.id === pick.id) drawGrip(pen, place, this.pick);
    pen.dot(at, "--pick", current ? 6 : 4);
    drawNumber(pen, at, pick.id, current);
    return { id: pick.id, x: at.x, y: at.y, inside: at.x > EDGE && at.x < this.width - EDGE };
  }

  drawOver(/** @type {Pen} */ pen) {
    if (this.plane) pen.ring(pen.at(this.plane), "--accent", 7);
    for (const { id, uv_m } of this.canvas.marks)
      if (id !== null) drawNumber(pen, pen.at(uv_m), id, id === this.current);
  }
}

/**
 * The normal of a pick as an arrow, and the gripper on it.
 * @param {Pen} pen @param {PlaceInScene} place @param {CurrentPick} pick
 */
function drawGrip(pen, place, { position_held_m: foot, normal_held: normal, grip }) {
  const lines = (grip?.gripper_m ?? []).map((line) => line.map(place));
  const tip = foot.map((x, i) => x + NORMAL_M * (normal[i] ?? NaN));
  const [from, to] = [foot, /** @type {XYZ} */ (tip)].map(place);
  if (from && to && Number.isFinite(to.x)) {
    const [x, y] = [(from.x - to.x) / 5, (from.y - to.y) / 5]; // the barbs are as wide as they are long
    lines.push([from, to]);
    for (const side of [-1, 1]) lines.push([to, { x: to.x + x - side * y, y: to.y + y + side * x }]);
  }
  pen.rimmed("--pick", 2, (path) => {
    for (const [start, end] of lines) {
      if (!start || !end) continue;
      path.moveTo(start.x, start.y);
      path.lineTo(end.x, end.y);
    }
  });
}

/** @param {Pen} pen @param {Point} at @param {number} id @param {boolean} current */
function drawNumber(pen, { x, y }, id, current) {
  const font = `${current ? 700 : 600} 12px system-ui, sans-serif`;
  pen.label(String(id), { x: x + 7, y: y - 10 }, { font, color: "--pick", alpha: 0.9, height: 15 });
}

/** Whether a matrix from the object frame, in which up is -y, turns up to +y: the identity does not. */
const isUpright = (/** @type {Matrix4} */ { elements }) => elements[5] < 0;

/** A point moved by a matrix, and divided by its last row. */
function moved(/** @type {DOMMatrix} */ matrix, /** @type {XYZ} */ [px, py, pz]) {
  const { x, y, z, w } = matrix.transformPoint({ x: px, y: py, z: pz });
  return [x / w, y / w, z / w];
}

// --- In the corners of the 3D scene ------------------------------------------------------------

const RADIUS = 36;
const MARGIN = 22;
const AXIS_PX = 26;
const ABOVE_RAD = 0.6;
/** @type {Record<string, [shade: string, unit: XYZ]>} */
const AXES = { x: ["--bad", [1, 0, 0]], y: ["--good", [0, 1, 0]], z: ["--accent", [0, 0, 1]] };

export class Dial extends PagePart {
  drawInScene(/** @type {Pen} */ pen) {
    const { state, sceneMarks } = this.page;
    if (this.page.hasCamera || sceneMarks.width < 200) return;
    const from = { x: sceneMarks.width - RADIUS - MARGIN, y: RADIUS + MARGIN };
    const at = (/** @type {number} */ deg, far = RADIUS) => {
      const turn = (deg * Math.PI) / 180;
      return { x: from.x - far * Math.sin(turn), y: from.y + far * Math.cos(turn) };
    };
    pen.line(
      [...Array(73).keys()].map((n) => at(5 * n)),
      "--line",
      1,
    );
    for (const { angle_deg, state: was } of state.views) {
      const { x, y } = at(angle_deg);
      const color = was === "unused" ? "--soft" : was === "rejected" ? "--bad" : "--good";
      pen.fill(color, (to) => to.arc(x, y, was === "unused" ? 1.5 : 4, 0, 2 * Math.PI));
    }
    const present = state.views[state.present_view ?? -1]?.angle_deg;
    if (present === undefined) return;
    pen.line([at(present, 24), at(present, RADIUS + 12)], "--text", 3);
    pen.line([at(present, 26), at(state.active?.angle_deg ?? present, 26)], "--accent", 2, [4, 3]);
    const font = "14px system-ui, sans-serif";
    const text = `${number(present, 0)}°`;
    pen.label(text, { x: from.x - pen.widthOf(text, font) / 2, y: from.y }, { font });
    this.drawAxes(pen, font);
  }

  /** The object frame from a little above the camera; an axis that points at it or away has no letter. */
  drawAxes(/** @type {Pen} */ pen, /** @type {string} */ font) {
    const { view } = this.page.sceneMarks;
    if (!view) return;
    const from = moved(view.inCamera, [0, 0, 0]);
    for (const [name, [color, way]] of Object.entries(AXES)) {
      const [x, y, z] = moved(view.inCamera, way).map((value, i) => value - from[i]);
      const at = (/** @type {number} */ far) => {
        return { x: 48 + far * x, y: 48 + far * (Math.sin(ABOVE_RAD) * z - Math.cos(ABOVE_RAD) * y) };
      };
      pen.line([at(0), at(AXIS_PX)], color, 2);
      const letter = { x: at(1.4 * AXIS_PX).x - 9, y: at(1.4 * AXIS_PX).y };
      if (Math.hypot(x, y) > 0.5) pen.label(name, letter, { font, color, alpha: 0 });
    }
  }
}
