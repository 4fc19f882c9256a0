// Looking: the flattened view turned and flipped, with another colour map and window; what the 3D scene shows.
// The data stay as they are.

import { PagePart } from "../page/page.js";
import { askJson } from "../page/connection.js";
import { onPinch } from "./pinch.js";
import {
  button,
  byId,
  choice,
  find,
  make,
  rebuild,
  setText,
  slider,
  field,
  numberBox,
  tickBox,
} from "../page/dom.js";
import { number } from "../page/format.js";

const STEP_DEG = 15;
const ENDS = /** @type {("low" | "high")[]} */ (["low", "high"]);
/** @type {Record<string, string>} */
const SIGNS = { turn_left_seen: "↺", turn_right_seen: "↻", flip: "Flip", ruler: "Ruler" };
/** @type {LayerLook} */
const PLAIN = { map: "", low: 0, high: 1 };
/** All layers; the table of actions has their titles, keys and descriptions. */
export const LAYERS = ["color", "height", "z_angle", "source", "stretch", "incidence", "density", "place", "truth"];

/** The action that chooses a layer. */
export const layerAction = (/** @type {string} */ layer) => `layer_${layer}`;

/** Keeps how each layer is looked at. */
export class Looking extends PagePart {
  name = "looking";
  actions = {
    look: () => this.toggle(),
    turn_left_seen: () => this.turnBy(-1),
    turn_right_seen: () => this.turnBy(1),
    flip: () => this.flip(),
  };
  settings = /** @type {Map<string, LayerLook>} */ (new Map()); // by layer or difference
  maps = /** @type {Record<string, { title: string; colors: string[] }>} */ ({});
  open = false;
  sentLook = ""; // what the 3D scene last got
  scene = new SceneLook(this.page);
  chip = byId("turned");

  constructor(/** @type {Page} */ page) {
    super(page);
    this.chip.addEventListener("click", () => this.turn(0, false));
    this.loadMaps();
    onPinch(
      this.canvas.canvas,
      () => this.canvas.cancel(),
      (factor, from, to) => this.pinch(factor, from, to),
    );
  }

  /** @param {number} factor @param {Point} from @param {Point} to */
  pinch(factor, from, to) {
    const { canvas } = this;
    const at = canvas.canvas.getBoundingClientRect();
    canvas.fitted = false;
    canvas.transform.pan(to.x - from.x, to.y - from.y);
    canvas.transform.zoom(factor, to.x - at.left, to.y - at.top);
    canvas.redraw();
  }

  async loadMaps() {
    this.maps = (await askJson("colormaps.json")) ?? {};
  }

  // --- turn and flip ---------------------------------------------------------------------------

  turnBy(/** @type {number} */ steps) {
    const { angle, flipped } = this.canvas.transform;
    const degrees = Math.round((angle * 180) / Math.PI) + STEP_DEG * steps;
    this.turn((((degrees % 360) + 360) % 360) * (Math.PI / 180), flipped);
  }

  /** Exchange left and right as they are seen now. */
  flip() {
    const { angle, flipped } = this.canvas.transform;
    this.turn((2 * Math.PI - angle) % (2 * Math.PI), !flipped);
  }

  turn(/** @type {number} */ angle, /** @type {boolean} */ flipped) {
    this.canvas.turnTo(angle, flipped);
    const degrees = Math.round((angle * 180) / Math.PI) % 360;
    this.chip.hidden = degrees === 0 && !flipped;
    const turned = degrees ? `turned ${number(degrees > 180 ? degrees - 360 : degrees, 0)}°` : "";
    const text = [turned, flipped ? "flipped" : ""].filter(Boolean).join(", ");
    setText(this.chip, text);
    this.chip.setAttribute("aria-label", `${text}: undo turn and flip`);
  }

  // --- colour map and window -------------------------------------------------------------------

  of(/** @type {string} */ layer) {
    return this.settings.get(layer) ?? PLAIN;
  }

  set(/** @type {string} */ layer, /** @type {Partial<LayerLook>} */ change) {
    this.settings.set(layer, { ...this.of(layer), ...change });
    this.page.changed();
  }

