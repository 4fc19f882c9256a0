// What is in doubt about the shape, as one list: joints that hold its parts, floating pieces, seams of both sides. What
// holds each, on both pictures; where its cloth may lie, shown and moved by hand; and the decision about it.

import { PagePart } from "../page/page.js";
import { applied, boxOf, cornersOf, inBox, nearest } from "../canvas/geometry.js";
import { fitOf, holds, joiningText, overlapAt, overlapOfProposal, shapeOf } from "../canvas/overlap.js";
import { drawCaption, drawMoved, drawPieces } from "../canvas/pieces.js";
import { Pyramid } from "../canvas/pyramid.js";
import { askJson, Fetched } from "../page/connection.js";
import { byId, heading, make, rebuild, setText, smallButton, swatch } from "../page/dom.js";
import { cm2, mm, number, percent } from "../page/format.js";

const HIT_PX = 10;
const MOST_ROWS = 8;
const SAME = 1e-6;
const SAME_M = 0.02; // a doubt of a new list so near to one of the old list is the same
const LEAST = 0.005; // what is less probable is shown when it is asked for
const HERE = "Place it here";
const RESTS_MS = 1500; // from a change of the shape until what nobody looks at is asked for
const GROUPS = { joint: "Parts on weak joints", piece: "Floating pieces", seam: "Seams of both sides" };
const QUESTIONS = {
  joint: "Where does this part lie?",
  piece: "Where does this piece belong?",
  seam: "Do both sides meet here?",
};

export class DoubtsPanel extends PagePart {
  name = "doubts";
  /** @type {Fetched<DoubtsInfo>} */
  fetched = new Fetched(askJson, () => this.take());
  found = /** @type {DoubtsInfo | null} */ (null); // the last list, also while the next one is on its way
  chosen = /** @type {number | null} */ (null);
  at = 0; // which of its choices is shown; -1: another place
  grabbed = /** @type {number | null} */ (null); // a floating piece under the pressed pointer
  later = false; // it was dropped, or decided about, before the list of the present shape was there
  notice = ""; // about the place that was clicked
  rests = { revision: /** @type {number | null} */ (null), timer: 0 };
  fitted = { key: "", text: "" };
  wasShown = false;
  drawn = /** @type {Piece[]} */ ([]);
  actions = { doubts: () => this.toggle(), doubt_next: () => this.next(), doubt_decide: () => this.decide() };
  section = byId("doubts");

  constructor(/** @type {Page} */ page) {
    super(page);
    page.doubts = this;
  }

  sourceMarks(/** @type {number} */ view) {
    return this.doubt?.views.find(({ view_index }) => view_index === view)?.rc ?? [];
  }

  around() {
    const { doubt, held } = this;
    const pieces = this.drawn.flatMap(({ placed, grid }) => (placed ? [] : cornersOf(boxOf(grid))));
    const choices = held && doubt ? doubt.choices : [];
    return [
      ...pieces,
      ...choices.flatMap((choice) => loopsAt(/** @type {Doubt} */ (doubt), motionOf(choice)).flat()),
    ];
  }

  get list() {
    return this.found?.doubts ?? [];
  }

  /** What is chosen, while the list is in sight, or a piece is dragged. */
  get doubt() {
    const n = this.grabbed ?? (this.shown ? this.chosen : null);
    return n === null ? null : (this.list[n] ?? null);
  }

  /** What is shown of it, unless it was moved to another place. */
  get choice() {
    return this.doubt?.choices[this.at];
  }

  get shown() {
    return !this.section.hidden && this.page.column.part === "doubts";
  }

  get pressed() {
    return { doubts: this.shown };
  }

  toggle() {
    const { column } = this.page;
    column.choose(this.shown ? column.usual : "doubts");
  }

  /** Bring what is chosen into sight. */
  bring() {
    if (this.shown) document.querySelector(".doubt-detail")?.parentElement?.scrollIntoView({ block: "nearest" });
  }

