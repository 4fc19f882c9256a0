// What the 3D scene shows, and its turning axis set by hand: a part of the panel Look.

import { button, field, make, numberBox, tickBox } from "../page/dom.js";

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

export class SceneLook {
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
