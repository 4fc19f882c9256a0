// The exported page: steps through the growth of a shape, in 3D and flattened, with its picks. It has no server.

import { FlatCanvas } from "../canvas/canvas.js";
import { drawPieces } from "../canvas/pieces.js";
import {
  buttonOf,
  byId,
  contextOf,
  findAll,
  isPlain,
  make,
  setCurrent,
  setPressed,
  setText,
  showWords,
  targetOf,
  within,
} from "../page/dom.js";
import { cm2, count, floatingOf, keyName, number, tipOf } from "../page/format.js";
import { keyOf } from "../page/keys.js";
import { startTips } from "../page/notices.js";
import { applyTheme, onTheme } from "../page/theme.js";
import { actionTable } from "./actions.js";
import { CloudView } from "./cloud.js";
import { showDecisions, showPick, showPicks, showValues } from "./details.js";
import { turned } from "../both/seen.js";
import { drawGarment } from "../garment/marks.js";
import { showGarment } from "./garment.js";
import { unpack } from "./data.js";
import { showLegend } from "../panels/readout.js";

const canvasOf = (/** @type {string} */ id) => /** @type {HTMLCanvasElement} */ (byId(id));
const PLAY_MS = 1300;
const NEW = [255, 140, 0];

export class Page {
  constructor(/** @type {OfflineData} */ { history, layers, cloth, other, around }) {
    this.history = history;
    /** @type {Record<SideName, OfflineData["other"]>} */
    this.sides = { this: { layers, cloth }, other };
    this.layers = layers;
    this.cloth = cloth;
    this.last = history.steps.length - 1;
    this.step = this.last;
    this.layer = history.layers[0].name;
    this.tint = false; // whether the pixels that a step added are marked
    this.current = /** @type {OfflinePick | null} */ (null);
    this.flat = new FlatCanvas({
      pick: (u, v) => this.pickAt(u, v),
      hover: (u, v) => showValues(this, u, v),
      nudge: () => {},
      mayDrag: () => false,
    });
    // They lie beside the shape as they do in the end.
    this.flat.drawers.push((context, style) =>
      drawPieces(this.flat, context, style, this.step === this.last ? floatingOf(this.shownSide).pieces : [], null),
    );
    this.pointed = /** @type {string | null} */ (null); // the named point of the garment that is pointed at
    this.timer = /** @type {number | null} */ (null);
    this.flat.drawers.push((context, style) => {
      const { found } = this.garment;
      if (this.step === this.last && found?.kind) drawGarment(this.flat, context, style, found, this.pointed);
    });
    const { low, high } = history.extent;
    const scene = {
      cloth,
      around,
      axis: history.axis,
      axisLine: [history.axis.line],
      cameras: history.steps.map((s) => s.camera_m),
      center: low.map((x, i) => (x + high[i]) / 2),
      halfExtents: history.half_extents_m,
      spacing: history.around_spacing_m,
      start: this.step,
    };
    this.cloud = new CloudView(canvasOf("cloud"), scene, (n) => {
      if (n < 0) return;
      this.turn("this"); // the points of the scene are those of this side
      this.pick(n, 0);
    });
    this.actions = actionTable(this);
    this.fixed();
    this.show();
    // Upright, as the operator page shows a finished garment.
    const turn = history.garment.found?.kind ? history.garment.found.upright_rad : 0;
    if (turn) this.flat.turnTo((turn + 2 * Math.PI) % (2 * Math.PI));
  }

  button(/** @type {string} */ name) {
    const action = /** @type {OfflineAction} */ (this.actions.find((a) => a.name === name));
    const { label, keys, title, run } = action;
    return make(
      "button.button",
      { label, key: name, data: { action: name }, tip: tipOf(action), click: run },
      title,
      make("kbd", keyName(keys[0])),
    );
  }

  /** What does not change. */
  fixed() {
    const { recording, method, layers, steps } = this.history;
    setText(
      byId("recording"),
      `${recording.name} · ${count(recording.angles_deg.length, "view")} · method ${method}`,
    );
    if (recording.description) byId("recording").dataset.tip = recording.description;
    const tools = {
      "page-actions": ["tint", ...(this.history.other ? ["turn_over"] : []), "theme", "help"],
      layers: layers.map(({ name }) => `layer_${name}`),
      "zoom-tools": ["zoom_out", "zoom_in", "fit"],
      "cloud-tools": ["reset"],
      "play-tools": ["back", "play", "forward"],
    };
    for (const [id, names] of Object.entries(tools)) byId(id).append(...names.map((name) => this.button(name)));
    buttonOf("play").classList.add("play");
    byId("timeline").append(...steps.map((step) => this.cell(step)));
  }

