// What is under the pointer on the flattened view: one question at a time, always about the latest place.

import { PagePart } from "./page.js";

export class Hover extends PagePart {
  last = /** @type {Place | null} */ (null); // where the pointer is
  about = ""; // what the last state showed there
  question = this.page.question(
    "hover",
    (id, /** @type {Place} */ place) => this.send(id, place),
    (answer) => this.show(answer),
  );

  /** What lies under a pointer that rests may be something else now. */
  update(/** @type {State} */ { layers, pending, capture }) {
    const { side } = this.page.canvas;
    const about = JSON.stringify([side, layers?.revision, layers?.overlay?.revision, pending?.view_index]);
    if (about === this.about) return;
    this.about = about;
    if (this.last && !capture) this.question.ask(this.last);
  }

  /** The pointer is at a place of the plane, or has left it. */
  hover(/** @type {Place | null} */ place) {
    this.last = place;
    if (place) return this.question.ask(place);
    this.question.drop();
    this.page.each("hovered", null);
  }

  send(/** @type {number} */ id, /** @type {Place} */ place) {
    const more = Object.assign({}, ...this.page.panels.map((panel) => panel.asksHover?.() ?? {}));
    const at = this.page.canvas.located(place.u_m, place.v_m);
    return Boolean(this.page.state?.layers) && this.page.send({ type: "hover", id, ...at, ...more });
  }

  show(/** @type {HoverAnswer} */ answer) {
    // Once it is decided the proposal is no longer asked about, though it may still be drawn.
    const decided = !this.page.state?.pending && !this.page.hasCamera;
    this.page.each("hovered", decided ? { ...answer, proposal: null } : answer);
  }
}
