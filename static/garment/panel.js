// The Garment panel: kinds with their probabilities, dimensions, named points; what is decided about them by hand.

import { PagePart } from "../page/page.js";
import { dimensions, pointButton, shares } from "./lists.js";
import { words, drawGarment } from "./marks.js";
import {
  byId,
  choice,
  closeButton,
  field,
  isPlain,
  make,
  rebuild,
  setText,
  smallButton,
  taken,
  WAYS,
} from "../page/dom.js";
import { percent } from "../page/format.js";
import { nearest } from "../canvas/geometry.js";

const NONE = "none of these";
/** An angle within a full turn. */
const full = (/** @type {number} */ angle) => (angle + 2 * Math.PI) % (2 * Math.PI);
const SURE = 0.995; // the line above says it all
const GRAB_PX = 10;

/** @typedef {{ outline_uv_m: UV[]; points: GarmentPoint[] }} Outlined */

export class GarmentPanel extends PagePart {
  name = "garment";
  shown = true; // outline and points on the canvas
  pointed = /** @type {string | null} */ (null); // the name of the point that is pointed at
  finished = false; // whether the finished shape was turned upright
  turnedFrom = /** @type {number | null} */ (null); // how the view was turned before it was turned upright, on the shown side
  upright = 0; // the angle at which the garment that was found last is upright
  moved = /** @type {{ name: string; u: number; v: number } | null} */ (null); // a point that the keys move
  actions = { garment: () => this.toggle(), upright: () => this.toggleUpright() };
  section = byId("garment");
  preview = /** @type {Outlined | null} */ (null); // outline and points while one of them is moved
  grabbed = /** @type {string | null} */ (null); // the name of the point under the pressed pointer
  revision = 0;
  question = this.page.question(
    "garment_preview",
    (id, /** @type {Place & { name: string }} */ about) => this.page.send({ type: "preview_point", id, ...about }),
    (preview) => this.showPreview(preview),
  );

  /** The outline, once the shape is upright; of the first views it may lie anywhere. */
  around() {
    return (this.turnedFrom !== null && this.canvas.side === "this" && this.drawn?.outline_uv_m) || [];
  }

  /** What the server says. */
  get known() {
    return this.page.state?.garment ?? null;
  }

  get found() {
    return this.known?.found ?? null;
  }

  get pressed() {
    return { garment: this.shown, upright: this.turnedFrom !== null };
  }

  update(/** @type {State} */ state) {
    this.keepUpright(state);
    const { known } = this;
    this.section.hidden = !known || !state.layers;
    if (!this.found?.points.some((point) => point.name === this.pointed)) this.pointed = null;
    const revision = known?.revision ?? 0;
    if (revision !== this.revision && !this.grabbed && !this.moved) this.preview = null;
    this.revision = revision;
    this.page.redrawMarks();
    if (known && !this.section.hidden) this.show(known);
  }

  // --- the panel -----------------------------------------------------------------------------------

  show(/** @type {NonNullable<State["garment"]>} */ known) {
    const { found } = known;
    setText(byId("garment-text"), summary(known));
    /** @param {string} part @param {unknown[]} key @param {() => Child} build */
    const show = (part, key, build) => rebuild(byId(`garment-${part}`), key, build);
    const kind = found?.kind;
    byId("garment-tools").hidden = !found;
    show("kinds", [found?.probabilities, kind, found?.by_hand], () => found && this.kinds(found, known.kinds));
    show("points", [kind, found?.points], () => kind && this.points(found));
    show("dimensions", [kind, found?.dimensions], () => kind && dimensions(found));
  }

  kinds(/** @type {FoundGarment} */ found, /** @type {string[]} */ names) {
    const options = [["", "automatic"], ...names.map((name) => [name, words(name)])];
    const select = choice(options, found.by_hand ? (found.kind ?? NONE) : "", {
      key: "garment-kind",
      tip: "The kind of garment. Automatic: by the evidence. A kind set by hand is a decision; Undo takes it back.",
      change: (event) => this.page.send({ type: "garment_kind", kind: event.target.value || null }),
    });
    return [
      (found.by_hand || found.probabilities[0][1] < SURE) && shares(found.probabilities),
      field("Kind", select),
    ];
  }

