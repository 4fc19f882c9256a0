// Keys that move the proposal: shown at once, and one gesture of many presses is one item to undo.

const MOVES = {
  left: [0, -1, 0],
  right: [0, 1, 0],
  up: [0, 0, -1],
  down: [0, 0, 1],
  turn_left: [-1, 0, 0],
  turn_right: [1, 0, 0],
};
const PAUSE_MS = 250; // keys closer together than this are one gesture

export const isMove = (name) => name in MOVES;

export class KeyNudges {
  /** `state()` is the present state; `send({theta, u, v})` moves the proposal for good. */
  constructor(canvas, state, send) {
    this.canvas = canvas;
    this.state = state;
    this.send = send;
    this.gesture = null;
  }

  /** Move by an action of the table, so many times its step. */
  move(name, times) {
    const { settings, pending } = this.state();
    const [turn, right, down] = MOVES[name].map((x) => x * times);
    const step = settings.step_mm.value / 1000;
    const by = this.canvas.asSeen((turn * settings.step_deg.value * Math.PI) / 180, right * step, down * step);
    this.canvas.movePreview(by);
    this.gesture ??= { view: pending.view_index, by: { theta: 0, u: 0, v: 0 } };
    for (const axis of ["theta", "u", "v"]) this.gesture.by[axis] += by[axis];
    clearTimeout(this.gesture.timer);
    this.gesture.timer = setTimeout(() => this.flush(), PAUSE_MS);
  }

  /** End the gesture: what comes next is meant for where the proposal is seen. */
  flush() {
    if (!this.gesture) return;
    clearTimeout(this.gesture.timer);
    const { view, by } = this.gesture;
    this.gesture = null;
    if (this.state().pending?.view_index === view) this.send(by);
  }
}
