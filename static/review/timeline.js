// The views of the recording in a row: what was decided, in which order, with which score, and to decide again; dragging
// along it turns the item.

import { showCommands } from "../page/commands.js";
import { byId, focusOn, make, rebuild, setCurrent, taken, targetOf, within } from "../page/dom.js";
import { number } from "../page/format.js";
import { PagePart } from "../page/page.js";

export const STATES = {
  start: ["●", "start view"],
  accepted: ["✓", "accepted"],
  fixed: ["✎", "accepted, placed by hand"],
  rejected: ["✕", "rejected"],
  skipped: ["»", "skipped, comes again"],
  pending: ["?", "proposed"],
  unused: ["", "not used"],
};
const DECIDED = ["accepted", "fixed", "rejected", "skipped"];
const WAITING = ["pending", "skipped"];
const DRAG_PX = 5;
const PLAY_MS = 400; // a view; its image is there in less

export class Timeline extends PagePart {
  name = "timeline";
  actions = {
    play_views: () => this.play(),
    reopen: () => this.reopenChosen(this.page.state),
    next_undecided: () => this.nextUndecided(this.page.state),
  };
  row = byId("timeline");
  chosen = /** @type {number | null} */ (null); // index of the view that is chosen
  scrubbed = /** @type {number | null} */ (null); // view that the item was turned to
  from = /** @type {number | null} */ (null); // where the pointer went down
  dragged = false;
  listed = false; // the list has the pictures, or they wait
  timer = 0; // while the views are played

  constructor(/** @type {Page} */ page) {
    super(page);
    this.row.addEventListener("pointerdown", (event) => (this.from = event.button === 0 ? event.clientX : null));
    this.row.addEventListener("pointermove", (event) => this.drag(event));
    this.row.addEventListener("click", (event) => this.dragged && taken(event), true);
    this.row.addEventListener("roved", (event) => this.roved(targetOf(event)));
    for (const end of ["pointerup", "pointercancel"]) window.addEventListener(end, () => this.end());
  }

  update(/** @type {State} */ state) {
    byId("timeline-tools").hidden = Boolean(state.capture);
    const labels = [this.page.brush?.addressOf(0), this.page.brush?.certain];
    this.listed = !byId("review-list").hidden || !this.page.isSettled;
    const at = [state.present_view, Boolean(state.pending)];
    rebuild(this.row, [state.views, at, state.review?.token, labels, this.listed], () =>
      state.views.map((view) => this.cell(view, state)),
    );
    this.cells.forEach((view, i) => {
      view.classList.toggle("present", i === state.present_view);
      setCurrent(view, i === state.present_view);
    });
  }

  cell(/** @type {ViewRow} */ view, /** @type {State} */ state) {
    const about = `View ${view.index}, ${number(view.angle_deg, 0)}°: ${described(view, state)}`;
    const labelled = state.capture ? null : this.page.brush?.thumbsOf(view.index);
    const shown = (isFlattened(view) || labelled) && state.review && !this.listed;
    return make(
      "button",
      {
        class: `view ${view.state}${view.flagged ? " flagged" : ""}${shown ? " pictured" : ""}`,
        "aria-disabled": String(view.why_not !== null && !DECIDED.includes(view.state)),
        label: about,
        key: `view-${view.index}`,
        tip: about + whatAPressDoes(view, state),
        tabindex: view.index === (state.present_view ?? 0) ? 0 : -1, // page/roving.js: one stop of Tab
        click: () => this.choose(view),
      },
      shown && make("span.pair", ...this.pictures(view, state, labelled)),
      drawn("span.sign", view.flagged ? "⚑" : STATES[view.state][0]),
      shown && view.order && drawn("span.order", String(view.order)),
      shown && scoreBar(view.score, view.flagged),
      make(
        "span.angle",
        number(view.angle_deg, 0),
        shown && view.added_cm2 !== null && drawn("b", added(view.added_cm2)),
      ),
    );
  }

  /**
   * The flattened view if there is one, and the image under the sides of its cloth if they are found here.
   * @param {ViewRow} view @param {State} state @param {string[] | null | undefined} labelled
   */
  pictures(view, state, labelled) {
    return [
      labelled && make("span.labelled", ...labelled.map(picture)),
      isFlattened(view) && thumbOf(view, state, "flat.webp"),
    ];
  }

  // --- turning the item --------------------------------------------------------------------------

  drag(/** @type {PointerEvent} */ event) {
    if (this.from === null || !event.buttons || this.page.hasCamera) return;
    if (!this.dragged && Math.abs(event.clientX - this.from) < DRAG_PX) return;
    this.dragged = true;
    const { top, bottom } = this.row.getBoundingClientRect();
    const cell = document.elementFromPoint(event.clientX, within(event.clientY, top + 12, bottom - 12));
    const at = this.cells.findIndex((view) => view.contains(cell));
    if (at >= 0) this.turnTo(at);
  }

