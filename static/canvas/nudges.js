// Keys that move the proposal: shown at once, and one gesture of many presses is one item to undo.

import { sumOf } from "./geometry.js";
import { PagePart } from "../page/page.js";

/** @type {Record<string, [turn: number, right: number, down: number]>} */
const MOVES = {
  left: [0, -1, 0],
  right: [0, 1, 0],
  up: [0, 0, -1],
  down: [0, 0, 1],
  turn_left: [-1, 0, 0],
  turn_right: [1, 0, 0],
};
const PAUSE_MS = 250; // keys closer together than this are one gesture

export const isMove = (/** @type {string} */ name) => name in MOVES;

export class KeyNudges extends PagePart {
  gesture = /** @type {{ view: number; by: By; timer?: number } | null} */ (null);
  /** @type {NonNullable<Panel["actions"]>} */
  actions = Object.fromEntries(Object.keys(MOVES).map((name) => [name, (large) => this.move(name, large ? 10 : 1)]));

  /** Move by an action of the table, so many times its step. */
  move(/** @type {string} */ name, /** @type {number} */ times) {
    const { canvas } = this;
    const { settings, pending } = this.page.state;
    const [turn, right, down] = MOVES[name].map((steps) => steps * times);
    const step = settings.step_mm / 1000;
    const by = canvas.asSeen((turn * settings.step_deg * Math.PI) / 180, right * step, down * step);
    canvas.showPreview(sumOf(canvas.preview, by));
    this.gesture ??= { view: pending?.view_index ?? -1, by: { theta: 0, u: 0, v: 0 } };
    this.gesture.by = sumOf(this.gesture.by, by);
    clearTimeout(this.gesture.timer);
    this.gesture.timer = setTimeout(() => this.flush(), PAUSE_MS);
  }

  /** End the gesture: what comes next is meant for where the proposal is seen. */
  flush() {
    if (!this.gesture) return;
    clearTimeout(this.gesture.timer);
    const { view, by } = this.gesture;
    this.gesture = null;
    if (this.page.state.pending?.view_index === view) this.page.move(by);
  }
}
