// Both sides of the item: the garment turned over, both beside one another, and the seams that join them.

import { PagePart } from "../page/page.js";
import { mirrored } from "./seen.js";
import { boxOfPoints, nearest } from "../canvas/geometry.js";
import { drawSeamInScene, drawSeams, strokeLoop } from "../canvas/marks.js";
import { words } from "../garment/marks.js";
import { askJson, Fetched } from "../page/connection.js";
import { byId, make, rebuild, swatch, values } from "../page/dom.js";
import { cm2, count, floatingOf, mm, number } from "../page/format.js";

const HIT_PX = 8;
const NEAR_M = 0.08; // from a seam to a point by which it is named
/** @type {SideName[]} */
const SHEETS = ["this", "other"];
const MOST_VIEWS = 6; // that are named for each rim of a seam

/** @typedef {import("../page/messages").SeamInfo} SeamInfo */
/** @typedef {import("../page/messages").SidePlaces} SidePlaces */

export class BothSides extends PagePart {
  name = "bothSides";
  other = /** @type {NonNullable<State["other"]> | null} */ (null);
  /** @type {Fetched<SidePlaces>} */
  fetched = new Fetched(askJson, () => {
    this.canvas.refit();
    this.page.redrawMarks();
    this.page.changed();
  });
  showsSeams = false;
  chosen = /** @type {number | null} */ (null); // of the seams
  turnsOnceKnown = false;
  actions = { turn_over: () => this.turnOver(), beside: () => this.toggleBeside(), seams: () => this.toggleSeams() };
  section = byId("both-sides");
  chip = byId("side-chip");

  constructor(/** @type {import("../page/page").Page} */ page) {
    super(page);
    page.canvas.around.push(() => this.behind.flat());
  }

  get pressed() {
    return { turn_over: this.canvas.side === "other", beside: this.canvas.beside.wanted, seams: this.showsSeams };
  }

  get status() {
    const { side, beside } = this.canvas;
    /** Where a place of the other side is on the screen. @param {number} u @param {number} v */
    const toScreen = (u, v) => this.canvas.toScreen(...(this.canvas.shownAt("other", [u, v]) ?? [NaN, NaN]));
    const { places, chosen } = this;
    return { side, beside: Boolean(beside.picture.shown), seams: this.showsSeams, chosen, places, toScreen };
  }

  update(/** @type {State} */ state) {
    this.other = state.other ?? null;
    this.section.hidden = !this.other || !state.layers;
    const revision = this.other?.layers && this.other.revision;
    if (this.fetched.want(revision ? `other/${revision}/places.json` : null)) this.chosen = null;
    if (!this.other?.layers && this.canvas.side === "other") this.turn("this");
    if (this.other?.layers && this.turnsOnceKnown) {
      this.turnsOnceKnown = false;
      this.turn("other");
    }
    if ((this.chosen ?? 0) >= (this.other?.seams.length ?? 0)) this.chosen = null;
    this.chip.hidden = this.canvas.side === "this" || this.page.hasCamera;
    if (this.other && !this.section.hidden) this.show(this.other);
  }

  /** Outlines and seams; null until they are known. */
  get places() {
    return this.fetched.value;
  }

  // --- turned over -------------------------------------------------------------------------------

  /** Turn the garment over, as one turns a shirt on a table; ask for the other side if it is not known. */
  turnOver() {
    if (this.canvas.side === "other") return this.turn("this");
    if (this.isKnown("turn")) this.turn("other");
  }

  turn(/** @type {SideName} */ side) {
    const { canvas, page } = this;
    if (canvas.side === side) return;
    canvas.side = side;
    const { angle, flipped } = canvas.transform;
    page.each("turned", side);
    // What was up stays up.
    page.looking.turn((2 * Math.PI - angle) % (2 * Math.PI), flipped);
    page.changed();
  }

  /** Whether the other side is known; if not, it is asked for, and `then` is what it is for. */
  isKnown(then = "") {
    if (!this.other) this.page.notify("info", `The method ${this.page.state.method} has one side only.`);
    else if (!this.page.state.layers) this.page.notify("info", "Nothing is flattened yet.");
    else if (!this.other.layers) {
      this.turnsOnceKnown = then === "turn";
      if (!this.other.working) this.page.send({ type: "other_side" });
      this.page.notify("info", "The other side is being computed; it is shown when it is known.");
    }
    return Boolean(this.other?.layers);
  }

  toggleBeside() {
    const { beside } = this.canvas;
    beside.wanted = !beside.wanted;
    if (beside.wanted) this.turn("this");
    if (beside.wanted) this.isKnown();
    this.page.changed();
    this.canvas.fit();
  }

  // --- the panel ---------------------------------------------------------------------------------

