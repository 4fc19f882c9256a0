// The buttons: made from the server's table of actions, so that names, keys and reasons are one.

import { buttonOf, byId, find, findAll, make, rebuild, setAllowed, setPressed, staysIn, taken } from "./dom.js";
import { tipOf, keyName } from "./format.js";
import { stepOf } from "../active/panel.js";
import { LAYERS, layerAction } from "../canvas/look.js";
import { PagePart } from "./page.js";
import { actionSection, keySection, showKeys } from "./keys.js";

const CAMERA = ["capture_pause"];
const SESSION = ["step", "accept", "reject", "skip", "|", "undo", "redo", "|", "auto"];
/** @type {Record<string, string>} */
const MORE = { reject: "reject_menu" };
const PAGE = ["home", "teach", "export", "settings", "palette", "help"];
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
    if (name === "reject_menu") button.setAttribute("aria-haspopup", "menu");
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

/** The reasons to reject, as a menu under its button. */
export class RejectMenu {
  constructor(/** @type {(reason: string) => void} */ choose) {
    this.choose = choose;
    this.menu = byId("reject-menu");
    this.menu.addEventListener("keydown", (event) => this.key(event));
    this.menu.addEventListener("focusout", (event) => {
      if (!staysIn(this.menu, event)) this.close();
    });
  }

  open(/** @type {string[]} */ reasons) {
    const at = buttonOf("reject").getBoundingClientRect();
    this.menu.replaceChildren(
      ...reasons.map((reason, i) =>
        make("button", { role: "menuitem", click: () => this.take(reason) }, reason, make("kbd", String(i + 1))),
      ),
    );
    this.menu.style.left = `${at.left}px`;
    this.menu.style.top = `${at.bottom + 4}px`;
    this.menu.hidden = false;
    find("button", this.menu).focus();
  }

  take(/** @type {string} */ reason) {
    this.close();
    this.choose(reason);
  }

  close() {
    this.menu.hidden = true;
  }

  key(/** @type {KeyboardEvent} */ event) {
    const items = findAll("button", this.menu);
    const at = items.indexOf(/** @type {HTMLElement} */ (document.activeElement));
    const digit = Number(event.key);
    if (event.key === "ArrowDown") items[(at + 1) % items.length].focus();
    else if (event.key === "ArrowUp") items[(at + items.length - 1) % items.length].focus();
    else if (event.key === "Escape") this.close();
    else if (digit >= 1 && digit <= items.length) items[digit - 1].click();
    else if (event.key !== "Enter" && event.key !== " " && event.key !== "Tab") return;
    else return event.stopPropagation();
    taken(event);
  }
}

/** The groups of the table of actions, and the modes that have them. */
const GROUPS = {
  session: ["Session", "session"],
  timeline: ["Timeline", "session"],
  proposal: ["Proposal", "session"],
  joint: ["Joint of a part (Why joined)", "session"],
  sides: ["Sides", "session"],
  view: ["Views", ""],
  page: ["Page", ""],
  teaching: ["Teaching", ""],
  capture: ["Capture (with --camera)", "camera"],
};
/** @type {HelpRow[]} */
const POINTER = [
  [["Click"], "", "Pick a grasp point, on the flattened view or in 3D."],
  [["Drag"], "", "Pan the flattened view; on the proposal: move it, with Shift turn it."],
  [["Right drag"], "", "Pan, also over the proposal."],
  [["Wheel"], "", "Zoom at the pointer."],
];

/** Fill the sheet of keys; what works now comes first. */
export function showHelp(/** @type {ActionRow[]} */ actions, /** @type {string} */ mode) {
  const place = (/** @type {string} */ of) => (of === mode ? 0 : of === "" ? 1 : 2);
  const groups = Object.entries(GROUPS).sort(([, a], [, b]) => place(a[1]) - place(b[1]));
  const sections = groups.map(([group, [title, of]]) => {
    const note = of === "session" && of !== mode ? " (of a recording)" : "";
    return actionSection(title + note, group, actions);
  });
  showKeys([...sections, keySection("Pointer", POINTER)]);
}

// --- The command palette -----------------------------------------------------------------------

/** @type {Record<string, number>} */
const STEPS = { ArrowDown: 1, ArrowUp: -1, PageDown: 8, PageUp: -8 };

/** Open it; `run(name)` performs the chosen command after the palette has closed. */
export function showPalette(/** @type {ActionRow[]} */ actions, /** @type {(name: string) => void} */ run) {
  const dialog = byId("palette");
  const box = byId("palette-box");
  const list = byId("palette-list");
  let shown = /** @type {ActionRow[]} */ ([]);
  let at = 0;

  function search() {
    const words = box.value.toLowerCase().split(/\s+/).filter(Boolean);
    const found = actions
      .map((action) => ({ action, rank: rankOf(action, words) }))
      .filter(({ rank }) => rank < Infinity)
      .sort((a, b) => Number(a.action.why_not !== null) - Number(b.action.why_not !== null) || a.rank - b.rank);
    shown = found.map(({ action }) => action);
    list.replaceChildren(...shown.map(item));
    byId("palette-none").hidden = shown.length > 0;
    choose(0);
  }

  function item(/** @type {ActionRow} */ action, /** @type {number} */ index) {
    const off = action.why_not !== null;
    return make(
      "li",
      {
        role: "option",
        id: `palette-${index}`,
        "aria-disabled": off ? "true" : null,
        click: () => take(index),
        pointermove: () => choose(index),
      },
      make("strong", action.title),
      make("span", off ? `Not now: ${action.why_not}` : action.description),
      action.keys[0] && make("kbd", keyName(action.keys[0])),
    );
  }

  function choose(/** @type {number} */ index) {
    list.children[at]?.setAttribute("aria-selected", "false");
    at = Math.max(0, Math.min(shown.length - 1, index));
    const now = list.children[at];
    now?.setAttribute("aria-selected", "true");
    now?.scrollIntoView({ block: "nearest" });
    if (now) box.setAttribute("aria-activedescendant", now.id);
    else box.removeAttribute("aria-activedescendant");
  }

  function take(/** @type {number} */ index) {
    const action = shown[index];
    if (!action || action.why_not !== null) return;
    dialog.close();
    run(action.name);
  }

  box.value = "";
  box.oninput = search;
  dialog.onkeydown = (event) => {
    const by = STEPS[event.key];
    if (by) choose(at + by);
    else if (event.key === "Enter") take(at);
    else return;
    event.preventDefault();
  };
  dialog.onclick = (event) => event.target === dialog && dialog.close();
  search();
  dialog.showModal();
  box.focus();
}

/** How well the words fit, less being better; infinite if one does not. */
function rankOf(/** @type {ActionRow} */ action, /** @type {string[]} */ words) {
  const title = action.title.toLowerCase();
  const all = `${title} ${action.description.toLowerCase()} ${action.name.replaceAll("_", " ")}`;
  if (!words.every((word) => all.includes(word))) return Infinity;
  return words.reduce((rank, word) => rank + (title.startsWith(word) ? 0 : title.includes(word) ? 1 : 2), 0);
}
