// What the parts of the page share: the state, messages to the server, the buttons of actions, the registry of panels.

/**
 * A part of the page. All members may be left out.
 *
 * @typedef {object} Panel
 * @property {string} [name] under which its `status` stands in `window.flatcloth`
 * @property {(state: any) => void} [update] takes each state of the server
 * @property {Record<string, (large: boolean) => void>} [actions] what it does, by the names of viewer/protocol/actions
 * @property {Record<string, (message: any) => void>} [messages] what it takes, by the type of the server's message
 * @property {(u_m: number, v_m: number) => boolean} [click] a click on the flattened view; true: it is taken
 * @property {(at: {u_m: number, v_m: number} | null) => void} [hover] the pointer on the flattened view
 * @property {(answer: any) => void} [hovered] the values under the pointer, null: none
 * @property {() => object} [asksHover] its additional request about the point under the pointer
 * @property {() => boolean} [escape] Escape was pressed; true: there was something to close
 * @property {(by: {theta: number, u: number, v: number}) => void} [moving] the proposal is being moved by so much
 * @property {() => void} [placed] the proposal is drawn where the server has put it
 * @property {() => void} [disconnected] the connection is lost: pending requests stay unanswered
 * @property {() => void} [reconnected] another server process may answer from now on
 * @property {(view: number, rc: [number, number]) => void} [lookAt] show a pixel of a view
 * @property {Record<string, boolean>} [pressed] which of its actions are on, for their buttons
 * @property {(state: any) => boolean} [mayAccept] false: Accept waits, as its button now says
 * @property {any} [status] for tests
 */

export class Page {
  /** `handlers`: send(message), notify(level, text), run(action), show(state) draws the page again. */
  constructor(handlers) {
    this.handlers = handlers;
    /** @type {any} */
    this.state = null;
    this.layer = "color"; // of the flattened view
    /** @type {any} */
    this.canvas = null;
    /** @type {any} */
    this.toolbar = null;
    /** @type {any} */
    this.comparison = null;
    /** @type {any} */
    this.looking = null;
    /** @type {any} */
    this.ruler = null;
    /** @type {any} what is drawn over the 3D scene */
    this.sceneMarks = null;
    /** @type {any} the brush of the side of interest, for panels that can be painted on */
    this.brush = null;
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
    this.panels.push(panel);
    return panel;
  }

  /** @param {import("/static/page/messages").ClientMessage} message */
  send(message) {
    return this.handlers.send(message);
  }

  notify(level, text) {
    this.handlers.notify(level, text);
  }

  run(name) {
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

  action(name) {
    return this.state.actions.find((a) => a.name === name);
  }

  tip(name) {
    return this.toolbar.tip(this.action(name));
  }

  /** The button of an action of the table. */
  button(name, title = null) {
    const button = this.toolbar.button(name, title);
    button.dataset.tip = this.tip(name);
    return button;
  }

  /** What a panel does for an action, if one does. */
  actionOf(name) {
    for (const { actions } of this.panels) if (actions && name in actions) return actions[name];
    return null;
  }

  /** Give a message of the server to whom it concerns. */
  take(message) {
    for (const panel of this.panels) panel.messages?.[message.type]?.(message);
  }

  /** Let every panel that has it hear of something. */
  each(event, ...args) {
    for (const panel of this.panels) panel[event]?.(...args);
  }

  /** Offer something to the panels in turn; whether one took it. */
  offer(event, ...args) {
    return this.panels.some((panel) => panel[event]?.(...args));
  }
}
