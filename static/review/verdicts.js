// Deciding on the timeline: a card about each decided view, from which it is reopened, and jumps between views.

import { button, byId, find, focusOn, make, placeBeside, staysIn, taken } from "../page/dom.js";
import { count, keyName, number } from "../page/format.js";
import { DECIDED, described } from "./timeline.js";

const WAITING = ["pending", "later", "skipped"];

export class Verdicts {
  name = "verdicts";

  /** `decide(action, more)` tells the server. */
  constructor(/** @type {Page} */ page, /** @type {(action: string, more: object) => void} */ decide) {
    this.page = page;
    this.decide = decide;
    this.actions = {
      reopen: () => this.reopenChosen(page.state),
      next_undecided: () => this.nextUndecided(page.state),
    };
    this.chosen = /** @type {number | null} */ (null); // index of the view that is chosen on the timeline
    this.card = byId("view-card");
    this.card.addEventListener("keydown", (event) => this.key(event));
    this.card.addEventListener("focusout", (event) => {
      if (!staysIn(this.card, event)) this.close();
    });
  }

  /** A press on a view of the timeline. */
  press(/** @type {ViewRow} */ view) {
    this.chosen = view.index;
    if (DECIDED.includes(view.state)) this.open(view);
    else this.propose(view);
  }

  /** Decide again about the view that is chosen, or say how to choose one. */
  reopenChosen(/** @type {State} */ state) {
    const view = state.views[this.chosen ?? -1];
    if (!view) return this.page.notify("info", "Choose a view on the timeline first.");
    this.close();
    if (view.why_not_reopen !== null) return this.page.notify("info", view.why_not_reopen);
    this.reopen(view);
  }

  reopen(/** @type {ViewRow} */ view) {
    this.decide("reopen", { view_index: view.index });
  }

  propose(/** @type {ViewRow} */ view) {
    if (view.why_not !== null) return this.page.notify("info", view.why_not);
    this.decide("view", { view_index: view.index });
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
    if (DECIDED.includes(view.state)) this.open(view);
  }

  open(/** @type {ViewRow} */ view) {
    const reopen = this.page.action("reopen");
    const again = view.state === "skipped" ? "Propose it now" : view.state === "later" ? "Decide it now" : "Reopen";
    const why = view.why_not_reopen;
    const main = button(
      again,
      () => (why === null ? (this.close(), this.reopen(view)) : this.page.notify("info", why)),
      { class: "primary", "aria-disabled": why === null ? null : "true", key: "reopen", tip: why },
    );
    main.append(make("kbd", keyName(reopen.keys[0])));
    const close = button("Close", () => this.close());
    close.append(make("kbd", "Esc"));
    this.card.replaceChildren(
      make("h2#view-card-title", `View ${view.index}, ${number(view.angle_deg, 0)}°`),
      make("p", `${described(view, this.page.state)}.`),
      ...(view.follows && view.state !== "later" ? [make("p.note", followers(view.follows))] : []),
      make("div.group", main, close),
    );
    this.card.hidden = false;
    placeBeside(this.card, cellOf(view).getBoundingClientRect());
    find("button", this.card).focus();
  }

  close() {
    if (this.card.hidden) return;
    const inside = this.card.contains(document.activeElement);
    this.card.hidden = true;
    if (inside) cellOf(this.page.state.views[this.chosen ?? 0])?.focus();
  }

  key(/** @type {KeyboardEvent} */ event) {
    if (event.key !== "Escape") return;
    taken(event);
    this.close();
  }
}

const cellOf = (/** @type {ViewRow} */ view) => find(`[data-id="view-${view.index}"]`);

const followers = (/** @type {number} */ n) =>
  `${count(n, "view")} accepted after it follow${n === 1 ? "s" : ""} what you decide.`;
