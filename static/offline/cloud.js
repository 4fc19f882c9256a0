// A small 3D view of points on a canvas: orbit, zoom, pan and pick. It is painted here, point by point, so it needs no
// graphics card; marks are drawn over it.

import { cross, dot, unit } from "../canvas/geometry.js";
import { Pen } from "../canvas/pen.js";
import { onWheel, sized, taken, WAYS, within } from "../page/dom.js";
import { rgbOf } from "../page/format.js";

const CLICK_PX = 4;
const TURN_MS = 450;
const REACH_PX = 9; // a click further from every point than this hits none
const NEAREST = 0.05; // of the distance of the eye: what is nearer to it is not drawn
const NEW = [255, 140, 0];
const PALE = [158, 163, 171]; // what the cloth hangs among, washed by so much
const WASH = 0.7;
const BEHIND_M = 0.015; // and so far behind, so that it does not show through the cloth

export class CloudView {
  /**
   * `scene`: cloth, around (by step), axis, cameras (by step). `pick(n)` gets the pixel of cloth that was
   * clicked.
   * @param {HTMLCanvasElement} canvas @param {CloudScene} scene @param {(n: number) => void} pick
   */
  constructor(canvas, scene, pick) {
    this.canvas = canvas;
    this.scene = scene;
    this.pick = pick;
    this.step = scene.start;
    this.tint = 0.5;
    this.follows = true; // the camera from step to step, until somebody turns the item
    this.width = this.height = this.turning = 0;
    this.dirty = false;
    this.mark = /** @type {CloudMark} */ (null);
    /** @type {Uint8Array} of the cloth, three bytes a pixel */
    this.colors = new Uint8Array(3 * scene.cloth.count);
    this.seen = new Int32Array(0); // which pixel of the cloth each pixel of the canvas shows; -1: none
    // Directions that do not turn with the eye: up along the axis, and two across it.
    const up = scene.axis.direction;
    const out = Math.abs(up[2]) < 0.9 ? [0, 0, -1] : [1, 0, 0];
    const south = unit(out.map((x, i) => x - dot(out, up) * up[i]));
    this.basis = { up, south, east: cross(up, south) };
    this.eye = this.lookFrom(scene.start);
    new ResizeObserver(() => this.draw()).observe(canvas);
    this.listen();
  }

  // --- what is shown -------------------------------------------------------------------------

  setStep(/** @type {number} */ step) {
    if (this.follows && step !== this.step) this.turnTo(this.lookFrom(step));
    this.step = step;
    this.redraw();
  }

  /** Look from where the camera stood, and follow it from here on. */
  lookAgain() {
    this.follows = true;
    this.turnTo(this.lookFrom(this.step));
  }

  // --- the eye -------------------------------------------------------------------------------

  /** Where the real camera stood at a step, as an eye that turns about the middle of the cloth. @returns {Eye} */
  lookFrom(/** @type {number} */ step) {
    const { center, cameras } = this.scene;
    const away = cameras[step].map((x, i) => x - center[i]);
    const distance = Math.hypot(...away);
    const { up, east, south } = this.basis;
    const [yaw, pitch] = [Math.atan2(dot(away, east), dot(away, south)), Math.asin(dot(away, up) / distance)];
    return { x: center[0], y: center[1], z: center[2], yaw, pitch, distance, zoom: 1 };
  }

  turnTo(/** @type {Eye} */ goal) {
    cancelAnimationFrame(this.turning);
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return void (this.eye = goal);
    const from = this.eye;
    const turn = Math.atan2(Math.sin(goal.yaw - from.yaw), Math.cos(goal.yaw - from.yaw)); // the shorter way
    const to = { ...goal, yaw: from.yaw + turn };
    const keys = /** @type {(keyof Eye)[]} */ (Object.keys(to));
    const began = performance.now();
    const move = (/** @type {number} */ now) => {
      const s = within((now - began) / TURN_MS, 0, 1);
      for (const key of keys) this.eye[key] = from[key] + s * s * (3 - 2 * s) * (to[key] - from[key]);
      this.redraw();
      if (s < 1) this.turning = requestAnimationFrame(move);
    };
    this.eye = { ...from };
    this.turning = requestAnimationFrame(move);
  }

