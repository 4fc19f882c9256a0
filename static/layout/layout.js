// How the panes share the window: beside one another, stacked, or one at a time.

import { PagePart } from "../page/page.js";
import { byId, rebuild, smallButton, taken, targetOf, within } from "../page/dom.js";

const WIDE_PX = 1200; // from here on all panes are beside one another
const BESIDE_PX = 800; // from here on the details are beside the others
const HIGH_PX = 640; // from here on two panes can be stacked
const CHOSEN = "flatcloth-pane";
const FOLDED = "flatcloth-readout-folded";
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

/**
 * The share of the first pane that leaves both their least sizes; where there is no room, the first gets its own.
 *
 * @param {number} share
 * @param {number} size
 * @param {number[]} least
 */
export function shareWithin(share, size, [first, second]) {
  const most = Math.max(first, size - second);
  return Math.min(1, within(share * size, first, most) / size);
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
    const fold = localStorage.getItem(FOLDED) !== "no";
    readouts.classList.toggle("folded", fold);
    this.foldButton.setAttribute("aria-expanded", String(!fold));
    this.foldButton.textContent = fold ? "▴" : "▾";
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
    const folded = readouts.classList.contains("folded");
    localStorage.setItem(FOLDED, folded ? "no" : "yes");
    this.apply();
  }
}

/** The divider between scene and flattened view: upright where they are beside one another, else level. */
function startDivider(/** @type {Layout} */ layout) {
  const upright = {
    property: "--left",
    stored: "flatcloth-split",
    usual: 0.295, // the flattened view has 55 % of a wide window
    orientation: "vertical",
    least: [300, 600], // of the scene; of canvas and inspector
    size: () => split.clientWidth,
    at: (/** @type {PointerEvent} */ event) => event.clientX - split.getBoundingClientRect().left,
    keys: { ArrowLeft: -0.02, ArrowRight: 0.02, Home: -1, End: 1 },
  };
  const level = {
    property: "--top",
    stored: "flatcloth-split-level",
    usual: 0.45,
    orientation: "horizontal",
    least: [190, 240],
    size: () => split.clientHeight,
    at: (/** @type {PointerEvent} */ event) => event.clientY - split.getBoundingClientRect().top,
    keys: { ArrowUp: -0.02, ArrowDown: 0.02, Home: -1, End: 1 },
  };
  const split = byId("split");
  const divider = byId("divider");
  const shield = byId("scene-shield");
  const way = () => (layout.kind === "wide" ? upright : level);
  const stored = () => Number(localStorage.getItem(way().stored)) || way().usual;

  const apply = () => {
    const { property, least, size, orientation } = way();
    if (!size()) return;
    const share = shareWithin(stored(), size(), least);
    document.documentElement.style.setProperty(property, `${Math.round(share * size())}px`);
    divider.setAttribute("aria-orientation", orientation);
    divider.setAttribute("aria-valuenow", String(Math.round(100 * share)));
  };
  const set = (/** @type {number} */ share) => {
    localStorage.setItem(way().stored, String(shareWithin(share, way().size(), way().least)));
    apply();
  };

  divider.addEventListener("pointerdown", (event) => {
    divider.setPointerCapture(event.pointerId);
    shield.hidden = false; // the frame would swallow the pointer
  });
  divider.addEventListener("pointermove", (event) => {
    if (divider.hasPointerCapture(event.pointerId)) set(way().at(event) / way().size());
  });
  divider.addEventListener("lostpointercapture", () => (shield.hidden = true));
  divider.addEventListener("dblclick", () => set(way().usual));
  divider.addEventListener("keydown", (event) => {
    const by = /** @type {Record<string, number>} */ (way().keys)[event.key];
    if (by === undefined) return;
    set(stored() + by);
    taken(event);
  });
  layout.arranged = apply;
  new ResizeObserver(apply).observe(split);
}
