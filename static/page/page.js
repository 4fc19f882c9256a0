// What the parts of the page share: the state, messages to the server, the buttons of actions, the registry of panels.

import { Question } from "./connection.js";
import { make } from "./dom.js";
import { keyName, tipOf } from "./format.js";

/** @type {Record<string, string>} what is written on buttons in place of their titles */
const SIGNS = {
  zoom_out: "−",
  zoom_in: "+",
  refine: "Refine",
  garment: "Outline",
  compare_shape: "A",
  compare_proposal: "B",
  compare_difference: "Differ",
  turn_left_seen: "↺",
  turn_right_seen: "↻",
};

export class Page {
  constructor(/** @type {PageHandlers} */ handlers) {
    this.handlers = handlers;
    const later = /** @type {never} */ (null); // main.js sets these parts before the first state
    /** @type {State} the last state that the server sent; no panel acts before the first */
    this.state = later;
    /** @type {State} the same, also while the garment is turned over: `state` has the layers of the shown side then */
    this.thisSide = later;
    this.layer = "color"; // of the flattened view
    this.canvas = /** @type {FlatCanvas} */ (later);
    this.comparison = /** @type {Comparison} */ (later);
    this.looking = /** @type {Looking} */ (later);
    this.sceneMarks = /** @type {SceneMarks} */ (later); // what is drawn over the 3D scene
    this.recordingIsWrong = false; // by its check, for certain
    this.isSettled = false; // the first picture is there, or awaited no longer
    this.timeline = /** @type {Timeline} */ (later);
    this.doubts = /** @type {DoubtsPanel} */ (later);
    this.column = /** @type {RightColumn} */ (later);
    this.brush = /** @type {SidesPanel} */ (later); // of the side of interest, for panels that can be painted on
    this.panels = /** @type {Panel[]} */ ([]);
  }

  /**
   * Add a panel to the page; the first that knows an action or a click gets it.
   *
   * @template T
   * @param {T} panel
   * @returns {T}
   */
  add(panel) {
    this.panels.push(/** @type {Panel} */ (panel));
    return panel;
  }

  send(/** @type {ClientMessage} */ message) {
    return this.handlers.send(message);
  }

  /** @type {Notify} */
  notify = (level, text) => this.handlers.notify(level, text);

  run = (/** @type {string} */ name) => this.handlers.run(name);

  decide = (/** @type {string} */ name, more = {}) => this.handlers.decide(name, more);

  /** Move the proposal for good. */
  move(/** @type {By} */ by) {
    this.handlers.move(by);
  }

  /** Draw the page again, after something of this tab has changed. */
  changed() {
    if (this.thisSide) this.handlers.show(this.thisSide);
  }

  /** Draw the marks on the flattened view and over the scene again. */
  redrawMarks() {
    this.canvas.redraw();
    this.sceneMarks.dirty = true;
  }

  get hasCamera() {
    return this.state?.mode === "camera";
  }

  action(/** @type {string} */ name) {
    return /** @type {ActionRow} */ (this.state.actions.find((a) => a.name === name));
  }

  tip(/** @type {string} */ name) {
    return tipOf(this.action(name));
  }

  /** The button of an action of the table. */
  button(/** @type {string} */ name, /** @type {string | null} */ title = SIGNS[name] ?? null) {
    const action = this.action(name);
    const key = keyName(action.keys[0]);
    return make(
      "button.button",
      {
        // What is seen comes first, so that a button can be called by what is written on it.
        label: title && `${title} ${key}: ${action.title}`,
        key: name,
        tip: tipOf(action),
        data: { action: name },
        "aria-keyshortcuts": action.keys.map((key) => key.replace("Ctrl", "Control")).join(" "),
        click: () => this.run(name),
      },
      title ?? action.title,
      " ",
      make("kbd", key),
    );
  }

  /** The same, small. */
  smallButton(/** @type {string} */ name, /** @type {string | undefined} */ title = undefined) {
    const button = this.button(name, title);
    button.classList.add("small");
    return button;
  }

  /** What a panel does for an action, if one does. */
  actionOf(/** @type {string} */ name) {
    for (const { actions } of this.panels) if (actions && name in actions) return actions[name];
    return null;
  }

  /** Hand a message of the server to each panel that has a function for messages of its type. */
  take(/** @type {ServerMessage} */ message) {
    for (const { messages } of this.panels) {
      const take = /** @type {((message: ServerMessage) => void) | undefined} */ (messages?.[message.type]);
      take?.(message);
    }
  }

  /**
   * One question at a time, whose answers are messages of a type.
   * @template {"hover" | "hover_ray" | "measured" | "preview" | "garment_preview"} Type
   * @template About
   * @param {Type} type
   * @param {(id: number, about: About) => boolean} send tells whether it was sent
   * @param {(answer: Extract<ServerMessage, { type: Type }>) => void} take gets the answers about what was asked last
   */
  question(type, send, take, pauseMs = 0) {
    const question = new Question(send, take, pauseMs);
    const answered = (/** @type {{ id: number }} */ answer) => question.answered(/** @type {never} */ (answer));
    this.panels.push({ messages: { [type]: answered }, disconnected: () => question.lost() });
    return question;
  }

  /** Call a method of each panel that has it. @type {CallPanels<void>} */
  each = (event, ...args) => {
    for (const panel of this.panels) call(panel, event, args);
  };

  /** Call a method of the panels in turn until one returns true; whether one did. @type {CallPanels<boolean>} */
  offer = (event, ...args) => this.panels.some((panel) => call(panel, event, args));

  /** The places that a method of the panels gives, of all that have it. @type {CallPanels<UV[]>} */
  gather = (event, ...args) =>
    this.panels.flatMap((panel) => /** @type {UV[] | undefined} */ (call(panel, event, args)) ?? []);
}

const call = (/** @type {Panel} */ panel, /** @type {PanelEvent} */ event, /** @type {unknown[]} */ args) =>
  /** @type {((...args: unknown[]) => unknown) | undefined} */ (panel[event])?.apply(panel, args);

/** What a part of the page begins with. */
export class PagePart {
  constructor(/** @type {Page} */ page) {
    this.page = page;
    this.canvas = page.canvas;
  }
}