  cell(/** @type {OfflineStep} */ { order, view_index, angle_deg, added_cm2, told }) {
    const angle = `${number(angle_deg, 0)}°`;
    const show = () => {
      this.pause();
      this.goTo(order, true);
    };
    return make(
      "button.view",
      {
        label: `Step ${order + 1}: view ${view_index}, ${angle}, adds ${cm2(added_cm2)}`,
        data: { step: order },
        tip: `View ${view_index} at ${angle}\n${told}`,
        click: show,
      },
      make("span.sign", { "aria-hidden": "true" }, String(view_index)),
      make("span.angle", angle),
    );
  }

  // --- the other side -------------------------------------------------------------------------

  /** The side that is shown. */
  get shownSide() {
    return this.flat.side === "other" && this.history.other ? this.history.other : this.history;
  }

  /** The garment as it is seen on the shown side. */
  get garment() {
    const { garment, other } = this.history;
    if (this.flat.side === "this" || !other) return garment;
    return { ...garment, found: other.is_related ? turned(garment.found) : null };
  }

  turnOver() {
    if (this.history.other) this.turn(this.flat.side === "this" ? "other" : "this");
    else setText(byId("hint"), "This session has one side: its other side was not computed.");
  }

  turn(/** @type {SideName} */ side) {
    const shown = this.sides[side];
    if (!shown || side === this.flat.side) return;
    this.flat.side = side;
    this.cloth = shown.cloth;
    this.layers = shown.layers;
    this.flat.boxes.clear();
    this.flat.extent = null;
    const { angle } = this.flat.transform;
    this.flat.fitted = true;
    this.flat.turnTo((2 * Math.PI - angle) % (2 * Math.PI)); // what was up stays up
    this.show();
  }

  // --- what is shown -------------------------------------------------------------------------

  show() {
    const step = this.history.steps[this.step];
    this.paint();
    for (const button of findAll("button", byId("timeline"))) {
      const order = Number(button.dataset.step);
      button.classList.toggle("done", order <= this.step);
      setCurrent(button, order === this.step);
    }
    /** @type {Record<string, boolean>} */
    const pressed = { play: Boolean(this.timer), tint: this.tint, turn_over: this.flat.side === "other" };
    for (const { name } of this.history.layers) pressed[`layer_${name}`] = name === this.layer;
    for (const [name, on] of Object.entries(pressed)) setPressed(buttonOf(name), on);
    buttonOf("play").childNodes[0].textContent = this.timer ? "Pause" : "Play";
    const { other } = this.history;
    const floating = step.floating_cm2 ? `, and ${cm2(step.floating_cm2)} float.` : ".";
    const end = this.step === this.last && this.history.finished ? ` ${this.history.finished}` : "";
    setText(
      byId("hint"),
      `Step ${this.step + 1} of ${this.last + 1}: view ${step.view_index} at ${number(step.angle_deg, 0)}°,` +
        ` ${step.told}. It adds ${cm2(step.added_cm2)}; the shape has ${cm2(step.area_cm2)}${floating}${end}`,
    );
    if (this.flat.side === "other" && other)
      setText(byId("hint"), `The other side, as seen from its own outside: ${cm2(other.area_cm2)}.`);
    showLegend(this.layers[this.layer].legend);
    showPicks(this);
    showDecisions(this);
    showGarment(this);
    showPick(this);
  }

  /** Paint the flattened shape after the step, and color the cloth in 3D alike. */
  paint() {
    const { grid, at, first, count: n } = this.cloth;
    const layer = this.layers[this.layer];
    const image = new ImageData(grid.cols, grid.rows);
    const colors = new Uint8Array(3 * n);
    for (let k = 0; k < n; k++) {
      const from = 4 * at[k];
      for (let c = 0; c < 3; c++) colors[3 * k + c] = layer.pixels[from + c];
      if (first[k] > this.step) continue;
      const mark = this.tint && first[k] === this.step ? 0.5 : 0;
      for (let c = 0; c < 3; c++) image.data[from + c] = (1 - mark) * layer.pixels[from + c] + mark * NEW[c];
      image.data[from + 3] = 255;
    }
    const canvas = new OffscreenCanvas(grid.cols, grid.rows);
    contextOf(canvas).putImageData(image, 0, 0);
    this.flat.showFrame({ revision: this.step + 1, grid, box: this.cloth.box, image: canvas }, 0);
    this.cloud.tint = this.tint ? 0.5 : 0;
    if (this.flat.side === "this") this.cloud.setColors(colors);
    this.marks();
  }