  points(/** @type {FoundGarment} */ found) {
    const [seen, predicted] = [true, false].map((is) => found.points.filter((point) => point.seen === is));
    const held = found.points.some((point) => point.held);
    const release = smallButton("Release all", () => this.page.send({ type: "release_points" }), {
      key: "release-all",
      tip: "Release all held points: the outline follows the evidence alone again.",
    });
    /** @param {string} title @param {GarmentPoint[]} points @param {Child} more */
    const list = (title, points, more) =>
      points.length > 0 && [
        make("div.heading", make("h3", `${title}: ${points.length}`), more),
        make("ul.named", { label: title }, ...points.map((point) => this.row(point))),
      ];
    return [
      list("Points seen", seen, held && release),
      list("Points predicted", predicted, held && !seen.length && release),
    ];
  }

  row(/** @type {GarmentPoint} */ point) {
    const what = point.seen
      ? "Click: pick it as a grasp."
      : "No view shows cloth there, so it cannot be grasped yet.";
    return make(
      "li",
      { class: point.seen ? "seen" : "predicted" },
      pointButton(
        point,
        ` (one standard deviation).\n${what}\n` +
          "Drag it on the flattened view, or move it here with the arrow keys: it is held, the rest refits.",
        (name) => this.pointAt(name),
        {
          click: () => this.page.send({ type: "pick_point", name: point.name }),
          blur: () => this.settle(),
          keydown: (event) => this.key(event, point),
          keyup: (event) => event.key in WAYS && this.settle(),
        },
      ),
      point.held &&
        closeButton(
          `Release ${words(point.name)}`,
          () => this.page.send({ type: "release_points", name: point.name }),
          { key: `release-${point.name}`, tip: "Release the point: its place is fitted again." },
        ),
    );
  }

  // --- what the operator does ----------------------------------------------------------------------

  toggle() {
    this.shown = !this.shown;
    this.canvas.redraw();
    this.page.changed();
  }

  /** A finished garment is shown upright, unless it is turned already; found again at another angle, it stays upright. */
  keepUpright(/** @type {State} */ { phase }) {
    const { angle } = this.canvas.transform;
    if (phase !== "finished") this.finished = false;
    if (!this.found) return;
    const [before, now] = [this.upright, full(this.found.upright_rad)];
    this.upright = now;
    const isNew = phase === "finished" && !this.finished;
    this.finished ||= isNew;
    if (isNew && this.turnedFrom === null && angle === 0) this.toggleUpright();
    else if (this.turnedFrom !== null && angle === before && now !== before) this.page.looking.turn(now);
  }

  toggleUpright() {
    const { looking, canvas } = this.page;
    if (!this.found) return this.page.notify("info", this.known?.text || "The garment is not known yet.");
    const before = this.turnedFrom;
    this.turnedFrom = before === null ? canvas.transform.angle : null;
    looking.turn(before ?? full(this.found.upright_rad));
    this.page.changed();
  }

  /** The garment was turned over, and with it how it was turned before. */
  turned() {
    if (this.turnedFrom !== null) this.turnedFrom = full(-this.turnedFrom);
    this.upright = full(-this.upright);
  }

  pointAt(/** @type {string | null} */ name) {
    if (this.pointed === name) return;
    this.pointed = name;
    this.page.redrawMarks();
  }

  /** Arrow keys on a point of the list move it by the increment of the nudges; letting go is the decision. */
  key(/** @type {KeyboardEvent} */ event, /** @type {GarmentPoint} */ point) {
    if (!(event.key in WAYS) || !isPlain(event)) return;
    taken(event);
    if (this.moved?.name !== point.name) {
      const [u, v] = point.uv_m;
      this.moved = { name: point.name, u, v };
    }
    const step = (this.page.state.settings.step_mm / 1000) * (event.shiftKey ? 10 : 1);
    const [right, down] = WAYS[event.key];
    const by = this.canvas.asSeen(0, right * step, down * step);
    this.moved.u += by.u;
    this.moved.v += by.v;
    this.ask(this.moved.name, this.moved.u, this.moved.v);
  }

