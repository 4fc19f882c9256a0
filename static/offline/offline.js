// The exported page: steps through the growth of a shape, in 3D and flattened, with its picks. It has no server: its
// actions are done here, and their table gives buttons, keys and the sheet of commands, as on the operator page.

import { turned } from "../both/seen.js";
import { FlatCanvas } from "../canvas/canvas.js";
import { drawPieces } from "../canvas/pieces.js";
import { drawGarment } from "../garment/marks.js";
import { GESTURES, showCommands } from "../page/commands.js";
import { buttonOf, byId, contextOf, findAll, make, setCurrent, setPressed, setText } from "../page/dom.js";
import { showWords, within } from "../page/dom.js";
import { cm2, count, floatingOf, number } from "../page/format.js";
import { startKeys } from "../page/keys.js";
import { startTips } from "../page/notices.js";
import { Page } from "../page/page.js";
import { applyTheme, onTheme, toggleTheme } from "../page/theme.js";
import { showLegend } from "../panels/readout.js";
import { CloudView } from "./cloud.js";
import { unpack } from "./data.js";
import { copyPick, showDecisions, showPick, showPicks, showValues } from "./details.js";
import { showGarment } from "./garment.js";

const PLAY_MS = 1300;
const NEW = [255, 140, 0];
/** Name, group, keys, title, what it does. */
const ACTIONS = `
play | growth | Space | Play | Play the growth from the start view, or pause.
back | growth | , ArrowLeft | Back | Show the step before.
forward | growth | . ArrowRight | Forward | Show the next step.
first | growth | Home | Start | Show the start view alone.
last | growth | End | Whole | Show the whole shape.
tint | growth | n | New | Mark what the step has added.
turn_over | view | m | Turn over | Show the other side of the garment; again: back.
fit | view | f | Fit | Fit the flattened shape into its pane.
zoom_in | view | + = | Zoom in | Zoom in.
zoom_out | view | - | Zoom out | Zoom out.
reset | view | r | Camera | Look in 3D from where the camera stood, and follow it.
copy | page | c | Copy | Copy the numbers of the current pick.
theme | page | t | Theme | Switch between light and dark.
help | page | ? | Commands | Show all commands with their keys; find one by a few letters.
`;

export class OfflinePage extends Page {
  constructor(/** @type {OfflineData} */ { history, layers, cloth, other, around }) {
    super({
      send: () => false,
      notify: (_, text) => setText(byId("hint"), text),
      run: (name) => this.does[name](),
      show: () => this.show(),
      decide: () => {},
      pick: (u, v) => this.pickAt(u, v),
      move: () => {},
    });
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
    this.pointed = /** @type {string | null} */ (null); // the named point of the garment that is pointed at
    this.timer = /** @type {number | null} */ (null);
    /** @type {FlatCanvas} */
    this.canvas = new FlatCanvas(this);
    this.add({
      hover: (/** @type {Place | null} */ at) => showValues(this, at),
      drawOver: () => {
        if (this.step < this.last) return; // pieces and garment lie as they do in the end
        drawPieces(this.canvas, floatingOf(this.shownSide).pieces, null);
        const { found } = this.garment;
        if (found?.kind) drawGarment(this.canvas, found, this.pointed);
      },
    });
    const { low, high } = history.extent;
    const scene = {
      cloth,
      around,
      axis: history.axis,
      cameras: history.steps.map((s) => s.camera_m),
      center: low.map((x, i) => (x + high[i]) / 2),
      halfExtents: history.half_extents_m,
      spacing: history.around_spacing_m,
      start: this.step,
    };
    this.cloud = new CloudView(/** @type {HTMLCanvasElement} */ (byId("cloud")), scene, (n) => {
      if (n < 0) return;
      this.turn("this"); // the points of the scene are those of this side
      this.pick(n, 0);
    });
    const layerActions = history.layers.map(({ name, title, about }, i) =>
      [`layer_${name}`, "layer", i + 1, title, `Show ${about}.`].join(" | "),
    );
    const actions = [...ACTIONS.trim().split("\n"), ...layerActions].map((row) => {
      const [name, group, keys, title, description] = row.split(" | ");
      return { name, group, mode: "", keys: keys.split(" "), title, description, why_not: null };
    });
    this.state = /** @type {State} */ (/** @type {unknown} */ ({ actions }));
    this.fixed();
    this.show();
    // Upright, as the operator page shows a finished garment.
    const turn = history.garment.found?.kind ? history.garment.found.upright_rad : 0;
    if (turn) this.canvas.turnTo((turn + 2 * Math.PI) % (2 * Math.PI));
  }

