// The current pick with its grip, and the list of all picks.

import { byId, make, rebuild, valueRow } from "/static/page/dom.js";
import { degrees, number, vector } from "/static/page/format.js";

export class PicksPanel {
  name = "picks";

  constructor(/** @type {Page} */ page) {
    this.page = page;
    this.actions = { copy: () => this.copy() };
  }

  update(/** @type {State} */ state) {
    const send = (/** @type {any} */ message) => this.page.send(message);
    showPick(state, () => this.copy(), send);
    showPicks(state, send);
  }

  async copy() {
    const { pick } = this.page.state;
    if (!pick) return this.page.notify("info", "There is no pick to copy; click the cloth first.");
    const text = pickText(pick);
    try {
      await navigator.clipboard.writeText(text);
    } catch {
      // Without https or permission there is only the old way.
      const area = make("textarea.unseen", { readonly: true }, text);
      document.body.append(area);
      area.select();
      const done = document.execCommand("copy");
      area.remove();
      if (!done) return this.page.notify("warning", "The browser does not allow copying.");
    }
    this.page.notify("info", `Copied the numbers of ${pick.name}.`);
  }
}

function pickText(/** @type {CurrentPick} */ pick) {
  return [
    `name\t${pick.name}`,
    `position_held_m\t${pick.position_held_m.map((x) => x.toFixed(5)).join(" ")}`,
    `position_camera_m\t${pick.position_camera_m.map((x) => x.toFixed(5)).join(" ")}\t(rotation ${pick.angle_deg} deg)`,
    `normal_held\t${pick.normal_held.map((x) => (x === null ? "nan" : x.toFixed(5))).join(" ")}`,
    `normal_camera\t${pick.normal_camera.map((x) => (x === null ? "nan" : x.toFixed(5))).join(" ")}`,
    `view\t${pick.view_index}`,
    `source_row_col\t${pick.source_rc.map((x) => x.toFixed(2)).join(" ")}`,
    `miss_m\t${pick.miss_m.toFixed(5)}`,
    ...(pick.grip
      ? [
          `approach_held\t${pick.grip.approach_held.map((x) => x.toFixed(5)).join(" ")}`,
          `axis_held\t${pick.grip.axis_held.map((x) => x.toFixed(5)).join(" ")}\t(${AXIS_FROM[pick.grip.axis_from]})`,
          `opening_m\t${pick.grip.opening_m.toFixed(4)}`,
        ]
      : []),
  ].join("\n");
}

/** @type {Record<string, string>} */
const AXIS_FROM = { outline: "along the outline", hand: "by hand", level: "level: no outline nearby" };
const OPENING_MM = [5, 300];

const stdMm = (/** @type {number | null} */ metres) =>
  metres !== null && metres < 1e-4 ? "< 0.1 mm" : `${number(metres === null ? null : 1000 * metres)} mm`;

/** The grip of a pick: axis on the plane, opening, and how surely it is known. */
function gripTools(/** @type {CurrentPick & { grip: object }} */ pick, /** @type {Send} */ send) {
  const grip = pick.grip;
  const change =
    (/** @type {"axis_deg" | "opening_m"} */ field, /** @type {number} */ scale) =>
    (/** @type {ChangeEvent} */ event) => {
      const value = event.target.valueAsNumber;
      if (Number.isFinite(value)) send({ type: "grip", id: pick.id, [field]: value * scale });
    };
  const outline = grip.axis_from === "outline";
  const away = grip.outline_distance_m === null ? "–" : `${number(1000 * grip.outline_distance_m, 0)} mm away`;
  const noAxis = grip.axis_deg === null ? "The pick is not on the present shape." : null;
  return [
    make(
      "div.grip",
      { role: "group", label: "Grip" },
      make(
        "label.field",
        {
          tip:
            "Direction of the gripper's axis on the flattened view, clockwise from right; the fingers " +
            "close across it",
        },
        make("span", "Axis °"),
        make("input", {
          type: "number",
          step: 5,
          min: -180,
          max: 180,
          value: grip.axis_deg === null ? null : Math.round(grip.axis_deg),
          disabled: noAxis !== null,
          key: "grip-axis",
          change: change("axis_deg", 1),
        }),
      ),
      make("button.button.small", {
        pressed: outline,
        key: "grip-outline",
        tip: `Lay the axis along the nearest outline\nNow: ${AXIS_FROM[grip.axis_from]}`,
        click: () => send({ type: "grip", id: pick.id, outline: true }),
        text: "Outline",
      }),
      make(
        "label.field",
        { tip: "Distance of the fingers" },
        make("span", "Open mm"),
        make("input", {
          type: "number",
          step: 5,
          min: OPENING_MM[0],
          max: OPENING_MM[1],
          value: Math.round(1000 * grip.opening_m),
          key: "grip-opening",
          change: change("opening_m", 0.001),
        }),
      ),
    ),
    make(
      "dl.values",
      ...valueRow("outline", away, "Distance to the nearest outline of the cloth, on the flattened view"),
      ...valueRow(
        "known to",
        stdMm(grip.position_std_m),
        "One standard deviation in space, from the scatter of depth nearby",
      ),
      ...valueRow(
        "normal, axis",
        `${degrees(grip.normal_std_deg, 0)}, ${degrees(grip.axis_std_deg, 0)}`,
        "One standard deviation of each, from the scatter of normals and outline nearby",
      ),
      grip.placement_std_m !== null &&
        valueRow("place", stdMm(grip.placement_std_m), "One standard deviation of its place on the flattened plane"),
    ),
  ];
}

