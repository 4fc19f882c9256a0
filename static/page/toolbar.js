// The buttons: made from the server's table of actions, so that names, keys and reasons are one.

import { buttonOf, byId, make, rebuild, setAllowed } from "/static/page/dom.js";
import { keyName } from "/static/page/format.js";

const LIVE = ["live_back", "live_play", "live_forward", "|", "live_turn"];
const SESSION = ["step", "accept", "reject", "skip", "|", "undo", "redo", "|", "auto", "restart"];
const PAGE = ["home", "teach", "export", "settings", "palette", "help"];
/** @type {[number, number][]} */
const STEPS = [
  [0.5, 0.2],
  [1, 0.5],
  [2, 1],
  [5, 2],
]; // of the keys that move the proposal: mm, degrees
/** @type {Record<string, string>} */
export const LAYERS = {
  layer_color: "color",
  layer_height: "height",
  layer_z_angle: "z_angle",
  layer_source: "source",
  layer_stretch: "stretch",
  layer_incidence: "incidence",
  layer_density: "density",
  layer_place: "place",
};
const QUALITY = ["layer_stretch", "layer_incidence", "layer_density", "layer_place"];
/** @type {Record<string, string>} */
const SIGNS = { zoom_out: "−", zoom_in: "+" };
/** @type {Record<string, string>} */
const LIVE_SIGNS = { live_back: "◂", live_forward: "▸" };

/** `run(name)` performs an action; `page` holds what belongs to this tab: layer, comparison, step. */
export class Toolbar {
  constructor(/** @type {(name: string) => void} */ run, /** @type {Page} */ page) {
    this.run = run;
    this.page = page;
    /** @type {Map<string, ActionRow>} */
    this.actions = new Map();
  }

  update(/** @type {State} */ state) {
    this.actions = new Map(state.actions.map((a) => [a.name, a]));
    if (state.mode === "live") this.build(byId("actions"), LIVE, LIVE_SIGNS);
    else this.build(byId("actions"), SESSION);
    byId("actions").setAttribute("aria-label", state.mode === "live" ? "Playing" : "Session");
    this.build(byId("page-actions"), PAGE);
    this.buildLayers(state.mode === "live");
    this.buildOverlay();
    this.build(byId("zoom-tools"), ["zoom_out", "zoom_in", "fit"], SIGNS);
    for (const action of state.actions)
      for (const button of document.querySelectorAll(`[data-action="${action.name}"]`))
        setAllowed(/** @type {HTMLElement} */ (button), action.why_not, this.tip(action));
    for (const { pressed } of this.page.panels)
      for (const [name, on] of Object.entries(pressed ?? {})) this.setPressed(name, on);
    byId("canvas").classList.toggle("measuring", this.page.ruler.on);
    if (state.live) this.updateLive(state.live);
    else this.updateSession(state);
    for (const [name, layer] of Object.entries(LAYERS)) {
      this.setPressed(name, this.page.layer === layer);
    }
  }

  updateLive(/** @type {NonNullable<State["live"]>} */ live) {
    setTitle("live_play", live.playing ? "Pause" : "Play");
    buttonOf("live_play").classList.toggle("primary", !live.playing);
    setTitle("live_turn", live.forward ? "Forward" : "Backward");
  }

  updateSession(/** @type {State} */ state) {
    this.setPressed("auto", state.auto.running);
    setTitle("auto", state.auto.running ? "Stop Auto" : "Auto");
    showSteps(byId("increment"), state.settings);
    this.page.comparison.showKinds(byId("difference-kinds"));
    const main = { deciding: "accept", ready: "step" }[state.phase];
    for (const name of ["step", "accept"]) {
      buttonOf(name).classList.toggle("primary", name === main && !state.auto.running);
    }
  }

  tip(/** @type {ActionRow} */ action) {
    const keys = action.keys.slice(0, 2).map(keyName).join(" or ");
    return `${action.description}\nKey: ${keys}`;
  }

  action(/** @type {string} */ name) {
    return /** @type {ActionRow} */ (this.actions.get(name));
  }

  setPressed(/** @type {string} */ name, /** @type {boolean} */ on) {
    buttonOf(name)?.setAttribute("aria-pressed", String(on));
  }

  button(/** @type {string} */ name, /** @type {string | null} */ title = null) {
    const action = this.action(name);
    return make(
      "button.button",
      { label: title ? action.title : null, key: name, data: { action: name }, click: () => this.run(name) },
      title ?? action.title,
      make("kbd", keyName(action.keys[0])),
    );
  }

  build(
    /** @type {HTMLElement} */ container,
    /** @type {string[]} */ names,
    /** @type {Record<string, string>} */ titles = {},
  ) {
    rebuild(container, [names], () =>
      names.flatMap((name) => {
        if (name === "|") return [make("span.gap", { "aria-hidden": "true" })];
        const button = this.button(name, titles[name]);
        if (name !== "reject") return [button];
        const more = make(
          "button.button.more",
          {
            "aria-haspopup": "menu",
            label: "Reject with a reason",
            key: "reject_menu",
            data: { action: "reject_menu" },
            click: () => this.run("reject_menu"),
          },
          "▾",
          make("kbd", keyName(this.action("reject_menu").keys[0])),
        );
        return [make("span.joined", button, more)];
      }),
    );
  }

