// A pointer for use without a mouse: arrow keys move it over the flattened view, Enter clicks, Space presses
// and lets go.

import { byId, isPlain, WAYS, within } from "../page/dom.js";

const STEP_PX = 4;
const FAST = 10;

/** Its actions reach the canvas as pointer events. It needs no button, because a button would need a pointer. */
export class KeyPointer {
  constructor() {
    this.on = false;
    this.held = false;
    this.canvas = byId("canvas");
    this.place = { x: 0, y: 0 }; // in the pane; at first in its middle
    this.placed = false;
    this.mark = byId("key-pointer");
    // Before the table of keys: while it is there, these keys are the pointer's.
    document.addEventListener("keydown", (event) => this.key(event), { capture: true });
    // A mouse that is used takes over.
    this.canvas.addEventListener("pointerdown", (event) => event.isTrusted && this.on && this.toggle());
  }

  toggle() {
    if (this.held) this.press(false);
    this.on = !this.on;
    if (this.on) {
      if (!this.placed) this.place = { x: this.canvas.clientWidth / 2, y: this.canvas.clientHeight / 2 };
      this.placed = true;
      this.canvas.focus();
      this.move(0, 0);
    } else {
      this.send("pointerleave");
    }
    this.show();
  }

  key(/** @type {KeyboardEvent} */ event) {
    if (!this.on || !isPlain(event) || document.querySelector("dialog[open]")) return;
    if (event.target !== this.canvas && event.target !== document.body) return;
    const once = {
      Enter: () => this.click(event.shiftKey),
      " ": () => this.press(!this.held, event.shiftKey),
      Escape: () => this.toggle(),
    }[event.key];
    const step = STEP_PX * (event.shiftKey ? FAST : 1);
    const way = WAYS[event.key];
    if (way) this.move(step * way[0], step * way[1]);
    else if (!once) return;
    else if (!event.repeat) once();
    event.preventDefault();
    event.stopImmediatePropagation();
  }

  move(/** @type {number} */ dx, /** @type {number} */ dy) {
    const { clientWidth, clientHeight } = this.canvas;
    this.place = {
      x: within(this.place.x + dx, 0, clientWidth - 1),
      y: within(this.place.y + dy, 0, clientHeight - 1),
    };
    this.send("pointermove");
    this.show();
  }

  click(/** @type {boolean} */ shift) {
    if (this.held) return this.press(false, shift);
    this.send("pointerdown", shift);
    this.send("pointerup", shift);
  }

  press(/** @type {boolean} */ down, shift = false) {
    this.held = down;
    this.send(down ? "pointerdown" : "pointerup", shift);
    this.show();
  }

  send(/** @type {string} */ type, shiftKey = false) {
    const at = this.canvas.getBoundingClientRect();
    const [clientX, clientY] = [at.left + this.place.x, at.top + this.place.y];
    const buttons = type === "pointerdown" || this.held ? 1 : 0;
    this.canvas.dispatchEvent(
      new PointerEvent(type, { bubbles: true, button: 0, buttons, clientX, clientY, shiftKey }),
    );
  }

  show() {
    this.mark.hidden = !this.on;
    this.mark.classList.toggle("held", this.held);
    if (this.on) this.mark.style.translate = `${this.place.x}px ${this.place.y}px`;
  }
}