  /** @type {Record<string, () => unknown>} what each action does */
  get does() {
    const layers = this.history.layers.map(({ name }) => [`layer_${name}`, () => this.look({ layer: name })]);
    return {
      play: () => this.togglePlay(),
      back: () => this.stepBy(-1),
      forward: () => this.stepBy(1),
      first: () => this.goTo(0, true),
      last: () => this.goTo(this.last, false),
      tint: () => this.look({ tint: !this.tint }),
      turn_over: () => this.turnOver(),
      fit: () => this.canvas.fit(),
      zoom_in: () => this.canvas.zoomBy(1.4),
      zoom_out: () => this.canvas.zoomBy(1 / 1.4),
      reset: () => this.cloud.lookAgain(),
      copy: () => copyPick(this),
      theme: toggleTheme,
      help: () => showCommands([...this.state.actions, ...GESTURES], this.run),
      ...Object.fromEntries(layers),
    };
  }

  /** What does not change. */
  fixed() {
    const { recording, method, layers, steps, other } = this.history;
    const views = count(recording.angles_deg.length, "view");
    setText(byId("recording"), `${recording.name} · ${views} · method ${method}`);
    if (recording.description) byId("recording").dataset.tip = recording.description;
    byId("layers").dataset.actions = layers.map(({ name }) => `layer_${name}`).join(" ");
    for (const box of findAll("[data-actions]"))
      box.append(...(box.dataset.actions ?? "").split(" ").map((name) => this.button(name)));
    buttonOf("turn_over").hidden = !other;
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
    return this.canvas.side === "other" && this.history.other ? this.history.other : this.history;
  }

  /** The garment as it is seen on the shown side. */
  get garment() {
    const { garment, other } = this.history;
    if (this.canvas.side === "this" || !other) return garment;
    return { ...garment, found: other.is_related ? turned(garment.found) : null };
  }

  turnOver() {
    if (this.history.other) this.turn(this.canvas.side === "this" ? "other" : "this");
    else this.notify("info", "This session has one side: its other side was not computed.");
  }

  turn(/** @type {SideName} */ side) {
    const shown = this.sides[side];
    if (!shown || side === this.canvas.side) return;
    this.canvas.side = side;
    this.cloth = shown.cloth;
    this.layers = shown.layers;
    this.canvas.extent = null;
    const { angle } = this.canvas.transform;
    this.canvas.fitted = true;
    this.canvas.turnTo((2 * Math.PI - angle) % (2 * Math.PI)); // what was up stays up
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
    const pressed = { play: Boolean(this.timer), tint: this.tint, turn_over: this.canvas.side === "other" };
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
    if (this.canvas.side === "other" && other)
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
    this.canvas.showFrame({ revision: this.step + 1, grid, box: this.cloth.box, image: canvas });
    this.cloud.tint = this.tint ? 0.5 : 0;
    if (this.canvas.side === "this") this.cloud.colors = colors;
    this.marks();
  }

  marks() {
    const pick = this.current;
    this.canvas.pick = pick?.uv_m && this.isShown(pick) ? { uv_m: pick.uv_m, grip: pick.grip } : null;
    this.canvas.showMarks(this.history.picks.filter((p) => this.isShown(p)));
    this.cloud.mark = pick && { point: pick.position_held_m, gripper: pick.grip?.gripper_m ?? null };
    this.cloud.redraw();
  }

  /** @param {OfflinePick} pick */
  isShown = (pick) =>
    pick.uv_m !== null && pick.side === this.canvas.side && this.cloth.pixelAt(...pick.uv_m, this.step) >= 0;

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

  /** Show another layer, or what is new; or not. @param {{ layer?: string; tint?: boolean }} look */
  look(look) {
    Object.assign(this, look);
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
      side: this.canvas.side,
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
}

let page = /** @type {OfflinePage | null} */ (null);

onTheme(() => {
  page?.canvas.redraw();
  page?.cloud.redraw();
});
applyTheme();
startTips();
try {
  const made = (page = new OfflinePage(
    await unpack(byId("history").textContent ?? "", byId("arrays").textContent ?? ""),
  ));
  startKeys({ state: () => made.state, modes: () => [], mayMove: () => false, run: made.run });
  applyTheme();
  showValues(made, null);
  Object.assign(window, { flatcloth: page });
} catch (error) {
  showWords(
    byId("broken"),
    `This page cannot be shown here: ${/** @type {Error} */ (error).message}. Open it with a browser of 2023 or newer.`,
  );
  throw error;
}