  buildLayers(/** @type {boolean} */ live) {
    const names = Object.keys(LAYERS);
    const quality = QUALITY.filter((name) => !live || name !== "layer_place"); // a single view has no placement
    rebuild(byId("layers"), ["layers"], () =>
      names.filter((n) => !QUALITY.includes(n)).map((name) => this.button(name)),
    );
    rebuild(byId("quality-layers"), ["layers", live], () => quality.map((name) => this.button(name)));
    rebuild(byId("look-tools"), ["look"], () => [this.button("look")]);
  }

  buildOverlay() {
    const page = this.page;
    /** @param {number} mm @param {number} deg */
    const setStep = (mm, deg) => page.send({ type: "set", step_mm: mm, step_deg: deg });
    rebuild(byId("overlay-tools"), ["overlay"], () => [
      page.comparison.buttons((name, title) => this.button(name, title)),
      make("div#difference-kinds.segmented", { role: "group", label: "Difference", hidden: true }),
      make(
        "div.field",
        this.button("diagnostics"),
        make(
          "label.field",
          make("span", "Opacity"),
          make("input", {
            type: "range",
            min: 0,
            max: 1,
            step: 0.05,
            value: page.comparison.opacity,
            key: "opacity",
            input: (event) => page.comparison.setOpacity(Number(event.target.value)),
          }),
        ),
      ),
      make(
        "label.field",
        {
          tip:
            "How far an arrow key moves the proposal, and [ or ] turns it; Shift: ten times as far. It " +
            "can also be dragged.",
        },
        make("span", "Arrows, [ ]"),
        make("select#increment", {
          key: "increment",
          change: (event) => setStep(...STEPS[Number(event.target.value)]),
        }),
      ),
    ]);
  }
}

function showSteps(/** @type {HTMLElement} */ select, /** @type {State["settings"]} */ { step_mm, step_deg }) {
  const now = STEPS.findIndex(([mm, deg]) => mm === step_mm.value && deg === step_deg.value);
  const told = (/** @type {[number, number]} */ [mm, deg]) => `${mm} mm · ${deg}°`;
  rebuild(select, [step_mm.value, step_deg.value], () => [
    ...STEPS.map((step, i) => make("option", { value: i, selected: i === now }, told(step))),
    ...(now < 0
      ? [make("option", { value: "", selected: true, disabled: true }, told([step_mm.value, step_deg.value]))]
      : []),
  ]);
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
      if (!this.menu.contains(/** @type {Node | null} */ (event.relatedTarget))) this.close();
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
    /** @type {HTMLElement} */ (this.menu.firstElementChild).focus();
  }

  take(/** @type {string} */ reason) {
    this.close();
    this.choose(reason);
  }

  close() {
    this.menu.hidden = true;
  }

  key(/** @type {KeyboardEvent} */ event) {
    const items = /** @type {HTMLElement[]} */ ([...this.menu.children]);
    const at = items.indexOf(/** @type {HTMLElement} */ (document.activeElement));
    const digit = Number(event.key);
    if (event.key === "ArrowDown") items[(at + 1) % items.length].focus();
    else if (event.key === "ArrowUp") items[(at + items.length - 1) % items.length].focus();
    else if (event.key === "Escape") this.close();
    else if (digit >= 1 && digit <= items.length) items[digit - 1].click();
    else if (event.key !== "Enter" && event.key !== " " && event.key !== "Tab") return;
    else return event.stopPropagation();
    event.preventDefault();
    event.stopPropagation();
  }
}

/** Fill the sheet of keys. */
export function showHelp(/** @type {ActionRow[]} */ actions, /** @type {string} */ mode) {
  /** @param {string} of */
  const not = (of) => (mode === of ? "" : of === "live" ? " (with --live)" : " (without --live)");
  const capture = { capture: "Capture (with --camera)" };
  const session = {
    session: `Session${not("session")}`,
    timeline: `Timeline${not("session")}`,
    proposal: `Proposal${not("session")}`,
  };
  const live = { live: `Live mode${not("live")}` };
  const both = { view: "Views", page: "Page", teaching: "Teaching" };
  // What works now comes first.
  const titles =
    mode === "live" ? { ...live, ...capture, ...both, ...session } : { ...session, ...both, ...live, ...capture };
  byId("help-body").replaceChildren(
    ...Object.entries(titles).map(([group, title]) =>
      make(
        "section",
        make("h3", title),
        make(
          "dl.keys",
          ...actions
            .filter((a) => a.group === group)
            .flatMap((a) => [
              make("dt", ...a.keys.slice(0, 2).map((k) => make("kbd", keyName(k)))),
              make("dd", make("strong", a.title), " ", a.description),
            ]),
        ),
      ),
    ),
    make(
      "section",
      make("h3", "Pointer"),
      make(
        "dl.keys",
        make("dt", "Click"),
        make("dd", "Pick a grasp point, on the flattened view or in 3D."),
        make("dt", "Drag"),
        make("dd", "Pan the flattened view; on the proposal: move it, with Shift turn it."),
        make("dt", "Right drag"),
        make("dd", "Pan, also over the proposal."),
        make("dt", "Wheel"),
        make("dd", "Zoom at the pointer."),
      ),
    ),
  );
  byId("help").showModal();
  byId("help").scrollTop = 0; // the button that has the focus is at its end
}
