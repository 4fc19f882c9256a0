// Looking: the layer, the flattened view turned; what the 3D scene shows. The data stay as they are.

import { PagePart } from "../page/page.js";
import { onPinch } from "./pinch.js";
import { byId, find, make, rebuild, setText, tickBox } from "../page/dom.js";
import { number } from "../page/format.js";

const STEP_DEG = 15;
const TOOLS = ["turn_left_seen", "turn_right_seen", "ruler"];
/** All layers; the table of actions has their titles, keys and descriptions. */
export const LAYERS = ["color", "height", "z_angle", "source", "stretch", "incidence", "density", "place", "truth"];

const SWITCHES = /** @type {const} */ ([
  "show_view",
  "show_shape",
  "show_new",
  "show_all",
  "show_axis",
  "show_camera",
  "follow",
]);
const OF_A_CAMERA = ["show_view", "follow"];

/** The action that chooses a layer. */
export const layerAction = (/** @type {string} */ layer) => `layer_${layer}`;

export class Looking extends PagePart {
  actions = {
    look: () => this.toggle(),
    turn_left_seen: () => this.turnBy(-1),
    turn_right_seen: () => this.turnBy(1),
    ...Object.fromEntries(LAYERS.map((layer) => [layerAction(layer), () => this.color(layer)])),
  };
  open = false;
  colored = "color"; // the layer that the 3D scene last got
  chip = byId("turned");

  constructor(/** @type {Page} */ page) {
    super(page);
    this.chip.addEventListener("click", () => this.turn(0));
    onPinch(
      this.canvas.canvas,
      () => this.canvas.cancel(),
      (factor, from, to) => this.pinch(factor, from, to),
    );
  }

  /** @param {number} factor @param {Point} from @param {Point} to */
  pinch(factor, from, to) {
    const { canvas } = this;
    const at = canvas.canvas.getBoundingClientRect();
    canvas.fitted = false;
    canvas.transform.pan(to.x - from.x, to.y - from.y);
    canvas.transform.zoom(factor, to.x - at.left, to.y - at.top);
    canvas.redraw();
  }

  // --- turn ------------------------------------------------------------------------------------

  turnBy(/** @type {number} */ steps) {
    const degrees = Math.round((this.canvas.transform.angle * 180) / Math.PI) + STEP_DEG * steps;
    this.turn((((degrees % 360) + 360) % 360) * (Math.PI / 180));
  }

  turn(/** @type {number} */ angle) {
    this.canvas.turnTo(angle);
    const degrees = Math.round((angle * 180) / Math.PI) % 360;
    this.chip.hidden = degrees === 0;
    const text = `turned ${number(degrees > 180 ? degrees - 360 : degrees, 0)}°`;
    setText(this.chip, text);
    this.chip.setAttribute("aria-label", `${text}: undo the turn`);
  }

  /** Show another layer. */
  color(/** @type {string} */ layer) {
    this.page.layer = layer;
    this.page.changed();
  }

  /** The 3D scene is one for all tabs, so each tells only what its operator has changed. */
  update(/** @type {State} */ state) {
    this.show(state);
    const layer = /** @type {import("../page/messages").Look["layer"]} */ (this.page.layer);
    if (state.mode !== "session" || this.colored === layer) return;
    this.colored = layer;
    this.page.send({ type: "look", layer });
  }

  get pressed() {
    return { look: this.open };
  }

  // --- the panel -------------------------------------------------------------------------------

  toggle() {
    this.open = !this.open;
    this.page.changed();
    if (this.open) find("button", byId("look"))?.focus();
  }

  /** Show the panel; without a kit no error is known, and a frame of a camera has one layer. */
  show(/** @type {State} */ { settings, settings_rows, capture, layers: shown }) {
    const panel = byId("look");
    panel.hidden = !this.open;
    if (!this.open) return;
    const hasKit = shown?.legends.truth.kind === "ramp";
    const layers = capture ? [] : LAYERS.filter((one) => hasKit || one !== "truth");
    const switches = SWITCHES.filter((name) => !capture || OF_A_CAMERA.includes(name));
    rebuild(panel, [layers, switches.map((name) => settings[name])], () => [
      layers.length > 0 && make("h2", "Layers"),
      make("div.looks", ...layers.map((one) => this.page.button(layerAction(one)))),
      make("div.looks", ...TOOLS.map((name) => this.page.button(name))),
      make("h2", "3D scene"),
      make(
        "ul.scene-switches",
        ...switches.map((name) => {
          const row = settings_rows.find((one) => one.name === name);
          const set = (/** @type {boolean} */ on) => this.page.send({ type: "set", values: { [name]: on } });
          const box = tickBox(settings[name], set, { key: name });
          return make("li", make("label", { tip: row?.description }, box, row?.title));
        }),
      ),
    ]);
  }
}