  update(/** @type {State} */ state) {
    const { thisSide } = this.page;
    this.section.hidden = !state.layers || this.page.hasCamera;
    if (thisSide.doubts === null) this.found = this.chosen = null;
    if (state.phase === "finished" || this.shown || this.grabbed !== null) this.want();
    else if (thisSide.doubts !== this.rests.revision && (thisSide.layers?.pieces.length || thisSide.other?.layers)) {
      clearTimeout(this.rests.timer);
      this.rests = { revision: thisSide.doubts, timer: setTimeout(() => this.want(), RESTS_MS) };
    }
    if (this.section.hidden) return;
    if (this.held && this.doubt && !this.canvas.isMoved) this.canvas.center = this.doubt.pivot_uv_m;
    const shown = [this.found, this.chosen, this.at, this.notice, this.isBehind, state.layers?.pieces];
    rebuild(this.section, shown, () => this.build());
    this.showFit();
    if (this.shown && !this.wasShown) this.bring();
    this.wasShown = this.shown;
  }

  /** Ask what is in doubt about the shape; true: not known yet. */
  want() {
    const { doubts } = this.page.thisSide;
    this.fetched.want(doubts === null ? null : `doubts/${doubts}.json`);
    return this.found === null;
  }

  /** A new list: what was chosen stays so, or is decided now if that was asked for; else the weakest is chosen. */
  take() {
    const [before, title, { later, grabbed, canvas }] = [this.doubt, this.choice?.title, this];
    this.found = this.fetched.value;
    const offs_m = this.list.map((doubt) => (before ? apartOf(doubt, before) : Infinity));
    const same = offs_m.findIndex((off_m) => off_m < SAME_M && off_m === Math.min(...offs_m));
    const weak = this.list.findIndex((doubt) => doubt.weak);
    const at = this.list[same]?.choices.findIndex((choice) => choice.title === title) ?? -1;
    if (grabbed !== null) this.grabbed = same >= 0 ? same : null;
    if (same >= 0 && canvas.isMoved) Object.assign(this, { chosen: same, at, later: false });
    else this.choose(same >= 0 ? same : weak >= 0 ? weak : null);
    if (at > 0 && !canvas.isMoved) this.look(at);
    if (later && same >= 0 && this.choice?.title === title) this.decide();
    if (later && !this.later) this.grabbed = null;
  }

  /** Whether the list is not of the shape that is shown. */
  get isBehind() {
    const { drawing, doubts } = this.page.thisSide;
    return drawing || this.found?.revision !== doubts;
  }

  /** The shape and its joints as the teaching mode shows them; null until they are known. @returns {ShapeLesson | null} */
  get lesson() {
    const { thisSide } = this.page;
    const { shown } = this.canvas.layer;
    if (this.want() || !shown || !thisSide.layers || this.canvas.side === "other") return null;
    return {
      picture: { shape: shown.image instanceof Pyramid ? shown.image.at(1) : shown.image },
      grid: shown.grid,
      joints: this.list.filter(({ kind }) => kind === "joint"),
      seams: this.list.filter(({ kind }) => kind === "seam"),
      outlines: [this.found?.this_outline_uv_m ?? [], this.found?.other_outline_uv_m ?? []],
      area_cm2: thisSide.layers.area_cm2,
      views: thisSide.step,
    };
  }

  /** What most doubtful cloth hangs on, or where it belongs, in words; "": nothing is doubtful; null: that is not known. */
  get told() {
    if (!this.found || this.isBehind || this.found.trouble) return null;
    const doubt = this.list.find(({ weak }) => weak);
    if (!doubt) return "";
    const { kind, title, area_cm2, probability } = doubt;
    const share = percent(placeOf(doubt)?.probability ?? 0);
    if (kind === "piece") return `The garment has a place for piece ${title}, ${cm2(area_cm2)} (${share} sure)`;
    return `${cm2(area_cm2)} hang on one joint that is right with a probability of ${number(100 * probability, 1)} %`;
  }

  /** What is asked about what is chosen. */
  get question() {
    const { doubt, decision } = this;
    const moves = this.held ? ", or drag its ring or its cross" : "";
    return doubt ? `${QUESTIONS[doubt.kind]} ${decision} (A), show the next choice (.)${moves}.` : "";
  }

  // --- the panel ---------------------------------------------------------------------------------

