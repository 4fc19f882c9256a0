// One stop of Tab a group of controls: within it the arrow keys go from control to control.

import { findAll, focusOn, isPlain, taken, targetOf, within } from "./dom.js";

const GROUPS = ".actions, .tools, #column-tabs, #proposal, #sources .heading, .thumbs, #timeline, #timeline-tools";
const CONTROLS = "button, summary";
/** @type {Record<string, number>} */
const STEPS = { ArrowLeft: -1, ArrowUp: -1, ArrowRight: 1, ArrowDown: 1, Home: -1e9, End: 1e9 };
const SETTLED_MS = 50; // from a state until all that it changes is drawn

const controlsOf = (/** @type {Element} */ group) =>
  findAll(CONTROLS, group).filter((control) => control.offsetParent !== null);

/** Let one control of a group be a stop of Tab: the one that was it, if it is still there, else the first. */
function arrange(/** @type {Element} */ group, /** @type {Element | undefined} */ stop = undefined) {
  const controls = controlsOf(group);
  const chosen = stop ?? controls.find((control) => control.tabIndex === 0);
  for (const control of controls) control.tabIndex = control === (chosen ?? controls[0]) ? 0 : -1;
}

export class Roving {
  constructor(/** @type {Page} */ page) {
    this.page = page;
    this.timer = 0;
    this.tabbed = false; // what a pointer pressed leaves the arrow keys to the proposal
    document.addEventListener("keydown", (event) => this.key(event), true);
    document.addEventListener("pointerdown", () => (this.tabbed = false), true);
  }

  update() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => findAll(GROUPS).forEach((group) => arrange(group)), SETTLED_MS);
  }

  key(/** @type {KeyboardEvent} */ event) {
    if (event.key === "Tab") this.tabbed = true;
    const control = targetOf(event);
    const way = STEPS[event.key];
    const group = way && isPlain(event) && !event.shiftKey && control.closest?.(GROUPS);
    const isFree = this.tabbed || (group && group.id === "timeline" && !this.page.state?.pending);
    if (!group || !isFree || !control.matches(CONTROLS)) return;
    const controls = controlsOf(group);
    const next = controls[within(controls.indexOf(control) + way, 0, controls.length - 1)];
    taken(event);
    arrange(group, next);
    focusOn(next);
    next.dispatchEvent(new Event("roved", { bubbles: true }));
  }
}