  show(/** @type {NonNullable<State["other"]>} */ other) {
    const { thisSide } = this.page;
    rebuild(this.section, ["both"], () => [
      make("h2", "Both sides"),
      this.page.group("Sides, shown", ["beside", "seams", "joints"]),
      make("div#both-about"),
    ]);
    const points = thisSide.garment?.found?.points;
    rebuild(byId("both-about"), [other, this.showsSeams, this.chosen, this.places, points], () => [
      this.progress(other),
      other.layers && this.areas(other.layers, other),
      this.showsSeams && this.places && this.seams(other, namesOf(this.places, points ?? [])),
    ]);
  }

  progress(/** @type {NonNullable<State["other"]>} */ { working, progress, text, layers }) {
    if (!working) return !layers && make("p.note", { role: "status" }, text);
    const stage =
      progress?.text ?? (layers ? "The other side is joined again." : "The other side waits for its turn.");
    return make(
      "div.both-progress",
      { role: "status" },
      make("p.note", layers && !progress ? stage : `Other side: ${stage}`),
      make("progress", { max: 1, value: progress?.share ?? 0, label: "Progress of the other side" }),
    );
  }

  /** @param {NonNullable<State["layers"]>} layers @param {NonNullable<State["other"]>} other */
  areas(layers, { is_related, seams }) {
    const floating = floatingOf(layers);
    const joined = seams.filter((seam) => !seam.why);
    const length = joined.reduce((sum, seam) => sum + seam.length_mm, 0) / 10;
    return values(
      ["Other side", cm2(layers.area_cm2), "Cloth of the other side, without its floating pieces"],
      floating.pieces.length && ["Its floating", cm2(floating.area_cm2)],
      ["Joined", is_related ? `${number(length, 0)} cm of seams` : "by no seam", "Length of the seams that join"],
    );
  }

  // --- the seams ---------------------------------------------------------------------------------

  toggleSeams() {
    this.showsSeams = !this.showsSeams;
    if (this.showsSeams) this.isKnown();
    else this.chosen = null;
    this.page.changed();
    this.page.redrawMarks();
  }

  seams(/** @type {NonNullable<State["other"]>} */ other, /** @type {string[]} */ names) {
    if (!other.seams.length) return make("p.note", "No rims of both sides meet.");
    return [
      make("h3", count(other.seams.length, "seam")),
      make("ul.seams", ...other.seams.map((seam, n) => this.row(seam, n, names[n], other.working))),
    ];
  }

  /** @param {SeamInfo} seam @param {number} n @param {string} name @param {boolean} working */
  row(seam, n, name, working) {
    const on = n === this.chosen;
    const color = on ? "var(--accent)" : seam.why ? "var(--warn)" : "var(--seam)";
    return make(
      "li",
      make(
        "button.button.seam",
        {
          pressed: on,
          key: `seam-${n}`,
          tip: `Between piece ${seam.this_piece} of this side and ${seam.other_piece} of the other. Click: show it.`,
          click: () => this.choose(on ? null : n),
        },
        swatch(color),
        make("b", name),
        make("small", `${number(seam.length_mm / 10, 0)} cm, ${seam.why ? "does not join" : "joins"}`),
      ),
      on && this.detail(seam, n, working),
    );
  }

  /** What speaks for a seam, and the decision about it. */
  detail(/** @type {SeamInfo} */ seam, /** @type {number} */ n, /** @type {boolean} */ working) {
    const decided = { cut: "You cut it.", keep: "You kept it." };
    return make(
      "div.seam-detail",
      { role: "group", label: `Seam ${n + 1}` },
      values(
        ["Places", String(seam.places), "Places where the rims of both sides meet"],
        [
          "Residual",
          `${mm(seam.residual_mm[0])} · ${mm(seam.residual_mm[1])}`,
          "How far apart one motion leaves the places: median, and nine tenths are below",
        ],
      ),
      this.views("This rim", seam.this_views, n),
      this.views("Other rim", seam.other_views, n),
      seam.decided
        ? make("p.note", decided[seam.decided])
        : seam.why && make("p.note", `It joins nothing: ${seam.why}.`),
      make("div.group", this.decide("Cut", false, seam, n, working), this.decide("Keep", true, seam, n, working)),
    );
  }

  views(/** @type {string} */ title, /** @type {number[]} */ views, /** @type {number} */ n) {
    const more = views.length - MOST_VIEWS;
    return make(
      "div.chips",
      make("span", `${title}: `),
      ...views.slice(0, MOST_VIEWS).map((view) => this.page.turnTo(view, `seam-${n}-${title}-${view}`, String(view))),
      more > 0 && make("span", `and ${more} more`),
    );
  }

  /** @param {string} title @param {boolean} keep @param {SeamInfo} seam @param {number} n @param {boolean} working */
  decide(title, keep, seam, n, working) {
    const is = seam.decided === (keep ? "keep" : "cut");
    const tip = keep
      ? "The seam joins both sides, whatever speaks against it."
      : "The seam joins nothing: other parts touch there.";
    const message = /** @type {const} */ ({
      type: "decide_seam",
      revision: this.other?.revision ?? 0,
      index: n,
      keep,
    });
    const about = { pressed: is, key: `seam-${n}-${title}`, label: `${title} seam ${n + 1}` };
    return this.page.decision(title, message, tip, working, about);
  }

