// All views as a list: sorted by a column, filtered by what was decided, with the reasons.

import { PagePart } from "../page/page.js";
import { byId, find, findAll, focusOn, make, rebuild, smallButton, taken, within } from "../page/dom.js";
import { number } from "../page/format.js";
import { added, doubtsOf, flagsOf, isFlattened, scoreBar, STATES, thumbOf } from "./timeline.js";

const UNDECIDED = ["unused", "pending", "skipped"];
const LEFT_OUT = ["rejected", "skipped"];

/** @type {[string, string, (view: ViewRow) => boolean][]} */
const FILTERS = [
  ["all", "All", () => true],
  ["undecided", "Undecided", (view) => UNDECIDED.includes(view.state)],
  ["flagged", "Flagged", (view) => doubtsOf(view).length > 0],
  ["by_hand", "By hand", (view) => view.flags.includes("by_hand")],
  ["left_out", "Rejected or skipped", (view) => LEFT_OUT.includes(view.state)],
];

/** Column, title, what it is sorted by (null: last). @type {[string, string, (view: ViewRow) => number | null][]} */
const COLUMNS = [
  ["view", "View", (view) => view.index],
  ["angle", "Angle", (view) => view.angle_deg],
  ["order", "Order", (view) => view.order],
  ["state", "Decision", (view) => Object.keys(STATES).indexOf(view.state)],
  ["score", "Score", (view) => view.score],
  ["added", "Added", (view) => view.added_cm2],
  ["flags", "Flags", (view) => (view.flagged ? -2 : 0) - view.flags.length || null],
];

export class ReviewList extends PagePart {
  name = "review";
  section = byId("review-list");
  filter = "all";
  sort = "order";
  falling = false;
  actions = { review: () => this.toggle() };

  constructor(/** @type {Page} */ page) {
    super(page);
    this.section.addEventListener("keydown", (event) => this.key(event));
    byId("review-close").addEventListener("click", () => this.toggle());
  }

  get pressed() {
    return { review: !this.section.hidden };
  }

  toggle() {
    this.section.hidden = !this.section.hidden;
    this.page.changed();
    if (this.section.hidden) find("button", byId("timeline-tools"))?.focus();
    else focusOn(find("tbody button", this.section));
  }

  update(/** @type {State} */ state) {
    if (!state.review) this.section.hidden = true; // a camera decides nothing
    if (this.section.hidden) return;
    const { filter, sort, falling } = this;
    const [, , keeps] = FILTERS.find(([name]) => name === filter) ?? FILTERS[0];
    const shown = this.sorted(state.views.filter(keeps));
    rebuild(byId("review-filters"), [state.views, filter], () =>
      FILTERS.map(([name, title, holds]) =>
        smallButton(`${title} ${state.views.filter(holds).length}`, () => this.set({ filter: name }), {
          pressed: filter === name,
          key: `filter-${name}`,
        }),
      ),
    );
    rebuild(byId("review-columns"), [sort, falling], () => {
      const titles = COLUMNS.map(([name, title]) => this.head(name, title));
      const again = make("th", make("span.unseen", "Decide again"));
      return make("tr", make("th", "Images"), ...titles, make("th", "Reason"), again);
    });
    rebuild(byId("review-rows"), [shown, state.review?.token], () => shown.map((view) => this.row(view, state)));
    byId("review-none").hidden = shown.length > 0;
  }

  head(/** @type {string} */ name, /** @type {string} */ title) {
    const on = this.sort === name;
    const turn = () => this.set({ sort: name, falling: on ? !this.falling : name === "added" });
    return make(
      "th",
      { "aria-sort": on ? (this.falling ? "descending" : "ascending") : null, class: `col-${name}` },
      make(
        "button",
        { key: `sort-${name}`, click: turn },
        title,
        make("span", { "aria-hidden": "true" }, on ? (this.falling ? " ▾" : " ▴") : ""),
      ),
    );
  }

  row(/** @type {ViewRow} */ view, /** @type {State} */ state) {
    const [sign, word] = STATES[view.state];
    const flags = flagsOf(view, state);
    const known = isFlattened(view);
    const again = view.why_not_reopen === null;
    const may = again || view.why_not === null;
    const decide = () => (again ? this.page.timeline.reopen(view) : this.page.timeline.propose(view));
    const goTo = () => this.page.send({ type: "turn_to", view_index: view.index });
    const there = { label: `View ${view.index}: turn the item to it`, key: `row-${view.index}` };
    const button = may && smallButton(again ? "Reopen" : "Propose", decide, { key: `again-${view.index}` });
    return make(
      "tr",
      {
        class: `${view.state}${view.flagged ? " flagged" : ""}`,
        click: (event) => event.target.closest("button") || goTo(),
      },
      make("td.pair", known && ["color.jpg", "flat.webp"].map((file) => thumbOf(view, state, file))),
      make("td", smallButton(String(view.index), goTo, there)),
      make("td.figure", `${number(view.angle_deg, 0)}°`),
      make("td.figure", view.order === null ? "" : view.order === 0 ? "start" : String(view.order)),
      make("td", make("b", { class: `sign-of ${view.state}`, "aria-hidden": "true" }, sign), ` ${word}`),
      make("td.figure", view.score !== null && [scoreBar(view.score, view.flagged), number(view.score, 2)]),
      make("td.figure", view.added_cm2 === null ? "" : `${added(view.added_cm2)} cm²`),
      make("td.flags", ...flags.map((text) => make("span.flag", text))),
      make("td.reason", view.detail),
      make("td", button),
    );
  }

  sorted(/** @type {ViewRow[]} */ views) {
    const [, , of] = COLUMNS.find(([name]) => name === this.sort) ?? COLUMNS[0];
    const sign = this.falling ? -1 : 1;
    return [...views].sort((a, b) => {
      const [x, y] = [of(a), of(b)];
      if (x === null || y === null) return Number(x === null) - Number(y === null) || a.index - b.index;
      return sign * (x - y) || a.index - b.index;
    });
  }

  set(/** @type {{ filter?: string; sort?: string; falling?: boolean }} */ changed) {
    Object.assign(this, changed);
    this.page.changed();
  }

  key(/** @type {KeyboardEvent} */ event) {
    if (event.key === "Escape") {
      this.toggle();
    } else if (["ArrowDown", "ArrowUp"].includes(event.key)) {
      const rows = findAll("tbody tr", this.section);
      const at = rows.findIndex((row) => row.contains(document.activeElement));
      const next = rows[within(at + (event.key === "ArrowDown" ? 1 : -1), 0, rows.length - 1)];
      const button = next && find("button", next);
      if (!button) return;
      focusOn(button);
      button.click();
    } else {
      return;
    }
    taken(event);
  }
}
