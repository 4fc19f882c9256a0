// Deciding on the timeline: what was decided about a view, which is reopened, and jumps between views.

import { showCommands } from "../page/commands.js";
import { find, focusOn } from "../page/dom.js";
import { PagePart } from "../page/page.js";
import { number } from "../page/format.js";
import { DECIDED, described } from "./timeline.js";

const WAITING = ["pending", "skipped"];

export class Verdicts extends PagePart {
  chosen = /** @type {number | null} */ (null); // index of the view that is chosen on the timeline
  actions = {
    reopen: () => this.reopenChosen(this.page.state),
    next_undecided: () => this.nextUndecided(this.page.state),
  };

  /** A press on a view of the timeline. */
  choose(/** @type {ViewRow} */ view) {
    if (this.page.state.capture) return this.page.notify("info", view.why_not ?? "");
    this.chosen = view.index;
    if (DECIDED.includes(view.state)) this.ask(view);
    else this.propose(view);
  }

  /** Decide again about the view that is chosen, or say how to choose one. */
  reopenChosen(/** @type {State} */ state) {
    const view = state.views[this.chosen ?? -1];
    if (!view) return this.page.notify("info", "Choose a view on the timeline first.");
    if (view.why_not_reopen !== null) return this.page.notify("info", view.why_not_reopen);
    this.reopen(view);
  }

  reopen(/** @type {ViewRow} */ view) {
    this.page.decide("reopen", { view_index: view.index });
  }

  propose(/** @type {ViewRow} */ view) {
    if (view.why_not !== null) return this.page.notify("info", view.why_not);
    this.page.decide("view", { view_index: view.index });
  }

  nextUndecided(/** @type {State} */ state) {
    const from = this.chosen ?? state.present_view ?? -1;
    const order = [...state.views.slice(from + 1), ...state.views.slice(0, from + 1)];
    const next = order.find((v) => WAITING.includes(v.state)) ?? order.find((v) => v.state === "unused");
    if (!next) return this.page.notify("info", "Every view is decided.");
    this.goTo(next);
  }

  goTo(/** @type {ViewRow} */ view) {
    this.chosen = view.index;
    const button = cellOf(view);
    button.scrollIntoView({ block: "nearest", inline: "center" });
    focusOn(button);
    if (DECIDED.includes(view.state)) this.ask(view);
  }

  /** What was decided about a view, and to decide again. */
  ask(/** @type {ViewRow} */ view) {
    const title = view.state === "skipped" ? "Propose it now" : "Reopen";
    const reopen = { ...this.page.action("reopen"), title, description: "", why_not: view.why_not_reopen };
    const about = `View ${view.index}, ${number(view.angle_deg, 0)}°: ${described(view, this.page.state)}.`;
    showCommands([reopen], () => this.reopen(view), about);
  }
}

const cellOf = (/** @type {ViewRow} */ view) => find(`[data-id="view-${view.index}"]`);