  build() {
    const { found, list, isBehind } = this;
    const kinds = /** @type {(keyof typeof GROUPS)[]} */ (Object.keys(GROUPS));
    return [
      heading("Doubts"),
      (!found || isBehind) &&
        make("p.note", { role: "status" }, `Looking for what is in doubt${found ? " about the new shape" : ""} …`),
      found?.trouble && make("p.note", found.trouble),
      found &&
        !list.length &&
        make("p.note", "Nothing is in doubt: no part hangs on little evidence, and none floats."),
      list.length > 0 &&
        make("p.note", "Why it is joined, or not. Click cloth to ask about it; drag a floating piece."),
      this.notice && make("p.note", { role: "status" }, this.notice),
      ...kinds.map((kind) => this.group(kind)),
    ];
  }

  group(/** @type {keyof typeof GROUPS} */ kind) {
    const rows = this.list.flatMap((doubt, n) => (doubt.kind === kind ? [this.row(doubt, n)] : []));
    return rows.length > 0 && [make("h3", `${GROUPS[kind]}: ${rows.length}`), make("ul", ...rows)];
  }

  row(/** @type {Doubt} */ doubt, /** @type {number} */ n) {
    const on = n === this.chosen;
    const color = this.pieceOf(doubt)?.color ?? (doubt.weak || doubt.is_apart ? "var(--warn)" : "var(--seam)");
    return make(
      "li",
      make(
        "button.button.small.doubt",
        { pressed: on, key: `doubt-${n}`, click: () => this.open(on ? null : n) },
        swatch(on ? "var(--accent)" : color),
        make("b", doubt.title),
        make("small", doubt.said),
      ),
      on && this.detail(doubt),
    );
  }

  /** What may be true with the decision about it, and what holds it. */
  detail(/** @type {Doubt} */ doubt) {
    const most = doubt.views.slice(0, MOST_ROWS);
    const isHeld = most.some(({ places }) => places > 0);
    return make(
      "div.doubt-detail",
      { role: "group", label: doubt.title },
      doubt.choices.length > 0 && this.choices(doubt),
      make("p.note", doubt.note),
      make(
        "table",
        isHeld && make("tr", ...["View", "Places", "Residual"].map((text) => make("th", { scope: "col" }, text))),
        ...most.map((view) => this.view(view, isHeld)),
      ),
      doubt.views.length > MOST_ROWS && make("p.note", `and ${doubt.views.length - MOST_ROWS} more`),
    );
  }

  choices(/** @type {Doubt} */ { choices }) {
    const row = (/** @type {Choice} */ choice, /** @type {number} */ n) =>
      make(
        "button.button.small.doubt",
        { pressed: n === this.at, key: `choice-${n}`, click: () => this.look(n) },
        choice.title,
        make("small", shareOf(choice)),
      );
    const decide = this.page.smallButton("doubt_decide", choices[this.at]?.decide ?? HERE);
    decide.classList.toggle("primary", this.at !== 0);
    return [
      make("div.choices", { role: "group", label: "What may be true" }, ...choices.map(row)),
      make("p#doubt-fit.note", { role: "status" }),
      make("div.group", decide, choices.length > 1 && this.page.smallButton("doubt_next")),
    ];
  }

  /** @param {Doubt["views"][number]} view @param {boolean} isHeld */
  view({ view_index, angle_deg, places, residual_mm, rc }, isHeld) {
    const show = () =>
      rc.length
        ? this.page.each("lookAt", view_index, rc[Math.floor(rc.length / 2)])
        : this.page.send({ type: "turn_to", view_index });
    const button = smallButton(`${view_index} · ${number(angle_deg, 0)}°`, show, {
      key: `doubt-view-${view_index}`,
      tip: "Show it in this view's source image, and the item from there.",
    });
    return make("tr", make("td", button), isHeld && [make("td", String(places)), make("td", mm(residual_mm))]);
  }

  // --- what may be true --------------------------------------------------------------------------

  /** Choose one, or none, with a notice about the place that was clicked. */
  choose(/** @type {number | null} */ chosen, notice = "") {
    Object.assign(this, { chosen, notice, at: 0, later: false });
    if (!this.page.state?.pending) this.canvas.resetPreview();
    this.page.changed();
    this.bring();
    this.page.redrawMarks();
    this.canvas.refit();
  }

