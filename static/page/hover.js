// What is under the pointer on the flattened view: one question at a time, always about the latest place.

export class Hover {
  name = "hover";

  constructor(page) {
    this.page = page;
    this.id = 0;
    this.wanted = null;
    this.busy = false;
    this.messages = { hover: (message) => this.take(message) };
  }

  /** The pointer is at a place of the plane, or has left it. */
  at(place) {
    this.page.each("hover", place);
    this.wanted = place;
    if (place) return this.ask();
    this.id += 1; // what is on its way is about nothing
    this.page.each("hovered", null);
  }

  take(message) {
    this.busy = false;
    if (message.id === this.id) this.page.each("hovered", message);
    this.ask();
  }

  ask() {
    if (this.busy || !this.wanted || !this.page.state?.layers) return;
    this.id += 1;
    const more = Object.assign({}, ...this.page.panels.map((panel) => panel.asksHover?.() ?? {}));
    this.busy = this.page.send({ type: "hover", id: this.id, ...this.wanted, ...more });
    this.wanted = null;
  }

  disconnected() {
    this.busy = false;
  }
}