  /** The 3D scene is one for all tabs, so each tells only what its operator has changed. */
  update(/** @type {State} */ state) {
    if (state.mode !== "session") return;
    const { map, low, high } = this.of(this.page.layer);
    const layer = /** @type {import("../page/messages").Look["layer"]} */ (this.page.layer);
    /** @type {import("../page/messages").Look} */
    const message = { type: "look", layer, map: map || null, low, high };
    const text = JSON.stringify(message);
    if (this.sentLook === text) return;
    const first = this.sentLook === "";
    this.sentLook = text;
    if (!first || this.page.layer !== "color") this.page.send(message);
  }

  /** How a layer is looked at, as part of an address. */
  query(/** @type {string} */ layer) {
    const { map, low, high } = this.of(layer);
    const parts = [map && `map=${map}`, low > 0 && `low=${low}`, high < 1 && `high=${high}`];
    return parts.filter(Boolean).join("&");
  }

  /** A legend as the layer is looked at. */
  legend(/** @type {string} */ layer, /** @type {Legend | null | undefined} */ legend) {
    if (legend?.kind !== "ramp") return legend;
    const { map, low, high } = this.of(layer);
    const at = (/** @type {number} */ share) => legend.low + share * (legend.high - legend.low);
    return { ...legend, low: at(low), high: at(high), colors: this.maps[map]?.colors ?? legend.colors };
  }

  get pressed() {
    return { look: this.open };
  }

  reset() {
    this.settings.clear();
    this.turn(0, false);
    this.page.changed();
  }

  // --- the panel -------------------------------------------------------------------------------

  toggle() {
    this.open = !this.open;
    byId("look").hidden = !this.open; // before the column asks what there is
    this.page.changed();
    if (this.open) find("button", byId("look"))?.focus();
  }

  /**
   * Show the panel for a layer with its legend (null: it has no numbers). A frame of a camera has its own colours;
   * without a kit no error is known.
   * @param {string} layer @param {Legend | null} [legend] @param {boolean} [hasKit]
   */
  show(layer, legend, hasKit = false) {
    const panel = byId("look");
    panel.hidden = !this.open;
    if (!this.open) return;
    const setting = this.of(layer);
    const ramp = legend?.kind === "ramp";
    const all = [...this.settings.entries()];
    const camera = this.page.hasCamera;
    const layers = LAYERS.filter((one) => hasKit || one !== "truth");
    rebuild(panel, [layer, legend, hasKit, all, Object.keys(this.maps), this.scene.key], () => [
      !camera && [
        make("h2", "Layers"),
        make("div.looks", ...layers.map((one) => this.page.button(layerAction(one)))),
      ],
      make("div.looks", ...Object.entries(SIGNS).map(([name, sign]) => this.page.button(name, sign))),
      button("Reset", () => this.reset(), {
        class: "last",
        key: "look-reset",
        tip: "As it is: not turned, not flipped, each layer's own colours",
      }),
      !camera && [
        ramp ? this.mapField(layer, setting) : null,
        ...(ramp || layer === "color" ? this.windowFields(layer, setting, legend, ramp) : []),
      ],
      ...this.scene.build(),
    ]);
  }

  mapField(/** @type {string} */ layer, /** @type {LayerLook} */ setting) {
    const options = [["", "Own colours"], ...Object.entries(this.maps).map(([name, map]) => [name, map.title])];
    return make(
      "label.field",
      choice(options, setting.map, {
        label: "Colours",
        key: "look-map",
        tip: "Colours; equal steps of a value look equal in each",
        change: (event) => this.set(layer, { map: event.target.value }),
      }),
    );
  }

  /**
   * @param {string} layer @param {LayerLook} setting @param {Legend | null | undefined} legend
   * @param {boolean} ramp
   */
  windowFields(layer, setting, legend, ramp) {
    const textAt = (/** @type {number} */ share) =>
      ramp && legend ? number(legend.low + share * (legend.high - legend.low), 0) : `${Math.round(100 * share)} %`;
    const names = ramp ? { low: "From", high: "To" } : { low: "Black", high: "White" };
    return ENDS.map((end) => {
      const output = make("output", textAt(setting[end]));
      /** @type {HTMLInputElement} */
      const input = slider([0, 1, 0.01], setting[end], {
        key: `look-${end}`,
        label: names[end],
        input: () => setText(output, textAt(this.clamped(end, input.valueAsNumber, setting))),
        change: () => this.set(layer, { [end]: this.clamped(end, input.valueAsNumber, setting) }),
      });
      return make("label.field", make("span", names[end]), input, output);
    });
  }