  get cells() {
    return [...this.row.children];
  }

  end() {
    this.from = null;
    setTimeout(() => (this.dragged = false)); // after the click that ends a drag
  }

  /** The arrow keys go from view to view and turn the item, unless a proposal is looked at. */
  roved(/** @type {HTMLElement} */ cell) {
    if (!this.page.state?.pending && !this.page.hasCamera) this.turnTo(this.cells.indexOf(cell));
  }

  turnTo(/** @type {number} */ index) {
    if (this.scrubbed === index) return;
    this.row.querySelector(".scrubbed")?.classList.remove("scrubbed");
    this.row.children[index]?.classList.add("scrubbed");
    this.scrubbed = index;
    this.page.send({ type: "turn_to", view_index: index });
  }

  get pressed() {
    return { play_views: this.timer > 0 };
  }

  /** Turn the item once through all views; again: stop. */
  play(left = this.timer ? 0 : this.cells.length) {
    clearTimeout(this.timer);
    this.timer = left && setTimeout(() => this.play(left - 1), PLAY_MS);
    if (left) this.turnTo(((this.scrubbed ?? this.page.state?.present_view ?? 0) + 1) % this.cells.length);
    this.page.changed();
  }

  // --- deciding ----------------------------------------------------------------------------------

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
    this.chosen = next.index;
    const cell = this.cells[next.index];
    cell.scrollIntoView({ block: "nearest", inline: "center" });
    focusOn(cell);
    if (DECIDED.includes(next.state)) this.ask(next);
  }

  /** What was decided about a view, and to decide again. */
  ask(/** @type {ViewRow} */ view) {
    const title = view.state === "skipped" ? "Propose it now" : "Reopen";
    const reopen = { ...this.page.action("reopen"), title, description: "", why_not: view.why_not_reopen };
    const about = `View ${view.index}, ${number(view.angle_deg, 0)}°: ${described(view, this.page.state)}.`;
    showCommands([reopen], () => this.reopen(view), about);
  }
}

/** A sign that is drawn by the style sheet: the name of its button has it in words. */
const drawn = (/** @type {string} */ selector, /** @type {string} */ sign) =>
  make(selector, { "aria-hidden": "true", data: { sign } });

/** Views with a decision have pictures: the others are not flattened yet. */
export const isFlattened = (/** @type {ViewRow} */ view) => view.state !== "unused";

/** A small picture of a view. */
export const picture = (/** @type {string} */ src) =>
  make("img", { src, alt: "", loading: "lazy", draggable: "false" });

/** Its color image or flattened view, by the file's name. @param {ViewRow} view @param {State} state @param {string} file */
export const thumbOf = (view, state, file) => picture(`review/${view.index}/${file}?v=${state.review?.token}`);

export const scoreBar = (/** @type {number | null} */ score, /** @type {boolean} */ low) =>
  make(
    "span.bar-of-score",
    { class: low ? "low" : "", "aria-hidden": "true" },
    make("i", { style: { width: `${Math.round(100 * (score ?? 0))}%` } }),
  );

export const added = (/** @type {number} */ cm2) => `${cm2 < 0 ? "" : "+"}${number(cm2, 0)}`;

/** Flags of a view in words. @param {ViewRow} view @param {State} state */
export const flagsOf = (view, state, flags = view.flags ?? []) =>
  flags.map((flag) => state.review?.flags[flag] ?? flag);

/** The flags that ask for a look: that a view was placed by hand is no doubt about it. */
export const doubtsOf = (/** @type {ViewRow} */ view) => (view.flags ?? []).filter((flag) => flag !== "by_hand");

/** What was decided about a view, in words. */
function described(/** @type {ViewRow} */ view, /** @type {State} */ state) {
  const [, word] = STATES[view.state];
  const flags = flagsOf(view, state, doubtsOf(view));
  const parts = [
    word + (view.detail ? ` (${view.detail})` : ""),
    view.order && `number ${view.order}`,
    typeof view.score === "number" && `score ${number(view.score, 2)}`,
    typeof view.added_cm2 === "number" && `added ${number(view.added_cm2, 0)} cm²`,
    flags.length > 0 && `flagged: ${flags.join(", ")}`,
  ];
  return parts.filter(Boolean).join(", ");
}

function whatAPressDoes(/** @type {ViewRow} */ view, /** @type {State} */ state) {
  if (state.capture) return "\nOn disk.";
  if (DECIDED.includes(view.state)) return "\nClick: look at the decision, reopen it. Drag: turn the item.";
  if (view.why_not === null) return "\nClick: propose this view. Drag: turn the item.";
  return view.state === "unused" ? `\nNot now: ${view.why_not}` : "";
}