  /** Choose one, and show its side of the item. */
  open(/** @type {number | null} */ n) {
    const { side, beside } = this.canvas;
    const { kind, side: own } = this.list[n ?? -1] ?? { kind: "seam" };
    if (kind !== "seam" && own !== side && !beside.wanted) this.page.actionOf("turn_over")?.(false);
    this.choose(n);
  }

  /** Whether a key decides about it. */
  get asks() {
    return Boolean(this.doubt?.choices.length && !this.page.state.pending);
  }

  /** What the handles hold: the cloth of what is chosen, unless something else is being decided. */
  get held() {
    const { doubt, canvas } = this;
    if (!doubt?.outline_uv_m.length || !this.asks || this.page.hasCamera || canvas.side === "other") return null;
    const hasPlace = (/** @type {Choice} */ { how }) => doubt.kind === "joint" || how === "place";
    const likely = doubt.choices.filter((choice) => hasPlace(choice) && (choice.probability ?? 0) >= LEAST);
    /** @type {Held} */
    const held = {
      arm: doubt.arm_uv_m,
      ghosts: likely.map((choice) => {
        return { title: `${choice.title} ${shareOf(choice)}`, motion: motionOf(choice), at: doubt.arm_uv_m };
      }),
      draw: (by) => this.drawAt(doubt, by),
    };
    return held;
  }

  /** Show one of the choices. */
  look(/** @type {number} */ n) {
    const { doubt, canvas, held } = this;
    if (!doubt) return;
    Object.assign(this, { at: n, later: false });
    if (held) canvas.preview = canvas.byOf(motionOf(doubt.choices[n]));
    canvas.redraw();
    this.page.changed();
    this.bring();
  }

  next() {
    if (!this.doubt && this.shown && this.list.length) return this.open(0);
    if (!this.asks || !this.doubt) return this.page.notify("info", "Choose what is in doubt first: Doubts.");
    this.look((this.at + 1) % this.doubt.choices.length);
  }

  /** What deciding for what is shown means. */
  get decision() {
    return this.choice?.decide ?? HERE;
  }

  decide() {
    const { doubt, found, canvas, page } = this;
    const index = this.grabbed ?? this.chosen;
    if (!doubt || !found || index === null) return;
    if (page.state.pending && doubt.kind !== "seam") return page.notify("info", "Decide about the proposal first.");
    this.later = this.isBehind;
    if (this.later) {
      this.want();
      return page.notify("info", "The shape is being drawn; this is decided once it is there.");
    }
    const how = this.choice?.how ?? (doubt.kind === "piece" ? "hand" : "place");
    const place = this.choice ? motionOf(this.choice) : canvas.motion;
    page.send({ type: "decide", revision: found.revision, index, how, place });
    if (how !== "hand") this.choose(doubt.kind === "seam" ? index : null); // the next one is asked about then
  }

  /** It is moved by hand. */
  moving() {
    const { doubt, held, canvas } = this;
    if (!doubt || !held) return;
    if (this.grabbed !== null) this.chosen = this.grabbed;
    this.at = doubt.choices.findIndex((choice) =>
      motionOf(choice).every((x, n) => Math.abs(x - canvas.motion[n]) < SAME),
    );
    this.page.changed();
  }

  /** How the cloth fits where it is shown; found once for each place. */
  get fit() {
    const { doubt, canvas, choice, page } = this;
    if (!doubt?.outline_uv_m.length || ["cut", "hand"].includes(choice?.how ?? "")) return "";
    if (choice?.std_mm) return `This place of the garment is known to ± ${mm(choice.std_mm, 0)}.`;
    const key = `${canvas.layer.shown?.address} ${doubt.title} ${canvas.motion}`;
    if (this.fitted.key !== key) {
      const colorAt = page.layer === "color" ? canvas.layer.colorAt : null;
      const text =
        doubt.kind === "joint"
          ? fitOf(doubt, canvas.motion, shapeOf(page), colorAt)
          : joiningText(overlapAt(doubt, canvas.motion, (u, v) => canvas.layer.covers(u, v), shapeOf(page)));
      this.fitted = { key, text };
    }
    return this.fitted.text;
  }

