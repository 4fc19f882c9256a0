// The current pick with its grip, and the list of all picks.

import { PagePart } from "../page/page.js";
import {
  byId,
  closeButton,
  field,
  heading,
  make,
  numberBox,
  rebuild,
  section,
  smallButton,
  values,
} from "../page/dom.js";
import { degrees, mm, number, vector } from "../page/format.js";
import { AXIS_FROM, copyText, pickText, sourceRow, stdMm } from "./pick_text.js";

export class PicksPanel extends PagePart {
  setsGrip = false; // whether its fields are open
  actions = { copy: () => this.copy(), keep_pick: () => this.keep(this.page.state.pick?.id) };

  update(/** @type {State} */ { pick, picks, layers }) {
    rebuild(byId("pick"), [pick, Boolean(layers)], () =>
      pick ? this.present(pick) : [make("h2", "Pick"), make("p.nothing", layers ? HOW_TO_PICK : NOT_YET)],
    );
    section("picks", picks.length > 0 && [picks, pick?.id], () => this.list(picks, pick?.id ?? null));
  }

  async copy() {
    const { pick } = this.page.state;
    if (!pick) return this.page.notify("info", "There is no pick to copy; click the cloth first.");
    const done = await copyText(pickText(pick));
    if (!done) return this.page.notify("warning", "The browser does not allow copying.");
    this.page.notify("info", `Copied the numbers of ${pick.name}.`);
  }

  keep(/** @type {number | undefined} */ id) {
    if (id !== undefined) this.page.send({ type: "show_pick", id, keep: true });
  }

  // --- the current pick --------------------------------------------------------------------------

  present(/** @type {CurrentPick} */ pick) {
    const angle = `${number(pick.angle_deg, 0)}°`;
    return [
      heading(pick.name, this.page.smallButton("copy", "Copy")),
      values(
        ["Place, mm", vector(pick.position_held_m, 1, 1000), "x y z in the object frame"],
        [
          `Camera, ${angle}`,
          vector(pick.position_camera_m, 1, 1000),
          "x y z in the camera frame at the present rotation, mm",
        ],
        ["Normal", vector(pick.normal_held, 3), "Outward normal in the object frame"],
        sourceRow(pick),
        pick.miss_m > 0 && [
          "Off the cloth",
          mm(1000 * pick.miss_m),
          "Distance between the click and the nearest cloth",
        ],
      ),
      pick.grip && this.grip(pick, pick.grip),
      !pick.uv_m && make("p.note", "Its view is not part of the present shape."),
    ];
  }

  /** The grip of a pick: axis on the plane, opening, and how surely it is known. */
  grip(/** @type {CurrentPick} */ { id }, /** @type {NonNullable<CurrentPick["grip"]>} */ grip) {
    /** @type {(change: object) => boolean} */
    const send = (change) => this.page.send({ type: "grip", id, ...change });
    /** @param {string} key @param {(value: number) => object} changeOf */
    const box = (key, changeOf, more = {}) => ({
      key,
      change: (/** @type {ChangeEvent} */ { target: { valueAsNumber: value } }) =>
        Number.isFinite(value) && send(changeOf(value)),
      ...more,
    });
    const axis = numberBox(
      { low: -180, high: 180, step: 5 },
      grip.axis_deg === null ? null : Math.round(grip.axis_deg),
      box("grip-axis", (axis_deg) => ({ axis_deg }), { disabled: grip.axis_deg === null }),
    );
    const opening = numberBox(
      OPENING_MM,
      Math.round(1000 * grip.opening_m),
      box("grip-opening", (value) => ({ opening_m: value / 1000 })),
    );
    const outline = smallButton("Outline", () => send({ outline: true }), {
      pressed: grip.axis_from === "outline",
      key: "grip-outline",
      tip: `Turn the axis along the nearest outline\nNow: ${AXIS_FROM[grip.axis_from]}`,
    });
    const away = grip.outline_distance_m === null ? "–" : mm(1000 * grip.outline_distance_m, 0);
    const scatter = `${degrees(grip.normal_std_deg, 0)}, ${degrees(grip.axis_std_deg, 0)}`;
    return [
      make(
        "details",
        { open: this.setsGrip, toggle: ({ target }) => (this.setsGrip = target.open) },
        make("summary", "Set the grip"),
        make(
          "div.grip",
          { role: "group", label: "Grip" },
          field("Axis °", axis, AXIS_TIP),
          outline,
          field("Open mm", opening, "Distance of the fingers"),
        ),
      ),
      values(
        ["To outline", away, "Distance to the nearest outline of the cloth, on the flattened view"],
        ["Known to", stdMm(grip.position_std_m), "One standard deviation in space, from the scatter of depth nearby"],
        ["Angles to", scatter, "One standard deviation of each, from the scatter of normals and outline nearby"],
        grip.placement_std_m !== null && [
          "On the plane",
          stdMm(grip.placement_std_m),
          "One standard deviation of its place on the flattened plane",
        ],
      ),
    ];
  }

  // --- all picks ---------------------------------------------------------------------------------

  list(/** @type {ListedPick[]} */ picks, /** @type {number | null} */ current) {
    const save = make("a.button.small", {
      href: "export/grasps.json",
      download: "grasps.json",
      key: "export",
      tip: "Download all picks as grasps.json",
      text: "Export",
    });
    return [
      heading(`Picks (${picks.length})`, save),
      make("ol.picks", ...picks.map((pick) => this.row(pick, pick.id === current))),
    ];
  }

  row(/** @type {ListedPick} */ { id, name, uv_m, kept }, /** @type {boolean} */ current) {
    const { page } = this;
    const show = {
      label: `Show ${name}`,
      pressed: current,
      key: `show-${id}`,
      tip: uv_m ? "Show on both sides" : "Show in 3D; its view is not part of the present shape",
      click: () => page.send({ type: "show_pick", id }),
    };
    const box = make("input", {
      value: name,
      maxlength: 80,
      label: `Name of ${name}`,
      key: `name-${id}`,
      change: () => {
        const other = box.value.trim();
        if (other && other !== name) page.send({ type: "rename_pick", id, name: other });
        else box.value = name;
      },
      keydown: ({ key }) => {
        if (key === "Escape") box.value = name;
        if (key === "Escape" || key === "Enter") box.blur();
      },
    });
    return make(
      "li",
      { class: current ? "current" : "" },
      make("button.show", show, uv_m ? "◎" : "○"),
      box,
      !kept && smallButton("Keep", () => this.keep(id), { key: `keep-${id}`, tip: this.page.tip("keep_pick") }),
      closeButton(`Delete ${name}`, () => page.send({ type: "delete_pick", id }), {
        key: `delete-${id}`,
        tip: "Delete",
      }),
    );
  }
}

const HOW_TO_PICK =
  "Click the cloth, flat or in 3D, to get its grasp point. Enter keeps it; otherwise the next click replaces it.";
const NOT_YET = "Grasp points can be picked once a view is flattened.";
const AXIS_TIP =
  "Direction of the gripper's axis on the flattened view, clockwise from right; the fingers close across it";
const OPENING_MM = { low: 5, high: 300, step: 5 };