  clamped(/** @type {"low" | "high"} */ end, /** @type {number} */ value, /** @type {LayerLook} */ { low, high }) {
    return end === "low"
      ? Math.min(value, Math.round(100 * high - 1) / 100)
      : Math.max(value, Math.round(100 * low + 1) / 100);
  }
}

// --- What the 3D scene shows, and its turning axis set by hand ---------------------------------

/** @typedef {NonNullable<State["axis"]>} Axis */
/** @typedef {"right_m" | "away_m" | "lean_right_deg" | "lean_away_deg"} AxisField */

const SWITCHES = /** @type {const} */ ([
  "show_view",
  "show_shape",
  "show_new",
  "show_all",
  "show_axis",
  "show_camera",
  "follow",
]);
const OF_A_CAMERA = ["show_view", "follow"];
/** @type {[field: AxisField, title: string, scale: number][]} as the camera of view 0 sees it, and units of the box */
const AXIS = [
  ["right_m", "Right, mm", 1000],
  ["away_m", "Away, mm", 1000],
  ["lean_right_deg", "Top leans right, °", 1],
  ["lean_away_deg", "Top leans away, °", 1],
];

class SceneLook {
  axis = /** @type {Axis | null} */ (null); // the one that is being set, and not in force yet

  constructor(/** @type {Page} */ page) {
    this.page = page;
  }

  /** What the part is built from. */
  get key() {
    const { settings, axis, phase } = this.page.state;
    return [SWITCHES.map((name) => settings[name]), axis, this.axis, phase === "computing"];
  }

  build() {
    const { settings, settings_rows, axis, capture } = this.page.state;
    const names = SWITCHES.filter((name) => !capture || OF_A_CAMERA.includes(name));
    return [
      make("h2", "3D scene"),
      make(
        "ul.scene-switches",
        ...names.map((name) => {
          const row = settings_rows.find((one) => one.name === name);
          const set = (/** @type {boolean} */ on) => this.page.send({ type: "set", values: { [name]: on } });
          const box = tickBox(settings[name], set, { key: name });
          return make("li", make("label", { tip: row?.description }, box, row?.title));
        }),
      ),
      axis && settings.show_axis && this.axisFields(axis),
    ];
  }

  /** The axis by hand: it is drawn while it is typed, and in force once it is applied. */
  axisFields(/** @type {Axis} */ now) {
    if (!this.axis)
      return button("Set the axis", () => this.change(now), {
        key: "axis-set",
        tip: `Move and lean the turning axis, which is ${now.estimated ? "estimated, or set by hand" : "recorded"}.`,
      });
    const axis = this.axis;
    const busy = this.page.state.phase === "computing";
    return make(
      "div.axis-fields",
      { role: "group", label: "Turning axis, as the camera of view 0 sees it" },
      ...AXIS.map(([name, title, scale]) =>
        field(
          title,
          numberBox({ step: scale === 1 ? 0.1 : 0.5 }, Math.round(10 * scale * axis[name]) / 10, {
            key: `axis-${name}`,
            change: ({ target: { valueAsNumber: value } }) =>
              Number.isFinite(value) && this.change({ ...axis, [name]: value / scale }),
          }),
        ),
      ),
      make(
        "div.group",
        button("Apply", () => this.apply(axis), {
          class: "primary",
          key: "axis-apply",
          "aria-disabled": String(busy),
          tip: busy ? "Not during a computation" : "Compute everything again with this axis.",
        }),
        button("Back", () => this.back(now), { key: "axis-back", tip: "Leave the axis as it is." }),
      ),
    );
  }

  change(/** @type {Axis} */ axis) {
    this.axis = axis;
    this.send(axis, false);
    this.page.changed();
  }

  apply(/** @type {Axis} */ axis) {
    if (this.page.state.phase === "computing") return;
    this.axis = null;
    this.send(axis, true);
    this.page.changed();
  }

  back(/** @type {Axis} */ now) {
    this.axis = null;
    this.send(now, false);
    this.page.changed();
  }

  /** @param {Axis} axis @param {boolean} apply */
  send({ right_m, away_m, lean_right_deg, lean_away_deg }, apply) {
    this.page.send({ type: "axis", right_m, away_m, lean_right_deg, lean_away_deg, apply });
  }
}