  showFit() {
    const box = document.getElementById("doubt-fit");
    if (box) setText(box, this.fit);
  }

  // --- on the cloth ------------------------------------------------------------------------------

  /** Whether a press at a place of the plane takes hold of a floating piece. */
  grabs(/** @type {number} */ u, /** @type {number} */ v) {
    const { canvas, page } = this;
    if (page.state.pending || page.brush.side || canvas.side === "other" || !canvas.layer.covers(u, v)) return false;
    const piece = this.drawn.find((one) => !one.placed && inBox(boxOf(one.grid), u, v));
    const n = piece ? this.list.findIndex(({ kind, title }) => kind === "piece" && title === piece.label) : -1;
    if (n < 0) return false;
    if (n !== this.chosen) canvas.resetPreview();
    this.grabbed = n;
    canvas.center = this.list[n].pivot_uv_m;
    return true;
  }

  /** The pointer is let go: what floats is decided about where it was dropped. */
  dropped(/** @type {boolean} */ moved) {
    if (moved && this.doubt?.kind === "piece") this.decide();
    if (!this.later) this.grabbed = null;
  }

  /** A click asks about the cloth there. */
  click(/** @type {number} */ u, /** @type {number} */ v) {
    if (!this.shown || !this.found || this.page.state.pending) return false;
    const { list, canvas } = this;
    const { sheet, u_m, v_m } = canvas.located(u, v);
    const holding = list.filter((doubt) => doubt.side === sheet && holds(doubt, u_m, v_m));
    holding.sort((a, b) => a.area_cm2 - b.area_cm2);
    const found = nearest(list, (doubt) => this.marksOf(doubt), canvas.transform.toPane(u, v), HIT_PX) ?? holding[0];
    if (!found && sheet === "other") return false;
    const none = "This cloth belongs to the largest part: nothing within it is joined by little evidence.";
    this.choose(found ? list.indexOf(found) : null, found ? "" : none);
    return true;
  }

  escape() {
    if (!this.shown) return false;
    if (this.asks && (this.canvas.isMoved || this.at)) this.choose(this.chosen);
    else if (this.chosen !== null) this.choose(null);
    else return false;
    return true;
  }

  /** Where it holds, in the pane: on the sides that are shown. */
  marksOf = (/** @type {Doubt} */ { this_uv_m, other_uv_m }) => {
    const { canvas } = this;
    const on = (/** @type {SideName} */ side, /** @type {UV[]} */ places) =>
      places.map((uv) => canvas.shownAt(side, uv)).filter((uv) => uv !== null);
    return [...on("this", this_uv_m), ...on("other", other_uv_m)].map(canvas.pen.at);
  };

  pieceOf(/** @type {Doubt} */ { kind, side, title }) {
    const { layers, other } = this.page.thisSide;
    const pieces = (side === "this" ? layers : other?.layers)?.pieces;
    return kind === "piece" ? pieces?.find(({ label }) => label === title.split(",")[0]) : undefined;
  }

  drawOver(/** @type {Pen} */ pen) {
    const { canvas, doubt, list } = this;
    const { state } = this.page;
    if (!state || this.page.hasCamera) return;
    // Those of the picture that is shown; that of the present state may be on its way.
    if (canvas.layerRevision === state.layers?.revision) this.drawn = state.layers.pieces;
    if (canvas.side === "this") this.drawPlaces();
    const chosenOn = (/** @type {SideName} */ side) => (doubt?.side === side && this.pieceOf(doubt)?.label) || null;
    const floating = this.drawn.filter(({ placed }) => !placed);
    drawPieces(canvas, floating, chosenOn(canvas.side));
    const { motion } = canvas.beside;
    const others = this.page.thisSide.other?.layers?.pieces ?? [];
    if (motion) drawPieces(canvas, others, chosenOn("other"), motion);
    if (canvas.overlay.shown && canvas.gesture && canvas.isMoved)
      drawCaption(canvas, joiningText(overlapOfProposal(this.page) ?? 0));
    if (doubt && this.held && canvas.isMoved) {
      drawMoved(canvas, doubt.outline_uv_m, canvas.motion);
      if (canvas.gesture && this.fit) drawCaption(canvas, this.fit);
    }
    if (!this.shown) return;
    if (doubt) this.drawAt(doubt, [0, 0, 0], "--accent");
    list.forEach((each, n) => {
      const at = this.marksOf(each);
      if (n === this.chosen) for (const one of at) pen.dot(one, "--accent", 3.5);
      else if (!this.held) pen.squares(at, each.weak || each.is_apart ? "--warn" : "--seam", 4);
    });
  }

