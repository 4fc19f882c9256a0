// A, the shape, and B, the proposal on it: both, each alone, blinking, or their difference.

import { PagePart } from "../page/page.js";
import { byId, make, rebuild, showWords, swatch } from "../page/dom.js";
import { degrees, mm, number, vector } from "../page/format.js";
import { Picture } from "./picture.js";

const BLINK_MS = 450;
const PALE = 0.25;
const OPACITY = 0.7; // of the proposal on the shape

/** Actions, and the mode that each means. */
const MODES = {
  compare_shape: "shape",
  compare_proposal: "proposal",
  blink: "blink",
  compare_difference: "difference",
};
const KINDS = ["color", "height", "position"];

/** Paints the flattened view. */
export class Comparison extends PagePart {
  name = "comparison";
  /** @type {NonNullable<Panel["actions"]>} */
  actions = Object.fromEntries(Object.entries(MODES).map(([name, mode]) => [name, () => this.choose(mode)]));
  mode = "both";
  kind = "color";
  showsProposal = true;
  legends = /** @type {Record<string, Legend> | null} */ (null);
  timer = 0; // of blinking
  heat = new Picture(() => this.canvas.redraw());
  chip = byId("compare-chip");

  get proposal() {
    return this.canvas.overlay.shown;
  }

  /** Choose a mode; the same again goes on to the next difference, then back to both. */
  choose(/** @type {string} */ mode) {
    const isAgain = mode === this.mode;
    const other = KINDS[KINDS.indexOf(this.kind) + 1];
    if (mode === "difference") this.kind = (isAgain && other) || KINDS[0];
    this.setMode(isAgain && !(mode === "difference" && other) ? "both" : mode);
  }

  setMode(/** @type {string} */ mode) {
    this.mode = mode;
    clearInterval(this.timer);
    this.showsProposal = true;
    if (mode === "blink") {
      this.timer = setInterval(() => {
        this.showsProposal = !this.showsProposal;
        if (this.proposal) this.canvas.redraw();
      }, BLINK_MS);
    }
    this.page.changed();
  }

  get pressed() {
    return Object.fromEntries(Object.entries(MODES).map(([name, mode]) => [name, mode === this.mode]));
  }

  /** Take a state; the difference is fetched while it is looked at. */
  update(/** @type {State} */ state) {
    const overlay = state.pending ? state.layers?.overlay : null;
    this.legends = overlay?.differences ?? null;
    if (overlay && this.mode === "difference") {
      const address = `difference/${state.layers?.revision}-${overlay.revision}/${this.kind}.png`;
      this.heat.show(address, overlay.revision, overlay, false);
    } else {
      this.heat.clear();
    }
    const view = state.pending?.view_index;
    const label = { shape: "A: the shape alone", proposal: `B: view ${view} alone` }[this.mode];
    showWords(this.chip, (overlay && label) ?? "");
    this.canvas.redraw();
  }

  hovered(/** @type {HoverAnswer | null} */ answer) {
    showBoth(answer);
  }

  /** Which difference is on the canvas. */
  get shownKind() {
    return this.heat.shown?.address?.includes(`/${this.kind}.png`) ? this.kind : null;
  }

  /** The legend of what is looked at, if it is a difference. */
  get legend() {
    return this.mode === "difference" ? (this.legends?.[this.kind] ?? null) : null;
  }

  // --- painting --------------------------------------------------------------------------------

  paint(/** @type {FlatCanvas} */ canvas) {
    if (!this.proposal) return canvas.drawShape();
    switch (this.mode) {
      case "shape":
        return canvas.drawShape();
      case "proposal":
        return canvas.drawProposal();
      case "difference":
        return this.paintDifference(canvas);
      default:
        canvas.drawShape();
        if (this.showsProposal) canvas.drawProposal(this.mode === "blink" ? 1 : OPACITY, true);
    }
  }

  paintDifference(/** @type {FlatCanvas} */ canvas) {
    const { context } = canvas;
    if (canvas.isMoved || !this.heat.shown) {
      canvas.drawShape();
      return canvas.drawProposal(OPACITY, true);
    }
    context.globalAlpha = PALE;
    canvas.drawShape();
    context.globalAlpha = 1;
    canvas.drawPicture(this.heat.shown, this.heat.shown.image);
    const { proposal } = this;
    if (proposal?.outline) canvas.drawPicture(proposal, proposal.outline);
  }
}

// --- both values under the pointer ---------------------------------------------------------------

const COLUMNS = [
  ["Color", "Red, green, blue; their mean absolute difference"],
  ["Height z", "mm along the axis"],
  ["Z-angle", "At the present rotation, so that both can be compared"],
  ["x y z", "mm, object frame; the distance between both"],
];

/** Show the values of both under the pointer; `answer` without both hides them. */
function showBoth(/** @type {HoverAnswer | null} */ answer) {
  const { shape: a, proposal: b } = answer ?? {};
  const box = byId("readout-both");
  box.classList.toggle("away", !(a && b));
  byId("readout").classList.toggle("away", Boolean(a && b));
  if (!a || !b) return;
  /** @param {"height_mm" | "z_angle_now_deg"} of */
  const change = (of) => {
    const [from, to] = [a[of], b[of]];
    return from === null || to === null ? null : to - from;
  };
  const turn = change("z_angle_now_deg");
  const rows = [
    ["A", coloured(a), number(a.height_mm), degrees(a.z_angle_now_deg), vector(a.xyz_mm)],
    ["B", coloured(b), number(b.height_mm), degrees(b.z_angle_now_deg), vector(b.xyz_mm)],
    [
      "B − A",
      number(colorApart(a, b)),
      number(change("height_mm")),
      degrees(turn === null ? null : ((turn + 540) % 360) - 180),
      `${mm(Math.hypot(...a.xyz_mm.map((x, i) => b.xyz_mm[i] - x)))} apart`,
    ],
  ];
  rebuild(box, [rows.map((r) => r.map(String)), a.rgb, b.rgb], () => [
    make("thead", make("tr", make("td"), ...COLUMNS.map(([title, tip]) => make("th", { scope: "col", tip }, title)))),
    make(
      "tbody",
      ...rows.map(([name, ...cells]) =>
        make("tr", make("th", { scope: "row" }, name), ...cells.map((c) => make("td", c))),
      ),
    ),
  ]);
}

/** Mean absolute difference of red, green and blue. @param {PixelValues} a @param {PixelValues} b */
const colorApart = (a, b) => a.rgb.reduce((sum, x, i) => sum + Math.abs(b.rgb[i] - x), 0) / 3;

const coloured = (/** @type {PixelValues} */ { rgb }) => make("span.swatched", swatch(`rgb(${rgb})`), rgb.join(" "));