  /** It is moved by hand. */
  take() {
    cancelAnimationFrame(this.turning);
    this.follows = false;
    this.redraw();
  }

  turn(/** @type {number} */ dx, /** @type {number} */ dy) {
    this.take();
    this.eye.yaw -= dx;
    this.eye.pitch = within(this.eye.pitch + dy, -1.5, 1.5);
  }

  zoom(/** @type {number} */ factor) {
    this.take();
    this.eye.zoom = within(this.eye.zoom * factor, 0.2, 40);
  }

  pan(/** @type {number} */ dx, /** @type {number} */ dy) {
    this.take();
    const { right, down } = this.axes();
    const by = right.map((x, i) => (dx * x + dy * down[i]) / this.scale);
    this.eye.x -= by[0];
    this.eye.y -= by[1];
    this.eye.z -= by[2];
  }

  axes() {
    const { up, east, south } = this.basis;
    const { yaw, pitch } = this.eye;
    const level = up.map((_, i) => Math.sin(yaw) * east[i] + Math.cos(yaw) * south[i]);
    const back = up.map((x, i) => Math.cos(pitch) * level[i] + Math.sin(pitch) * x);
    const right = unit(cross(up, back));
    return { back, right, down: cross(right, back) };
  }

  /** Pixels of the canvas to a metre at the middle of the cloth: all of it is seen. */
  get scale() {
    const { width, height, eye } = this;
    const [across, upright] = this.scene.halfExtents;
    return (eye.zoom * Math.min(width / across, height / upright)) / 2.4;
  }

  /** Where points appear: CSS pixels, and how far they are as a share of the distance of the middle. */
  projection() {
    const { right, down, back } = this.axes();
    const { scale, width, height, eye } = this;
    return (/** @type {number} */ px, /** @type {number} */ py, /** @type {number} */ pz) => {
      const [x, y, z] = [px - eye.x, py - eye.y, pz - eye.z];
      const far = 1 - (back[0] * x + back[1] * y + back[2] * z) / eye.distance;
      const by = scale / far;
      return {
        x: width / 2 + by * (right[0] * x + right[1] * y + right[2] * z),
        y: height / 2 + by * (down[0] * x + down[1] * y + down[2] * z),
        far,
      };
    };
  }

  /** Where a point appears. */
  toScreen(/** @type {XYZ} */ point) {
    return this.projection()(...point);
  }

  /** The pixel of cloth that is seen at a place, or -1. */
  pixelAt(/** @type {number} */ x, /** @type {number} */ y) {
    const { width, height } = this.canvas;
    const [col, row, reach] = [x, y, REACH_PX].map((px) => Math.round(px * devicePixelRatio));
    let [best, least] = [-1, reach];
    for (let r = Math.max(0, row - reach); r < Math.min(height, row + reach); r++)
      for (let c = Math.max(0, col - reach); c < Math.min(width, col + reach); c++) {
        const away = Math.hypot(r - row, c - col);
        if (this.seen[r * width + c] >= 0 && away < least) [best, least] = [this.seen[r * width + c], away];
      }
    return best;
  }

  // --- drawing -------------------------------------------------------------------------------

  redraw() {
    if (this.dirty) return;
    this.dirty = true;
    requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.dirty = false;
    const { canvas, scene } = this;
    [this.width, this.height] = [canvas.clientWidth, canvas.clientHeight];
    if (!this.width || !this.height) return;
    const pen = new Pen(sized(canvas, this.width, this.height));
    const image = pen.context.createImageData(canvas.width, canvas.height);
    const [red, green, blue] = rgbOf(pen.color("--ground"));
    new Uint32Array(image.data.buffer).fill(packed(red, green, blue));
    this.seen = new Int32Array(canvas.width * canvas.height).fill(-1);
    const depth = new Float32Array(this.seen.length).fill(Infinity);
    const { xyz, first, grid } = scene.cloth;
    this.paint(image, depth, { xyz, rgb: this.colors, first, size: 1.5 * grid.pixel_size_m });
    this.paint(image, depth, { ...scene.around[this.step], first: null, size: 1.6 * scene.spacing });
    pen.context.putImageData(image, 0, 0);
    this.drawMarks(pen);
  }