  choose(/** @type {number | null} */ seam) {
    this.chosen = seam;
    this.page.changed();
    this.page.redrawMarks();
  }

  /** A click near a seam chooses it, while seams are shown. */
  click(/** @type {number} */ u, /** @type {number} */ v) {
    if (!this.showsSeams || !this.places) return false;
    const seam = this.seamAt(this.canvas.transform.toPane(u, v));
    if (seam === null) return false;
    this.choose(seam);
    return true;
  }

  escape() {
    if (this.chosen === null) return false;
    this.choose(null);
    return true;
  }

  // --- over the flattened view and the scene: the side behind, and the seams ---------------------

  /** The places of a seam on a sheet, in the pane; none where that is not shown. */
  inPane(/** @type {number} */ seam, /** @type {SideName} */ sheet) {
    const { canvas } = this;
    const { this_uv_m, other_uv_m } = /** @type {SidePlaces} */ (this.places).seams[seam];
    return (sheet === "this" ? this_uv_m : other_uv_m).flatMap((uv) => {
      const at = canvas.shownAt(sheet, uv);
      return at ? [canvas.transform.toPane(...at)] : [];
    });
  }

  /** The seam at a place of the pane; null: none is near. */
  seamAt(/** @type {Point} */ at) {
    const seams = this.places?.seams.keys() ?? [];
    return nearest(seams, (seam) => this.everywhere(seam), at, HIT_PX);
  }

  drawOver(/** @type {Context} */ context, /** @type {Style} */ style) {
    const { places, other, showsSeams, chosen } = this;
    if (!places || !other || this.page.hasCamera) return;
    const color = style.getPropertyValue("--seam");
    for (const loop of this.behind) strokeLoop(this.canvas, loop, color, 1.5, { rim: 1, dash: [6, 5] });
    if (!showsSeams) return;
    const seams = other.seams.map(({ why }, n) => ({ at: this.everywhere(n), doubted: Boolean(why) }));
    drawSeams(context, style, seams, chosen);
  }

  /** The places of a seam on both sheets, in the pane. */
  everywhere(/** @type {number} */ seam) {
    return SHEETS.flatMap((sheet) => this.inPane(seam, sheet));
  }

  /** The outline of each sheet behind the other one, where that is shown. */
  get behind() {
    const { places, canvas } = this;
    if (!places || !this.other?.is_related || this.page.hasCamera) return [];
    return SHEETS.flatMap((sheet) => {
      const loops = sheet === "this" ? places.other_outline_uv_m : places.this_outline_uv_m;
      return loops.map((loop) => loop.map((uv) => canvas.shownAt(sheet, mirrored(uv))).filter((at) => at !== null));
    });
  }

  /** @param {Context} context @param {Style} style @param {PlaceInScene} place */
  drawInScene(context, style, place) {
    const { places, chosen, showsSeams } = this;
    if (!places || chosen === null || !showsSeams) return;
    drawSeamInScene(context, style, places.seams[chosen].xyz_m, place);
  }
}

/**
 * Seams by the outermost points of the garment that they come near, else by the side of the shape; of one name in order.
 * @param {SidePlaces} places @param {GarmentPoint[]} points
 */
function namesOf({ seams, this_outline_uv_m }, points) {
  const shape = boxOfPoints(this_outline_uv_m.flat(2));
  const boxes = seams.map(({ this_uv_m }) => boxOfPoints(this_uv_m.flat()));
  const own = seams.map(({ this_uv_m }, n) => {
    const off = points.map(({ uv_m: [u, v] }) => Math.min(...this_uv_m.map(([x, y]) => Math.hypot(x - u, y - v))));
    const near = points.filter((_, k) => off[k] < NEAR_M);
    const apart = (/** @type {GarmentPoint} */ { uv_m }) => Math.hypot(...uv_m.map((x, i) => x - near[0].uv_m[i]));
    const ends = near.length > 1 ? [near[0], near.toSorted((a, b) => apart(b) - apart(a))[0]] : near;
    const side = boxes[n].left - shape.left < shape.right - boxes[n].right ? "left side" : "right side";
    return ends.map(({ name }) => words(name)).join(" to ") || side;
  });
  return own.map((name, n) => {
    const same = [...own.keys()].filter((k) => own[k] === name).sort((a, b) => boxes[a].top - boxes[b].top);
    const parts = same.length === 2 ? ["upper part", "lower part"] : same.map((_, k) => `part ${k + 1} from above`);
    return same.length > 1 ? `${name}, ${parts[same.indexOf(n)]}` : name;
  });
}
