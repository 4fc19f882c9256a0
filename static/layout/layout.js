// How the panes share the window: beside one another, stacked, or one at a time.

import { PagePart } from "../page/page.js";
import { byId, rebuild, smallButton, taken, targetOf, within } from "../page/dom.js";
import { KeptSwitch } from "../page/theme.js";

const WIDE_PX = 1200; // from here on all panes are beside one another
const BESIDE_PX = 800; // from here on the details are beside the others
const HIGH_PX = 640; // from here on two panes can be stacked
const CHOSEN = "flatcloth-pane";
/** @type {Record<string, number>} of the divider, by keys */
const STEPS = { ArrowLeft: -0.02, ArrowUp: -0.02, ArrowRight: 0.02, ArrowDown: 0.02, Home: -1, End: 1 };
/** @type {Record<string, string>} */
const TITLES = { both: "Both", flat: "Flattened", scene: "3D", details: "Details" };
/** @type {Record<string, string>} the pane in which the effect of an action is seen */
const PANE_OF = {
  diagnostics: "scene",
  source_image: "scene",
  source_mask: "scene",
  source_states: "scene",
  follow: "scene",
  look: "details",
  pairs: "flat",
  doubt_next: "flat",
};

/** The kind of layout for a window, and the panes that can be chosen there. */
export function layoutOf(/** @type {number} */ width, /** @type {number} */ height) {
  const high = height >= HIGH_PX;
  if (width >= WIDE_PX) return { kind: "wide", panes: [] };
  if (width >= BESIDE_PX) return { kind: "beside", panes: high ? ["both", "flat", "scene"] : ["flat", "scene"] };
  if (high) return { kind: "below", panes: ["flat", "scene"] };
  return { kind: "tabs", panes: ["flat", "scene", "details"] };
}

const readouts = /** @type {HTMLElement} */ (globalThis.document?.querySelector(".readouts"));

export class Layout extends PagePart {
  name = "layout";
  arranged = () => {};
  actions = { readout: () => this.fold() };
  kind = "";
  panes = /** @type {string[]} */ ([]);
  pane = /** @type {string | null} */ (null);
  present = /** @type {number | null} */ (null);
  chosen = localStorage.getItem(CHOSEN);
  folded = new KeptSwitch("readout-folded", true);
  box = byId("panes");
  menu = byId("menu");
  foldButton = byId("fold");

  constructor(/** @type {Page} */ page) {
    super(page);
    this.menu.addEventListener("click", () => this.toggleMenu());
    byId("page-actions").addEventListener("click", () => this.toggleMenu(false));
    document.addEventListener("pointerdown", (event) => {
      if (!targetOf(event).closest("#menu, #page-actions")) this.toggleMenu(false);
    });
    this.foldButton.addEventListener("click", () => page.run("readout"));
    addEventListener("resize", () => {
      this.apply();
      this.showPresent();
    });
    startDivider(this);
    this.apply();
  }

  update(/** @type {State} */ state) {
    this.foldButton.dataset.tip = this.page.tip("readout");
    this.show();
    if (this.present === state.present_view) return;
    this.present = state.present_view;
    this.showPresent();
  }

  /** Bring the present view of the timeline, which is drawn after the panels, into sight. */
  showPresent() {
    const bring = () =>
      document.querySelector(".view.present")?.scrollIntoView({ block: "nearest", inline: "nearest" });
    requestAnimationFrame(bring);
  }

  escape() {
    return this.toggleMenu(false);
  }

  /** Open or close the menu of narrow windows; whether it was open. */
  toggleMenu(/** @type {boolean | null} */ open = null) {
    const was = document.body.classList.contains("menu-open");
    const now = document.body.classList.toggle("menu-open", open ?? !was);
    this.menu.setAttribute("aria-expanded", String(now));
    return was;
  }

  /** Choose the layout for the window as it is now. */
  apply() {
    // Not innerWidth: on a phone that grows with whatever sticks out of the page.
    const { kind, panes } = layoutOf(document.documentElement.clientWidth, innerHeight);
    this.kind = kind;
    this.panes = panes;
    this.pane = this.chosen && panes.includes(this.chosen) ? this.chosen : (panes[0] ?? null);
    const { dataset } = document.documentElement;
    dataset.layout = kind;
    dataset.pane = this.pane ?? "all";
    const { on: isFolded } = this.folded;
    readouts.classList.toggle("folded", isFolded);
    this.foldButton.setAttribute("aria-expanded", String(!isFolded));
    this.foldButton.textContent = isFolded ? "▴" : "▾";
    this.arranged();
    this.show();
  }

  show() {
    if (!this.page.state) return;
    this.box.hidden = !this.panes.length;
    rebuild(this.box, [this.panes, this.pane], () =>
      this.panes.map((pane) =>
        smallButton(TITLES[pane], () => this.choose(pane), { pressed: pane === this.pane, key: `pane-${pane}` }),
      ),
    );
  }

  choose(/** @type {string} */ pane) {
    this.chosen = pane;
    localStorage.setItem(CHOSEN, pane);
    this.apply();
  }

  /** Show the pane in which an action is seen, unless it is shown. */
  reveal(/** @type {string} */ action) {
    const pane = PANE_OF[action];
    if (pane && this.panes.includes(pane) && ![pane, "both"].includes(this.pane ?? "")) this.choose(pane);
  }

  fold() {
    this.folded.on = !this.folded.on;
    this.apply();
  }
}

/**
 * The divider between scene and flattened view: upright where they are beside one another, else level. The least sizes
 * of both are the style sheet's.
 */
function startDivider(/** @type {Layout} */ layout) {
  const [split, divider, shield] = [byId("split"), byId("divider"), byId("scene-shield")];
  const isUpright = () => layout.kind === "wide";
  const stored = () => (isUpright() ? "flatcloth-split" : "flatcloth-split-level");
  /** The share of the split that lies before a place of the window. */
  const shareAt = (/** @type {Point} */ { x, y }) => {
    const box = split.getBoundingClientRect();
    return isUpright() ? (x - box.left) / box.width : (y - box.top) / box.height;
  };
  const present = () => shareAt(divider.getBoundingClientRect());

  const apply = () => {
    const share = localStorage.getItem(stored());
    document.documentElement.style.setProperty(isUpright() ? "--left" : "--top", share && `${100 * Number(share)}%`);
    divider.setAttribute("aria-orientation", isUpright() ? "vertical" : "horizontal");
    divider.setAttribute("aria-valuenow", String(Math.round(100 * present()) || 0));
  };
  const keep = (/** @type {number} */ share) => localStorage.setItem(stored(), String(share));
  const set = (/** @type {number} */ share) => {
    keep(within(share, 0, 1));
    apply();
    keep(present());
  };

  divider.addEventListener("pointerdown", (event) => {
    divider.setPointerCapture(event.pointerId);
    shield.hidden = false; // the frame would swallow the pointer
  });
  divider.addEventListener("pointermove", (event) => {
    if (divider.hasPointerCapture(event.pointerId)) set(shareAt(event));
  });
  divider.addEventListener("lostpointercapture", () => (shield.hidden = true));
  divider.addEventListener("dblclick", () => {
    localStorage.removeItem(stored());
    apply();
  });
  divider.addEventListener("keydown", (event) => {
    if (!(event.key in STEPS)) return;
    set(present() + STEPS[event.key]);
    taken(event);
  });
  layout.arranged = apply;
}