/** @param {State} state @param {() => void} copy @param {Send} send */
function showPick(state, copy, send) {
  const pick = state.pick;
  rebuild(byId("pick"), [pick, Boolean(state.layers)], () => {
    if (!pick) {
      return [
        make("h2", "Pick"),
        make(
          "p.nothing",
          state.layers
            ? "Click the cloth, flat or in 3D, to get its grasp point."
            : "Grasp points can be picked once a view is flattened.",
        ),
      ];
    }
    return [
      make(
        "div.heading",
        make("h2", pick.name),
        make(
          "button.button.small",
          { key: "copy", tip: "Copy all numbers in metres", click: copy },
          "Copy",
          make("kbd", "C"),
        ),
      ),
      make(
        "dl.values",
        ...valueRow("held", `${vector(pick.position_held_m, 1, 1000)} mm`, "Position x y z in the held frame"),
        ...valueRow(
          `camera ${number(pick.angle_deg, 0)}°`,
          `${vector(pick.position_camera_m, 1, 1000)} mm`,
          "Position x y z in the camera frame at the present rotation",
        ),
        ...valueRow("normal", vector(pick.normal_held, 3), "Outward normal in the held frame"),
        ...valueRow(
          "n. camera",
          vector(pick.normal_camera, 3),
          "Outward normal in the camera frame at the present rotation",
        ),
        ...valueRow("Z-angle", degrees(pick.z_angle_deg), "Z-angle at which the pixel was seen"),
        ...valueRow(
          "source",
          `view ${pick.view_index} @ ${pick.source_rc.map((x) => number(x)).join(", ")}`,
          "View and image pixel (row, column) it was measured in",
        ),
        ...valueRow("pixel", pick.in_shape ? pick.rc.join(", ") : "–", "Row, column of the flattened view"),
        ...valueRow(
          "miss",
          pick.miss_m > 0 ? `${number(1000 * pick.miss_m)} mm` : "on the cloth",
          "Distance between the click and the nearest cloth",
        ),
      ),
      pick.grip && gripTools(pick, send),
      !pick.in_shape && make("p.note", "Its view is not part of the present shape."),
    ];
  });
}

/** `send` goes to the server. */
function showPicks(/** @type {State} */ state, /** @type {Send} */ send) {
  rebuild(byId("picks"), [state.picks, state.pick?.id ?? null], () => [
    make(
      "div.heading",
      make("h2", `Picks${state.picks.length ? ` (${state.picks.length})` : ""}`),
      state.picks.length > 0 &&
        make("a.button.small", {
          href: "/export/grasps.json",
          download: "grasps.json",
          key: "export",
          tip: "Download all picks as grasps.json",
          text: "Export",
        }),
    ),
    state.picks.length
      ? make("ol.picks", ...state.picks.map((p) => pickRow(p, p.id === state.pick?.id, send)))
      : make("p.nothing", "Every pick is kept here: name it, show it again, export it."),
  ]);
}

/** @param {ListedPick} pick @param {boolean} current @param {Send} send */
function pickRow(pick, current, send) {
  const rename = (/** @type {ChangeEvent} */ event) => {
    const name = event.target.value.trim();
    if (name && name !== pick.name) send({ type: "rename_pick", id: pick.id, name });
    else event.target.value = pick.name;
  };
  return make(
    "li",
    { class: current ? "current" : "" },
    make(
      "button.show",
      {
        label: `Show ${pick.name}`,
        pressed: current,
        key: `show-${pick.id}`,
        tip: pick.uv_m ? "Show on both sides" : "Show in 3D; its view is not part of the present shape",
        click: () => send({ type: "show_pick", id: pick.id }),
      },
      pick.uv_m ? "◎" : "○",
    ),
    make("input", {
      value: pick.name,
      maxlength: 80,
      label: `Name of ${pick.name}`,
      key: `name-${pick.id}`,
      change: rename,
      keydown: (e) => {
        if (e.key === "Enter") e.target.blur();
        if (e.key === "Escape") {
          e.target.value = pick.name;
          e.target.blur();
        }
      },
    }),
    make("button.close", {
      label: `Delete ${pick.name}`,
      key: `delete-${pick.id}`,
      tip: "Delete",
      click: () => send({ type: "delete_pick", id: pick.id }),
      text: "×",
    }),
  );
}
