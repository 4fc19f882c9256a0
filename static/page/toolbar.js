// The buttons: made from the server's table of actions, so that names, keys and reasons are one.

import { buttonOf, byId, findAll, make, rebuild, setAllowed, setPressed } from "./dom.js";
import { tipOf } from "./format.js";
import { stepOf } from "../active/panel.js";
import { LAYERS, layerAction } from "../canvas/look.js";
import { PagePart } from "./page.js";

const CAMERA = ["capture_pause"];
const SESSION = ["step", "accept", "reject", "skip", "|", "undo", "redo", "|", "auto"];
/** @type {Record<string, string>} */
const MORE = { reject: "reject_menu" };
const PAGE = ["home", "teach", "export", "settings", "help"];
/** @type {Record<string, string>} */
const SIGNS = { zoom_out: "−", zoom_in: "+" };

export class Toolbar extends PagePart {
  update(/** @type {State} */ state) {
    const camera = state.mode === "camera";
    this.build("actions", camera ? CAMERA : SESSION);
    byId("actions").setAttribute("aria-label", camera ? "Camera" : "Session");
    this.build("page-actions", PAGE);
    this.buildLayers(camera);
    this.buildOverlay();
    this.build("zoom-tools", ["zoom_out", "zoom_in", "fit"]);
    for (const action of state.actions)
      for (const button of findAll(`[data-action="${action.name}"]`))
        setAllowed(button, action.why_not, tipOf(action));
    for (const { pressed } of this.page.panels)
      for (const [name, on] of Object.entries(pressed ?? {})) setPressed(buttonOf(name), on);
    byId("canvas").classList.toggle("measuring", this.page.ruler.on);
    if (state.capture) setTitle("capture_pause", state.capture.playing ? "Pause" : "Go on");
    else this.updateSession(state);
    for (const layer of LAYERS)
      for (const button of findAll(`[data-action="${layerAction(layer)}"]`))
        setPressed(button, this.page.layer === layer);
  }

  updateSession(/** @type {State} */ state) {
    setPressed(buttonOf("auto"), state.auto.running);
    setTitle("auto", state.auto.running ? "Stop Auto" : "Auto");
    setTitle("step", stepOf(state.active));
    const asks = state.active ? state.active.angle_deg !== null : state.phase === "ready";
    const main = state.pending ? "accept" : asks ? "step" : "";
    for (const name of ["step", "accept"]) {
      buttonOf(name).classList.toggle("primary", name === main && !state.auto.running);
    }
  }

  build(/** @type {string} */ container, /** @type {string[]} */ names) {
    rebuild(byId(container), [names], () =>
      names.map((name) => {
        if (name === "|") return make("span.gap", { "aria-hidden": "true" });
        const button = this.page.button(name, SIGNS[name]);
        const more = MORE[name];
        return more ? make("span.joined", button, this.more(more)) : button;
      }),
    );
  }

  /** The small button beside another that opens a menu. */
  more(/** @type {string} */ name) {
    const button = this.page.button(name, "▾");
    button.classList.add("more");
    if (name === "reject_menu") button.setAttribute("aria-haspopup", "dialog");
    return button;
  }

  buildLayers(/** @type {boolean} */ camera) {
    // Look has all layers; frames of a camera have one.
    const first = camera ? [] : ["color", "z_angle", "source", "place", this.page.layer];
    this.build("layers", [...new Set(first)].map(layerAction));
    this.build("look-tools", camera ? ["look"] : ["look", "turn_over"]);
  }

  buildOverlay() {
    const { page } = this;
    rebuild(byId("overlay-tools"), ["overlay"], () => [
      page.button("diagnostics"),
      make("details#compare", make("summary", "Compare"), page.comparison.buttons()),
    ]);
  }
}

/** Give the button of an action another title. @param {string} action @param {string} title */
function setTitle(action, title) {
  const text = buttonOf(action).firstChild;
  if (text) text.textContent = title;
}
