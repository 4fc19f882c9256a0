// The Garment panel: kinds with their probabilities, dimensions, named points; what is decided about them by hand.

import { GarmentDrawing } from "/static/garment/drawing.js";
import { dimensions, percent, pointButton, shares } from "/static/garment/lists.js";
import { words } from "/static/garment/marks.js";
import { byId, make, rebuild, setText } from "/static/page/dom.js";
import { number } from "/static/page/format.js";

/** @type {Record<string, UV>} */
const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export class GarmentPanel {
  name = "garment";

  constructor(/** @type {Page} */ page) {
    this.page = page;
    this.shown = true; // outline and points on the canvas
    /** @type {State["garment"]} */
    this.told = null; // what the server says
    /** @type {string | null} */
    this.pointed = null; // the name of the point that is pointed at
    this.finished = false; // whether the finished shape was turned upright
    /** @type {{ angle: number; flipped: boolean } | null} */
    this.turnedFrom = null; // how the view was turned before it was turned upright
    /** @type {{ name: string; u: number; v: number } | null} a point that the keys move */
    this.moved = null;
    this.actions = { garment: () => this.toggle(), upright: () => this.toggleUpright() };
    /** @type {Panel["messages"]} */
    this.messages = { garment_preview: (message) => this.drawing.takePreview(message) };
    this.section = make("section#garment.garment", { label: "Garment", hidden: true });
    byId("pick").before(this.section);
    this.drawing = new GarmentDrawing(page, this);
  }

  get found() {
    return this.told?.found ?? null;
  }

  get pressed() {
    return { garment: this.shown, upright: this.turnedFrom !== null };
  }

  get status() {
    return { told: this.told, shown: this.shown, pointed: this.pointed, preview: this.drawing.preview };
  }

  update(/** @type {State} */ state) {
    this.finishUpright(state);
    this.told = state.garment ?? null;
    this.section.hidden = !this.told || !state.layers;
    if (!this.found?.points.some((point) => point.name === this.pointed)) this.pointed = null;
    this.drawing.update(this.told?.revision ?? 0);
    if (!this.section.hidden) this.show();
  }

  // --- the panel -----------------------------------------------------------------------------------

  show() {
    const { told, found } = this;
    if (!told) return;
    rebuild(this.section, ["garment"], () => [
      make("h2", "Garment"),
      make("p#garment-text", { role: "status" }),
      make("div#garment-tools.group", { role: "group", label: "Garment, shown" }),
      make("div#garment-kinds"),
      make("div#garment-links"),
      make("div#garment-points"),
      make("div#garment-dimensions"),
    ]);
    rebuild(byId("garment-tools"), [Boolean(found)], () => (found ? this.tools() : []));
    setText(byId("garment-text"), summary(told));
    rebuild(byId("garment-kinds"), [found?.probabilities, found?.kind, found?.by_hand], () =>
      found ? this.kinds(found, told.kinds) : [],
    );
    rebuild(byId("garment-links"), [found?.links, told.working, told.revision], () =>
      (found?.links ?? []).map(this.link, this),
    );
    rebuild(byId("garment-points"), [found?.kind, found?.points], () => (found?.kind ? this.points(found) : []));
    rebuild(byId("garment-dimensions"), [found?.kind, found?.dimensions], () =>
      found?.kind ? [dimensions(found)] : [],
    );
  }

  tools() {
    return ["garment", "upright"].map((name) => {
      const button = this.page.button(name, name === "garment" ? "Outline" : null);
      button.classList.add("small");
      return button;
    });
  }

  kinds(/** @type {FoundGarment} */ found, /** @type {string[]} */ names) {
    const select = make(
      "select",
      {
        key: "garment-kind",
        tip: "The kind of garment. Automatic: by the evidence. A kind set by hand is a decision; Undo takes it back.",
        change: (event) => this.page.send({ type: "garment_kind", kind: event.target.value || null }),
      },
      make("option", { value: "", selected: !found.by_hand }, "automatic"),
      ...names.map((name) =>
        make("option", { value: name, selected: found.by_hand && name === found.kind }, words(name)),
      ),
    );
    return [shares(found.probabilities), make("label.field", make("span", "Kind"), select)];
  }

  /** A part that is joined where no garment allows it, to be taken off or kept like a proposal. */
  link(/** @type {FoundGarment["links"][number]} */ { probability, area_cm2 }, /** @type {number} */ index) {
    const revision = this.told?.revision ?? 0;
    const area = `${number(area_cm2, 0)} cm²`;
    /** @param {string} title @param {boolean} taken_off @param {string} tip */
    const decide = (title, taken_off, tip) =>
      make(
        "button.button.small",
        {
          label: `${title}: the part of ${area}`,
          key: `link-${index}-${taken_off}`,
          tip: `${tip}\nUndo takes it back.`,
          click: () => this.page.send({ type: "decide_link", revision, index, taken_off }),
        },
        title,
      );
    return make(
      "div.by-garment",
      { role: "group", label: `Link of a part of ${area}` },
      make(
        "p.note",
        `A part of ${area}, outlined in dashes, is joined where no garment allows it: its link is right with ` +
          `${percent(probability)}.`,
      ),
      decide("Take it off", true, "It floats then, as a piece of its own; the measured data stay."),
      decide("Keep it", false, "The link is right; it is not asked about again."),
    );
  }

  points(/** @type {FoundGarment} */ found) {
    const held = found.points.filter((point) => point.held).length;
    const release = make("button.button.small", {
      key: "release-all",
      tip: "Release all held points: the outline follows the evidence alone again.",
      click: () => this.page.send({ type: "release_points" }),
      text: "Release all",
    });
    const list = (
      /** @type {string} */ title,
      /** @type {GarmentPoint[]} */ points,
      /** @type {Child} */ more = null,
    ) =>
      points.length
        ? [
            make("div.heading", make("h3", `${title}: ${points.length}`), more),
            make("ul.named", { label: title }, ...points.map((point) => this.row(point))),
          ]
        : [];
    const seen = found.points.filter((point) => point.seen);
    const predicted = found.points.filter((point) => !point.seen);
    return [
      ...list("Points seen", seen, held ? release : null),
      ...list("Points predicted", predicted, seen.length || !held ? null : release),
    ];
  }

  row(/** @type {GarmentPoint} */ point) {
    const what = point.seen
      ? "Click: pick it as a grasp."
      : "No view shows cloth there, so it cannot be grasped yet.";
    const point_at = (/** @type {boolean} */ on) => () => this.pointAt(on ? point.name : null);
    return make(
      "li",
      { class: point.seen ? "seen" : "predicted" },
      pointButton(
        point,
        ` (one standard deviation).\n${what}\n` +
          "Drag it on the flattened view, or move it here with the arrow keys: it is held, the rest refits.",
        {
          click: () => this.page.send({ type: "pick_point", name: point.name }),
          mouseenter: point_at(true),
          mouseleave: point_at(false),
          focus: point_at(true),
          blur: () => {
            this.settle();
            this.pointAt(null);
          },
          keydown: (event) => this.key(event, point),
          keyup: (event) => event.key in WAYS && this.settle(),
        },
      ),
      point.held &&
        make("button.close", {
          label: `Release ${words(point.name)}`,
          key: `release-${point.name}`,
          tip: "Release the point: its place is fitted again.",
          click: () => this.page.send({ type: "release_points", name: point.name }),
          text: "×",
        }),
    );
  }

  // --- what the operator does ----------------------------------------------------------------------

  toggle() {
    this.shown = !this.shown;
    this.page.canvas.redraw();
    this.page.changed();
  }

  /** Once the shape is finished and known as a garment, it is shown upright, unless it is turned already. */
  finishUpright(/** @type {State} */ { phase, garment }) {
    if (phase !== "finished") this.finished = false;
    if (phase !== "finished" || this.finished || !garment?.found) return;
    this.finished = true;
    this.told = garment;
    const { angle, flipped } = this.page.canvas.transform;
    if (!this.turnedFrom && angle === 0 && !flipped) this.toggleUpright();
  }

  toggleUpright() {
    const { looking, canvas } = this.page;
    if (!this.found) return this.page.notify("info", this.told?.text || "The garment is not known yet.");
    if (this.turnedFrom) {
      looking.turn(this.turnedFrom.angle, this.turnedFrom.flipped);
      this.turnedFrom = null;
    } else {
      const { angle, flipped } = canvas.transform;
      this.turnedFrom = { angle, flipped };
      looking.turn((this.found.upright_rad + 2 * Math.PI) % (2 * Math.PI), false);
    }
    this.page.changed();
  }

  pointAt(/** @type {string | null} */ name) {
    if (this.pointed === name) return;
    this.pointed = name;
    this.page.redrawMarks();
  }

  /** Arrow keys on a point of the list move it by the increment of the nudges; letting go is the decision. */
  key(/** @type {KeyboardEvent} */ event, /** @type {GarmentPoint} */ point) {
    if (!(event.key in WAYS) || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    event.stopPropagation();
    if (this.moved?.name !== point.name) {
      const [u, v] = point.uv_m;
      this.moved = { name: point.name, u, v };
    }
    const step = ((this.page.state.settings.step_mm.value ?? 1) / 1000) * (event.shiftKey ? 10 : 1);
    const [right, down] = WAYS[event.key];
    const by = this.page.canvas.asSeen(0, right * step, down * step);
    this.moved.u += by.u;
    this.moved.v += by.v;
    this.drawing.ask(this.moved.name, this.moved.u, this.moved.v);
  }

  settle() {
    const { moved } = this;
    this.moved = null;
    if (moved) this.hold(moved.name, moved.u, moved.v);
  }

  /** @param {string} name @param {number} u_m @param {number} v_m */
  hold(name, u_m, v_m) {
    this.page.send({ type: "hold_point", name, u_m, v_m });
  }
}

/** What is known of the garment, in a line. */
function summary(/** @type {NonNullable<State["garment"]>} */ told) {
  const { found } = told;
  if (!found) return told.working ? "Recognising the garment." : told.text;
  const again = told.working ? " Recognising it again on the changed shape." : "";
  if (found.by_hand && found.kind) return `${words(found.kind)}, set by hand.${again}`;
  /** @param {string | null} name */
  const share = (name) => percent(found.probabilities.find(([each]) => each === name)?.[1] ?? 0);
  if (found.kind) return `${words(found.kind)}, ${share(found.kind)}.${again}`;
  return `None of the known kinds, ${share("none of these")}; the likeliest is ${words(found.likeliest)}.${again}`;
}