  settle() {
    const { moved } = this;
    this.moved = null;
    if (moved) this.page.send({ type: "hold_point", name: moved.name, u_m: moved.u, v_m: moved.v });
  }

  // --- over the flattened view ---------------------------------------------------------------------

  /**
   * What is drawn: the dragged outline, or the one that was found; null: nothing, as while cloth in doubt is asked about,
   * unless another place of it is shown.
   */
  get drawn() {
    const { held, choice } = this.page.doubts;
    if (!this.shown || !this.found?.kind || this.page.hasCamera || (held && choice?.how !== "place")) return null;
    return this.preview ?? this.found;
  }

  // --- a point is dragged: a tool of the canvas --------------------------------------------------

  press(/** @type {PointerPlace} */ at) {
    // Brushes, pairs, the proposal and what is in doubt have the pointer while they are there.
    const { state, brush, doubts, canvas } = this.page;
    const taken = state?.pending || brush?.side || doubts.held || canvas.side === "other";
    const near = taken ? null : this.near(at);
    if (!near) return false;
    this.grabbed = near.name;
    return true;
  }

  drag(/** @type {PointerPlace} */ at, /** @type {boolean} */ moved) {
    if (this.grabbed && moved) this.ask(this.grabbed, at.u, at.v);
  }

  release(/** @type {PointerPlace} */ at, /** @type {boolean} */ moved) {
    const name = this.grabbed;
    this.grabbed = null;
    if (!name) return;
    if (moved) this.page.send({ type: "hold_point", name, u_m: at.u, v_m: at.v });
    else this.page.send({ type: "pick_point", name });
  }

  near(/** @type {Point} */ at) {
    const { transform } = this.canvas;
    return nearest(this.drawn?.points ?? [], (point) => [transform.toPane(...point.uv_m)], at, GRAB_PX);
  }

  // --- how the outline would lie -------------------------------------------------------------------

  /** The point itself follows at once. @param {string} name @param {number} u @param {number} v */
  ask(name, u, v) {
    const from = this.preview ?? this.found;
    if (!from) return;
    this.preview = {
      ...from,
      points: from.points.map((point) => (point.name === name ? { ...point, uv_m: [u, v], held: true } : point)),
    };
    this.canvas.redraw();
    this.question.ask({ name, u_m: u, v_m: v });
  }

  showPreview(/** @type {GarmentPreview} */ preview) {
    if (!this.question.wanted && (this.grabbed || this.moved)) this.preview = preview;
    this.canvas.redraw();
  }

  // --- drawn ---------------------------------------------------------------------------------------

  drawOver() {
    const { drawn } = this;
    if (drawn) drawGarment(this.canvas, drawn, this.grabbed ?? this.pointed);
  }

  drawInScene(/** @type {Pen} */ pen, /** @type {PlaceInScene} */ place) {
    for (const point of this.drawn?.points ?? []) {
      const [x, y, z] = point.xyz_m ?? [null, null, null];
      const at = x !== null && y !== null && z !== null && place([x, y, z]);
      if (!at) continue;
      const on = point.name === this.pointed;
      pen.dot(at, "--garment", on ? 8 : 3.5);
      if (on) pen.label(words(point.name), { x: at.x + 12, y: at.y });
    }
  }
}

/** What is known of the garment, in a line. */
function summary(/** @type {NonNullable<State["garment"]>} */ known) {
  const { found } = known;
  if (!found) return known.working ? "Recognising the garment." : known.text;
  const again = known.working ? " Recognising it again on the changed shape." : "";
  if (found.by_hand) return `${words(found.kind ?? NONE)}, set by hand.${again}`;
  /** @param {string | null} name */
  const share = (name) => percent(found.probabilities.find(([each]) => each === name)?.[1] ?? 0);
  const kind = found.kind
    ? `${words(found.kind)}, ${share(found.kind)}.`
    : `None of the known kinds, ${share(NONE)}; the likeliest is ${words(found.likeliest)}.`;
  const doubt = " The shape may have a false joint, so nothing is called reliable; if it is right, set its kind.";
  return `${kind}${found.doubted ? doubt : ""}${again}`;
}
