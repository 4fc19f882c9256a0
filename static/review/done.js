// What was done, the last first; a press goes back there, or forward again.

import { PagePart } from "../page/page.js";
import { byId, closeButton, heading, make, rebuild, setCurrent } from "../page/dom.js";

export class DonePanel extends PagePart {
  name = "done";
  shown = false;
  actions = { history: () => this.toggle() };
  section = byId("done");

  get pressed() {
    return { history: this.shown };
  }

  toggle() {
    this.shown = !this.shown;
    this.page.changed();
  }

  update(/** @type {State} */ { done, undone, mode }) {
    this.section.hidden = !this.shown || mode === "camera";
    if (this.section.hidden) return;
    rebuild(this.section, [done, undone], () => [
      heading(
        "What was done",
        closeButton("Close what was done", () => this.toggle(), { key: "close-done" }),
      ),
      make(
        "ol.done-list",
        ...[...done, ...undone]
          .map((name, n) => this.row(name, n + 1, done.length, done.length + undone.length))
          .reverse(),
        this.row("the beginning", 0, done.length, done.length + undone.length),
      ),
    ]);
  }

  /** @param {string} name @param {number} n decisions done with it @param {number} now @param {number} of */
  row(name, n, now, of) {
    const go = () => n !== now && this.page.send({ type: "go_to", done: n, of });
    const tip = n === now ? "The session is here." : n < now ? "Go back to here." : "Go forward to here.";
    const button = make("button", { key: `done-${n}`, tip, class: n > now ? "undone" : "", click: go }, name);
    setCurrent(button, n === now, "step");
    return make("li", button);
  }
}
