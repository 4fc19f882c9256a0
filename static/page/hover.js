// What is under the pointer on the flattened view: one question at a time, always about the latest place.

export class Hover {
  name = "hover";

  constructor(/** @type {Page} */ page) {
    this.page = page;
    this.id = 0;
    this.wanted = null;
    this.last = null; // where the pointer is
    this.about = ""; // what the last state showed there
    this.busy = false;
    /** @type {Panel["messages"]} */
    this.messages = { hover: (message) => this.take(message) };
  }

  /** What lies under a pointer that rests may be something else now. */
  update(/** @type {State} */ state) {
    const about = JSON.stringify([
      state.layers?.revision,
      state.layers?.overlay?.revision,
      state.pending?.view_index,
    ]);
    if (about === this.about) return;
    this.about = about;
    if (state.live || !this.last) return;
    this.wanted = this.last;
    this.ask();
  }

  /** The pointer is at a place of the plane, or has left it. */
  at(/** @type {Place | null} */ place) {
    this.page.each("hover", place);
    this.wanted = this.last = place;
    if (place) return this.ask();
    this.id += 1; // what is on its way is about nothing
    this.page.each("hovered", null);
  }

  take(/** @type {HoverAnswer} */ message) {
    this.busy = false;
    // Once it is decided the proposal is no longer asked about, though it may still be drawn.
    const answer = this.page.state?.pending || this.page.isLive ? message : { ...message, proposal: null };
    if (message.id === this.id) this.page.each("hovered", answer);
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
