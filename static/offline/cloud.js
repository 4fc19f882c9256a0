// A small 3D view of points: orbit, zoom, pan and pick, on plain WebGL; marks are drawn over it in 2D.

import { cross, dot, unit } from "../canvas/geometry.js";
import { drawDot } from "../canvas/marks.js";
import { graphicsOf, onWheel, sized, taken, WAYS, within } from "../page/dom.js";

const CLICK_PX = 4;
const TURN_MS = 450;
const REACH_PX = 9; // a click further from every point than this hits none
const LAYER_M = 0.01;

const POINTS = {
  vertex: `#version 300 es
    in vec3 place; in vec3 color; in float first;
    uniform mat4 clip_from_held; uniform float size, step, tint, lift;
    out vec3 shade;
    void main() {
      gl_Position = first > step + 0.5 ? vec4(2.0, 2.0, 2.0, 1.0) : clip_from_held * vec4(place, 1.0);
      gl_Position.z += lift * gl_Position.w;
      gl_PointSize = max(size / gl_Position.w, 1.5);
      shade = mix(color, vec3(1.0, 0.55, 0.0), abs(first - step) < 0.5 ? tint : 0.0);
    }`,
  fragment: `#version 300 es
    precision mediump float;
    in vec3 shade; uniform vec4 wash; out vec4 paint;
    void main() {
      if (length(gl_PointCoord - 0.5) > 0.5) discard;
      paint = vec4(mix(shade, wash.rgb, wash.a), 1.0);
    }`,
};

