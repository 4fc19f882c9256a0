// Both sides of the item: the garment turned over, and both beside one another.

import { PagePart } from "../page/page.js";
import { mirrored } from "./seen.js";
import { byId, make, rebuild, values } from "../page/dom.js";
import { cm2, floatingOf, number } from "../page/format.js";

/** @type {SideName[]} */
const SHEETS = ["this", "other"];

export class BothSides extends PagePart {
  turnsOnceKnown = false;
  actions = { turn_over: () => this.turnOver(), beside: () => this.toggleBeside() };
  section = byId("both-sides");
  chip = byId("side-chip");

  around() {
    return this.behind.flat();
  }

  get other() {
    return this.page.state?.other ?? null;
  }

  get pressed() {
    return { turn_over: this.canvas.side === "other", beside: this.canvas.beside.wanted };
  }

  update(/** @type {State} */ state) {
    this.section.hidden = !this.other || !state.layers;
    if (!this.other?.layers && this.canvas.side === "other") this.turn("this");
    if (this.other?.layers && this.turnsOnceKnown) {
      this.turnsOnceKnown = false;
      this.turn("other");
    }
    this.chip.hidden = this.canvas.side === "this" || this.page.hasCamera;
    if (this.other && !this.section.hidden) this.show(this.other);
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
    const { angle } = canvas.transform;
    page.each("turned", side);
    // What was up stays up.
    page.looking.turn((2 * Math.PI - angle) % (2 * Math.PI));
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
    const { list, isBehind } = this.page.doubts;
    rebuild(byId("both-about"), [other, list.length, isBehind], () => [
      this.progress(other),
      other.layers && this.areas(other.layers, other),
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
  areas(layers, { is_related }) {
    const floating = floatingOf(layers);
    const joined = this.page.doubts.list.filter((doubt) => doubt.kind === "seam" && !doubt.is_apart);
    const length = this.page.doubts.isBehind ? null : joined.reduce((sum, seam) => sum + seam.length_mm, 0) / 10;
    return values(
      ["Other side", cm2(layers.area_cm2), "Cloth of the other side, without its floating pieces"],
      floating.pieces.length && ["Its floating", cm2(floating.area_cm2)],
      ["Joined", is_related ? `${number(length, 0)} cm of seams` : "by no seam", "Length of the seams that join"],
    );
  }

  // --- over the flattened view and the scene: the side behind, and the seams ---------------------

  drawOver(/** @type {Pen} */ pen) {
    for (const loop of this.behind) pen.loop(loop, "--seam", 1.5, { rim: 1, dash: [6, 5] });
  }

  /** The outline of each sheet behind the other one, where that is shown; not while cloth of one is asked about. */
  get behind() {
    const { found, held } = this.page.doubts;
    if (!found || held || !this.other?.is_related || this.page.hasCamera) return [];
    return SHEETS.flatMap((sheet) => {
      const loops = sheet === "this" ? found.other_outline_uv_m : found.this_outline_uv_m;
      return loops.map((loop) =>
        loop.map((uv) => this.canvas.shownAt(sheet, mirrored(uv))).filter((at) => at !== null),
      );
    });
  }
}
