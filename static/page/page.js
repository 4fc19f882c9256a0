// What the parts of the page share: the state, messages to the server, the buttons of actions, the registry of panels.

/**
 * A part of the page. All members may be left out.
 *
 * @typedef {object} Panel
 * @property {string} [name] under which its `status` stands in `window.flatcloth`
 * @property {(state: State) => void} [update] takes each state of the server
 * @property {Record<string, (large: boolean) => void>} [actions] what it does, by the names of viewer/protocol/actions
 * @property {Record<string, (message: any) => void>} [messages] what it takes, by the type of the server's message
 * @property {(u_m: number, v_m: number) => boolean} [click] a click on the flattened view; true: it is taken
 * @property {(at: {u_m: number, v_m: number} | null) => void} [hover] the pointer on the flattened view
 * @property {(answer: import("/static/page/messages").HoverAnswer | null) => void} [hovered]
 *   the values under the pointer, null: none
 * @property {() => object} [asksHover] its additional request about the point under the pointer
 * @property {() => boolean} [escape] Escape was pressed; true: there was something to close
 * @property {(by: {theta: number, u: number, v: number}) => void} [moving] the proposal is being moved by so much
 * @property {() => void} [placed] the proposal is drawn where the server has put it
 * @property {() => void} [disconnected] the connection is lost: pending requests stay unanswered
 * @property {() => void} [reconnected] another server process may answer from now on
 * @property {(view: number, rc: [number, number]) => void} [lookAt] show a pixel of a view
 * @property {Record<string, boolean>} [pressed] which of its actions are on, for their buttons
 * @property {(state: State) => boolean} [mayAccept] false: Accept waits, as its button now says
 * @property {any} [status] for tests
 */

/**
 * @typedef {"update" | "click" | "hover" | "hovered" | "escape" | "moving" | "placed" | "disconnected" |
 *   "reconnected" | "lookAt"} PanelEvent
 */

export class Page {
  /** `handlers`: send(message), notify(level, text), run(action), show(state) draws the page again. */
  constructor(/** @type {any} */ handlers) {
    this.handlers = handlers;
    const later = /** @type {any} */ (null); // main.js sets these parts before the first state
    /** @type {State} the last state that the server sent; no panel acts before the first */
    this.state = later;
    this.layer = "color"; // of the flattened view
    /** @type {FlatCanvas} */
    this.canvas = later;
    /** @type {Toolbar} */
    this.toolbar = later;
    /** @type {Comparison} */
    this.comparison = later;
    /** @type {Looking} */
    this.looking = later;
    /** @type {Ruler} */
    this.ruler = later;
    /** @type {SceneMarks} what is drawn over the 3D scene */
    this.sceneMarks = later;
    /** @type {SidesPanel} the brush of the side of interest, for panels that can be painted on */
    this.brush = later;
    /** @type {Panel[]} */
    this.panels = [];
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

  /** @param {import("/static/page/messages").ClientMessage} message */
  send(message) {
    return this.handlers.send(message);
  }

  notify(/** @type {"info" | "warning" | "error"} */ level, /** @type {string} */ text) {
    this.handlers.notify(level, text);
  }

  run(/** @type {string} */ name) {
    this.handlers.run(name);
  }

  /** Draw the page again, after something of this tab has changed. */
  changed() {
    if (this.state) this.handlers.show(this.state);
  }

  /** Draw the marks on the flattened view and over the scene again. */
  redrawMarks() {
    this.canvas.redraw();
    this.sceneMarks.dirty = true;
  }

  get isLive() {
    return this.state?.mode === "live";
  }

  action(/** @type {string} */ name) {
    return /** @type {ActionRow} */ (this.state.actions.find((a) => a.name === name));
  }

  tip(/** @type {string} */ name) {
    return this.toolbar.tip(this.action(name));
  }

  /** The button of an action of the table. */
  button(/** @type {string} */ name, /** @type {string | null} */ title = null) {
    const button = this.toolbar.button(name, title);
    button.dataset.tip = this.tip(name);
    return button;
  }

  /** What a panel does for an action, if one does. */
  actionOf(/** @type {string} */ name) {
    for (const { actions } of this.panels) if (actions && name in actions) return actions[name];
    return null;
  }

  /** Give a message of the server to the panels that take its type. */
  take(/** @type {ServerMessage} */ message) {
    for (const panel of this.panels) panel.messages?.[message.type]?.(message);
  }

  /**
   * Call a method of each panel that has it.
   *
   * @param {PanelEvent} event @param {...any} args
   */
  each(event, ...args) {
    for (const panel of this.panels) call(panel, event, args);
  }

  /**
   * Call a method of the panels in turn until one returns true; whether one did.
   *
   * @param {PanelEvent} event @param {...any} args
   */
  offer(event, ...args) {
    return this.panels.some((panel) => call(panel, event, args));
  }
}

const call = (/** @type {any} */ panel, /** @type {PanelEvent} */ event, /** @type {any[]} */ args) =>
  panel[event]?.(...args);