export class CloudView {
  /**
   * `scene`: cloth, around (by step), axis, cameras (by step). `pick(n)` gets the pixel of cloth that was
   * clicked.
   * @param {HTMLCanvasElement} canvas @param {HTMLCanvasElement} marks @param {CloudScene} scene
   * @param {(n: number) => void} pick
   */
  constructor(canvas, marks, scene, pick) {
    this.canvas = canvas;
    this.marksCanvas = marks;
    this.scene = scene;
    this.pick = pick;
    this.step = 0;
    this.tint = 0.5;
    this.showAround = true;
    this.width = this.height = this.turning = 0;
    this.dirty = false;
    this.mark = /** @type {CloudMark} */ (null);
    this.eye = this.lookFrom(scene.start);
    const gl = graphicsOf(canvas, { antialias: true, preserveDrawingBuffer: true });
    this.points = gl && new Points(gl, scene);
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.points = gl && new Points(gl, scene, this.points?.colors);
      this.redraw();
    });
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.listen();
  }

  // --- what is shown -------------------------------------------------------------------------

  setStep(/** @type {number} */ step, /** @type {boolean} */ follow) {
    this.step = step;
    if (follow) this.turnTo(this.lookFrom(step));
    this.redraw();
  }

  /** Color the cloth, three bytes a pixel. */
  setColors(/** @type {Uint8Array} */ rgb) {
    this.points?.color(rgb);
    this.redraw();
  }

  // --- the eye -------------------------------------------------------------------------------

  /** Where the real camera stood at a step, as an eye that turns about the middle of the cloth. */
  lookFrom(/** @type {number} */ step) {
    const { center } = this.scene;
    const camera = this.scene.cameras[step];
    const away = camera.map((x, i) => x - center[i]);
    const distance = Math.hypot(...away);
    const { up, east, south } = this.basis();
    return {
      target: [...center],
      yaw: Math.atan2(dot(away, east), dot(away, south)),
      pitch: Math.asin(dot(away, up) / distance),
      distance,
      zoom: 1,
    };
  }

  /** Half of what is seen along the shorter side of the view, in metres at the middle of the cloth. */
  get extent() {
    const aspect = this.width / this.height;
    const [across, upright] = this.scene.halfExtents;
    return (1.2 * Math.max(across / Math.max(1, aspect), upright / Math.max(1, 1 / aspect))) / this.eye.zoom;
  }

  /** Directions that do not turn with the eye: up along the axis, and two across it. */
  basis() {
    const up = this.scene.axis.direction;
    const out = Math.abs(up[2]) < 0.9 ? [0, 0, -1] : [1, 0, 0];
    const south = unit(out.map((x, i) => x - dot(out, up) * up[i]));
    return { up, south, east: cross(up, south) };
  }

  turnTo(/** @type {Eye} */ goal) {
    cancelAnimationFrame(this.turning);
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return void (this.eye = goal);
    const from = this.eye;
    const turn = Math.atan2(Math.sin(goal.yaw - from.yaw), Math.cos(goal.yaw - from.yaw));
    const began = performance.now();
    const move = (/** @type {number} */ now) => {
      const s = within((now - began) / TURN_MS, 0, 1);
      const share = s * s * (3 - 2 * s);
      const between = (/** @type {number} */ a, /** @type {number} */ b) => a + share * (b - a);
      this.eye = {
        target: from.target.map((x, i) => between(x, goal.target[i])),
        yaw: from.yaw + share * turn,
        pitch: between(from.pitch, goal.pitch),
        distance: between(from.distance, goal.distance),
        zoom: between(from.zoom, goal.zoom),
      };
      this.redraw();
      if (s < 1) this.turning = requestAnimationFrame(move);
    };
    this.turning = requestAnimationFrame(move);
  }

  turn(/** @type {number} */ dx, /** @type {number} */ dy) {
    cancelAnimationFrame(this.turning);
    this.eye.yaw -= dx;
    this.eye.pitch = within(this.eye.pitch + dy, -1.5, 1.5);
    this.redraw();
  }

  zoom(/** @type {number} */ factor) {
    cancelAnimationFrame(this.turning);
    this.eye.zoom = within(this.eye.zoom * factor, 0.2, 40);
    this.redraw();
  }

  pan(/** @type {number} */ dx, /** @type {number} */ dy) {
    cancelAnimationFrame(this.turning);
    const { right, down } = this.axes();
    const scale = (2 * this.extent) / Math.min(this.width, this.height);
    for (let i = 0; i < 3; i++) this.eye.target[i] -= scale * (dx * right[i] + dy * down[i]);
    this.redraw();
  }

  axes() {
    const { up, east, south } = this.basis();
    const { yaw, pitch } = this.eye;
    const back = up.map(
      (_, i) => Math.cos(pitch) * (Math.sin(yaw) * east[i] + Math.cos(yaw) * south[i]) + Math.sin(pitch) * up[i],
    );
    const right = unit(cross(up, back));
    return { back, right, down: cross(right, back) };
  }

  /** Column-major: rows x right, y up, z by depth, w the depth over the distance. */
  matrix() {
    const { back, right, down } = this.axes();
    const { target, distance } = this.eye;
    const { extent } = this;
    const aspect = this.width / this.height;
    const wide = Math.max(1, aspect);
    const high = Math.max(1, 1 / aspect);
    /** @type {[number[], number, number][]} */
    const rows = [
      [right, 1 / (extent * wide), 0],
      [down, -1 / (extent * high), 0],
      [back, -1 / (3 * extent + 1), 0],
      [back, -1 / distance, 1],
    ];
    const m = new Float32Array(16);
    rows.forEach(([axis, scale, more], r) => {
      for (let c = 0; c < 3; c++) m[4 * c + r] = scale * axis[c];
      m[12 + r] = more - scale * dot(axis, target);
    });
    return m;
  }

  /** Where a point appears, CSS pixels, and how far it is. */
  toScreen(/** @type {Numbers} */ point, m = this.matrix()) {
    const [x, y, , w] = [0, 1, 2, 3].map(
      (r) => m[r] * point[0] + m[4 + r] * point[1] + m[8 + r] * point[2] + m[12 + r],
    );
    return { x: ((x / w + 1) / 2) * this.width, y: ((1 - y / w) / 2) * this.height, depth: w * this.eye.distance };
  }

  /** The pixel of cloth that is seen at a place, or -1. */
  pixelAt(/** @type {number} */ x, /** @type {number} */ y) {
    const m = this.matrix();
    const { cloth } = this.scene;
    const near = [];
    for (let n = 0; n < cloth.count; n++) {
      if (cloth.first[n] > this.step) continue;
      const at = this.toScreen(cloth.xyz.subarray(3 * n, 3 * n + 3), m);
      const away = Math.hypot(at.x - x, at.y - y);
      if (away <= REACH_PX && at.depth > 0) near.push({ n, away, depth: at.depth });
    }
    const front = Math.min(...near.map((p) => p.depth));
    const seen = near.filter((p) => p.depth <= front + LAYER_M);
    return seen.reduce((best, p) => (p.away < best.away ? p : best), { n: -1, away: Infinity }).n;
  }

  // --- drawing -------------------------------------------------------------------------------

  resize() {
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    this.canvas.width = Math.max(1, Math.round(this.width * devicePixelRatio));
    this.canvas.height = Math.max(1, Math.round(this.height * devicePixelRatio));
    this.draw();
  }

  redraw() {
    if (this.dirty) return;
    this.dirty = true;
    requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.dirty = false;
    if (!this.width || !this.height) return;
    const style = getComputedStyle(this.canvas);
    this.points?.draw(this, rgbOf(style.getPropertyValue("--ground")));
    this.drawMarks(style);
  }

  drawMarks(/** @type {Style} */ style) {
    const pen = sized(this.marksCanvas, this.width, this.height);
    const m = this.matrix();
    /** @type {(segments: [XYZ, XYZ][], color: string, width: number) => void} */
    const line = (segments, color, width) => {
      pen.strokeStyle = color;
      pen.lineWidth = width;
      pen.lineCap = "round";
      pen.beginPath();
      for (const [a, b] of segments) {
        const [from, to] = [this.toScreen(a, m), this.toScreen(b, m)];
        if (from.depth < 0.02 || to.depth < 0.02) continue;
        pen.moveTo(from.x, from.y);
        pen.lineTo(to.x, to.y);
      }
      pen.stroke();
    };
    pen.globalAlpha = 0.45;
    line(this.scene.axisLine, style.getPropertyValue("--soft"), 1);
    pen.globalAlpha = 1;
    if (!this.mark) return;
    const pick = style.getPropertyValue("--pick");
    if (this.mark.gripper)
      for (const rim of [true, false]) line(this.mark.gripper, rim ? "#fff" : pick, rim ? 5 : 2.5);
    drawDot(pen, this.toScreen(this.mark.point, m), pick, 5.75);
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

/** The points of a scene on the graphics card. */
class Points {
  /** @param {WebGL2RenderingContext} gl @param {CloudScene} scene */
  constructor(gl, scene, /** @type {Uint8Array} */ colors = new Uint8Array(3 * scene.cloth.count)) {
    this.gl = gl;
    this.scene = scene;
    this.colors = colors;
    this.program = gl.createProgram();
    for (const kind of [gl.VERTEX_SHADER, gl.FRAGMENT_SHADER]) {
      const shader = /** @type {WebGLShader} */ (gl.createShader(kind));
      gl.shaderSource(shader, kind === gl.VERTEX_SHADER ? POINTS.vertex : POINTS.fragment);
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    this.cloth = this.cloud(scene.cloth.xyz, colors, scene.cloth.first);
    this.around = scene.around.map(({ xyz, rgb }) => this.cloud(xyz, rgb, null));
    gl.enable(gl.DEPTH_TEST);
  }

  /** @param {Float32Array} xyz @param {Uint8Array} rgb @param {Float32Array | null} first */
  cloud(xyz, rgb, first) {
    const { gl, program } = this;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    /** @param {string} name @param {Float32Array | Uint8Array} data @param {number} size */
    const attribute = (name, data, size) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      const place = gl.getAttribLocation(program, name);
      const bytes = data instanceof Uint8Array;
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, bytes ? gl.UNSIGNED_BYTE : gl.FLOAT, bytes, 0, 0);
      return buffer;
    };
    attribute("place", xyz, 3);
    const color = attribute("color", rgb, 3);
    if (first) attribute("first", first, 1);
    else gl.vertexAttrib1f(gl.getAttribLocation(program, "first"), -1);
    gl.bindVertexArray(null);
    return { array, color, count: xyz.length / 3 };
  }

  /** Color the cloth, three bytes a pixel. */
  color(/** @type {Uint8Array} */ rgb) {
    this.colors = rgb;
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, this.cloth.color);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, rgb, this.gl.DYNAMIC_DRAW);
  }

  draw(/** @type {CloudView} */ view, /** @type {XYZ} */ ground) {
    const { gl, program, scene } = this;
    const { width, height } = view.canvas;
    const at = (/** @type {string} */ name) => gl.getUniformLocation(program, name);
    gl.viewport(0, 0, width, height);
    gl.clearColor(...ground, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(program);
    gl.uniformMatrix4fv(at("clip_from_held"), false, view.matrix());
    const pixelsPerMetre = Math.min(width, height) / (2 * view.extent);
    gl.uniform1f(at("step"), view.step);
    /**
     * @param {Points["cloth"]} cloud @param {number} size @param {number} tint @param {number} lift
     * @param {number[]} wash
     */
    const paint = (cloud, size, tint, lift, wash) => {
      gl.uniform1f(at("size"), size * pixelsPerMetre);
      gl.uniform1f(at("tint"), tint);
      gl.uniform1f(at("lift"), lift);
      gl.uniform4fv(at("wash"), wash);
      gl.bindVertexArray(cloud.array);
      gl.drawArrays(gl.POINTS, 0, cloud.count);
    };
    paint(this.cloth, scene.cloth.grid.pixel_size_m * 1.5, view.tint, 0, [0, 0, 0, 0]);
    // What else was seen lies a little behind, so that it does not show through the cloth.
    if (view.showAround) paint(this.around[view.step], 1.6 * scene.spacing, 0, 0.007, [0.62, 0.64, 0.67, 0.7]);
    gl.bindVertexArray(null);
  }
}

/** @returns {XYZ} */
function rgbOf(/** @type {string} */ hex) {
  const value = parseInt(hex.trim().slice(1), 16);
  return [(value >> 16) / 255, ((value >> 8) & 255) / 255, (value & 255) / 255];
}