  marks() {
    const pick = this.current;
    this.flat.pick = pick?.uv_m && this.isShown(pick) ? { uv_m: pick.uv_m, grip: pick.grip } : null;
    this.flat.showMarks(this.history.picks.filter((p) => this.isShown(p)));
    this.cloud.mark = pick && { point: pick.position_held_m, gripper: pick.grip?.gripper_m ?? null };
    this.cloud.redraw();
  }

  /** @param {OfflinePick} pick */
  isShown = (pick) =>
    pick.uv_m !== null && pick.side === this.flat.side && this.cloth.pixelAt(...pick.uv_m, this.step) >= 0;

  // --- steps ---------------------------------------------------------------------------------

  goTo(/** @type {number} */ step, /** @type {boolean} */ tint) {
    this.step = step;
    this.tint = tint && step >= 0;
    this.cloud.setStep(step);
    this.show();
  }

  stepBy(/** @type {number} */ by) {
    this.pause();
    const step = within(this.step + by, 0, this.last);
    if (step !== this.step) this.goTo(step, true);
  }

  togglePlay() {
    if (this.timer) {
      this.pause();
      return this.show();
    }
    this.timer = setInterval(() => {
      if (this.step < this.last) return this.goTo(this.step + 1, true);
      this.pause();
      this.goTo(this.last, false);
    }, PLAY_MS);
    this.goTo(this.step === this.last ? 0 : this.step, true);
  }

  pause() {
    clearInterval(this.timer ?? 0);
    this.timer = null;
  }

  setLayer(/** @type {string} */ name) {
    this.layer = name;
    this.show();
  }

  setTint(/** @type {boolean} */ on) {
    this.tint = on;
    this.show();
  }

  // --- picks ---------------------------------------------------------------------------------

  pickAt(/** @type {number} */ u, /** @type {number} */ v) {
    const { n, miss } = this.cloth.nearest(u, v, this.step);
    if (n >= 0) this.pick(n, miss);
  }

  /** Look at a pixel of the cloth: shown on both sides, but kept nowhere. */
  pick(/** @type {number} */ n, /** @type {number} */ miss) {
    const { rc, uv } = this.cloth.place(n);
    this.setCurrent({
      id: null,
      name: "Here",
      side: this.flat.side,
      rc,
      uv_m: uv,
      miss_m: miss,
      position_held_m: this.cloth.point(n),
      normal_held: this.cloth.normal(n),
      z_angle_deg: this.cloth.zAngle(n),
      view_index: this.cloth.view(n),
      source_rc: [this.cloth.sourceRc[2 * n], this.cloth.sourceRc[2 * n + 1]],
      grip: null,
    });
  }

  setCurrent(/** @type {OfflinePick} */ pick) {
    this.current = pick;
    this.turn(pick.side);
    this.marks();
    showPick(this);
    showPicks(this);
  }

  key(/** @type {KeyboardEvent} */ event) {
    if (!isPlain(event) || document.querySelector("dialog[open]")) return;
    const key = keyOf(event);
    const action = this.actions.find((a) => a.keys.includes(key));
    // Space presses the button that has the focus.
    if (!action || (key === "Space" && targetOf(event).closest?.("button"))) return;
    event.preventDefault();
    action.run();
  }
}

let page = /** @type {Page | null} */ (null);

onTheme(() => {
  page?.flat.redraw();
  page?.cloud.redraw();
});
applyTheme();
startTips();
try {
  const made = (page = new Page(await unpack(byId("history").textContent ?? "", byId("arrays").textContent ?? "")));
  document.addEventListener("keydown", (event) => made.key(event));
  applyTheme();
  showValues(made, null, 0);
  Object.assign(window, { flatcloth: page });
} catch (error) {
  showWords(
    byId("broken"),
    `This page cannot be shown here: ${/** @type {Error} */ (error).message}. Open it with a browser of 2023 or newer.`,
  );
  throw error;
}
