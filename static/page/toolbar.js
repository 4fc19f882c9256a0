// The buttons: made from the server's table of actions, so that names, keys and reasons are one.

import { buttonOf, byId, findAll, make, rebuild, setAllowed, setPressed, setTitle } from "./dom.js";
import { tipOf } from "./format.js";
import { stepOf } from "../active/panel.js";
import { LAYERS, layerAction } from "../canvas/look.js";
import { PagePart } from "./page.js";

const SESSION = "step accept reject skip | undo redo | auto";
/** @type {Record<string, string>} */
const MORE = { reject: "reject_menu" };

export class Toolbar extends PagePart {
  update(/** @type {State} */ state) {
    const camera = state.mode === "camera";
    byId("actions").dataset.actions = camera ? "capture_pause" : SESSION;
    byId("actions").setAttribute("aria-label", camera ? "Camera" : "Session");
    // Look has all layers; frames of a camera have one.
    const layers = camera ? [] : ["color", "z_angle", "source", "place", this.page.layer];
    byId("layers").dataset.actions = [...new Set(layers)].map(layerAction).join(" ");
    byId("look-tools").dataset.actions = camera ? "look" : "look turn_over";
    for (const box of findAll("[data-actions]")) this.build(box);
    for (const action of state.actions)
      for (const button of findAll(`[data-action="${action.name}"]`))
        setAllowed(button, action.why_not, tipOf(action));
    for (const { pressed } of this.page.panels)
      for (const [name, on] of Object.entries(pressed ?? {})) setPressed(buttonOf(name), on);
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

  /** The buttons of a container, which names their actions. */
  build(/** @type {HTMLElement} */ container) {
    const { actions = "" } = container.dataset;
    rebuild(container, actions, () =>
      actions.split(" ").map((name) => {
        if (!name) return null;
        if (name === "|") return make("span.gap", { "aria-hidden": "true" });
        const button = this.page.button(name);
        button.classList.toggle("small", container.matches(".group.small"));
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
}