  /**
   * Paint points as squares, the nearest of them where several are; those that are there from the first step on have
   * no `first`, and are pale.
   * @param {ImageData} image @param {Float32Array} depth of each pixel, which is kept
   * @param {{ xyz: Float32Array; rgb: Uint8Array; first: Float32Array | null; size: number }} points
   */
  paint({ data, width, height }, depth, { xyz, rgb, first, size }) {
    const project = this.projection();
    const pixels = new Uint32Array(data.buffer);
    const ratio = devicePixelRatio;
    const behind = first ? 0 : BEHIND_M / this.eye.distance;
    for (let n = 0; 3 * n < xyz.length; n++) {
      if (first && first[n] > this.step) continue;
      const { x, y, far } = project(xyz[3 * n], xyz[3 * n + 1], xyz[3 * n + 2]);
      if (far < NEAREST) continue;
      const [wash, share] = first ? [NEW, first[n] === this.step ? this.tint : 0] : [PALE, WASH];
      const [red, green, blue] = wash.map((c, i) => rgb[3 * n + i] + share * (c - rgb[3 * n + i]));
      const color = packed(red, green, blue);
      const wide = Math.max(1, Math.round((ratio * size * this.scale) / far));
      const left = Math.round(ratio * x - wide / 2);
      const top = Math.round(ratio * y - wide / 2);
      for (let row = Math.max(0, top); row < Math.min(height, top + wide); row++)
        for (let col = Math.max(0, left); col < Math.min(width, left + wide); col++) {
          const at = row * width + col;
          if (depth[at] <= far + behind) continue;
          depth[at] = far + behind;
          this.seen[at] = first ? n : -1;
          pixels[at] = color;
        }
    }
  }

  drawMarks(/** @type {Pen} */ pen) {
    const project = this.projection();
    /** @type {(segments: [XYZ, XYZ][], color: string, width: number) => void} */
    const line = (segments, color, width) => {
      for (const ends of segments) {
        const seen = ends.map((end) => project(...end));
        if (seen.every(({ far }) => far > NEAREST)) pen.line(seen, color, width);
      }
    };
    pen.context.lineCap = "round";
    pen.context.globalAlpha = 0.45;
    line([this.scene.axis.line], "--soft", 1);
    pen.context.globalAlpha = 1;
    if (!this.mark) return;
    if (this.mark.gripper)
      for (const rim of [true, false]) line(this.mark.gripper, rim ? "#fff" : "--pick", rim ? 5 : 2.5);
    pen.dot(this.toScreen(this.mark.point), "--pick", 5.75);
  }

  // --- pointer and keys ----------------------------------------------------------------------

  listen() {
    const canvas = this.canvas;
    let gesture = /** @type {(Point & { moved: boolean; pan: boolean }) | null} */ (null);
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      gesture = { x: event.offsetX, y: event.offsetY, moved: false, pan: event.button !== 0 || event.shiftKey };
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!gesture) return;
      const [dx, dy] = [event.offsetX - gesture.x, event.offsetY - gesture.y];
      gesture.moved ||= Math.hypot(dx, dy) > CLICK_PX;
      if (!gesture.moved) return;
      if (gesture.pan) this.pan(dx, dy);
      else this.turn(dx * 0.008, dy * 0.008);
      Object.assign(gesture, { x: event.offsetX, y: event.offsetY });
    });
    canvas.addEventListener("pointerup", (event) => {
      if (gesture && !gesture.moved && !gesture.pan) this.pick(this.pixelAt(event.offsetX, event.offsetY));
      gesture = null;
    });
    canvas.addEventListener("pointercancel", () => (gesture = null));
    onWheel(canvas, (factor, event) => {
      event.preventDefault();
      this.zoom(factor);
    });
    canvas.addEventListener("keydown", (event) => {
      const way = WAYS[event.key];
      if (way) this.turn(0.12 * way[0], 0.12 * way[1]);
      else if (event.key === "+" || event.key === "=") this.zoom(1.25);
      else if (event.key === "-") this.zoom(1 / 1.25);
      else return;
      taken(event);
    });
  }
}

/** An opaque colour as a pixel of a canvas has it. @param {number} red @param {number} green @param {number} blue */
const packed = (red, green, blue) => (255 << 24) | (blue << 16) | (green << 8) | red;