  /**
   * Where pieces lie by the garment, if that is known better than their size and nothing else is asked about; and where
   * one comes to lie that goes along with the proposal.
   */
  drawPlaces() {
    for (const doubt of this.held || this.isBehind ? [] : this.list) {
      const piece = this.pieceOf(doubt);
      const there = placeOf(doubt);
      const { probability, std_mm } = there ?? {};
      const isOpen = doubt.choices.some(({ how }) => how === "cut") && (probability ?? 0) > 0.5;
      const isKnown = isOpen && (std_mm ?? Infinity) < 1000 * Math.hypot(...doubt.arm_uv_m);
      if (!piece || !(piece.placed || isKnown)) continue;
      const motion = piece.placed || !there ? [0, 0, 0] : motionOf(there);
      for (const loop of loopsAt(doubt, /** @type {Motion} */ (motion)))
        this.canvas.pen.loop(loop, piece.color, 1.5, { dash: piece.placed ? [] : [5, 4] });
    }
    const { brings } = this.page.state.pending ?? {};
    const piece = brings && this.drawn.find(({ label }) => label === brings.label);
    if (!piece) return;
    const { theta_rad, u_m, v_m } = brings.placement;
    const corners = cornersOf(boxOf(piece.grid)).map(([u, v]) => applied([theta_rad, u_m, v_m], u, v));
    this.canvas.pen.loop(corners, piece.color, 2.5, { dash: [2, 3] });
  }

  /** The outline of its cloth, moved by so much. @param {Doubt} doubt @param {Motion} by */
  drawAt(doubt, by, color = "--warn") {
    for (const loop of loopsAt(doubt, by)) {
      const shown = loop.map((uv) => this.canvas.shownAt(doubt.side, uv)).filter((uv) => uv !== null);
      this.canvas.pen.loop(shown, color, 2, { rim: 1.5, dash: [6, 4] });
    }
  }

  drawInScene(/** @type {Pen} */ pen, /** @type {PlaceInScene} */ place) {
    if (!this.doubt) return;
    pen.squares(this.doubt.part_xyz_m.map(place), "--warn");
    for (const at of this.doubt.seam_xyz_m.map(place)) if (at) pen.dot(at, "--accent", 3);
  }
}

/** @returns {Motion} */
export const motionOf = (/** @type {Choice} */ { placement: { theta_rad, u_m, v_m } }) => [theta_rad, u_m, v_m];

/** The outlines of its cloth, moved by so much. @param {Doubt} doubt @param {Motion} by */
export const loopsAt = ({ outline_uv_m }, by) => outline_uv_m.map((loop) => loop.map(([u, v]) => applied(by, u, v)));

/** How far apart the places of the item are that two doubts are about. @param {Doubt} a @param {Doubt} b */
function apartOf(a, b) {
  const [p, q] = [a, b].map(({ seam_xyz_m, part_xyz_m }) => (seam_xyz_m.length ? seam_xyz_m : part_xyz_m));
  const off_m = [0, 1, 2].map((axis) => mean(p.map((at) => at[axis])) - mean(q.map((at) => at[axis])));
  return a.kind === b.kind && a.side === b.side ? Math.hypot(...off_m) : Infinity;
}

const mean = (/** @type {number[]} */ all) => all.reduce((sum, one) => sum + one, 0) / all.length;

const placeOf = (/** @type {Doubt} */ { choices }) => choices.find(({ how }) => how === "place");

const shareOf = (/** @type {Choice} */ { probability }) => (probability === null ? "" : percent(probability));
