// What stands beside the canvas: the values under the pointer, the proposal, the picks, the timeline.

import { byId, make, rebuild, setText } from "/static/dom.js";
import { degrees, hex, number, vector } from "/static/format.js";

const STATES = {
  start: ["●", "start view"], accepted: ["✓", "accepted"], fixed: ["✎", "accepted, moved by hand"],
  rejected: ["✕", "rejected"], skipped: ["»", "skipped"], later: ["…", "accepted, waits to follow"], pending: ["?", "proposed"], unused: ["", "not used"],
};

// --- values under the pointer ------------------------------------------------------------------

const READOUT = [
  ["Pixel", "row, column", (a) => `${a.rc[0]}, ${a.rc[1]}`],
  ["u, v", "mm on the plane", (a) => `${vector(a.uv_mm)} mm`],
  ["Color", "red, green, blue", (a) => `${a.rgb.join(" ")}`],
  ["Source", "view @ its pixel (row, column)", (a) => `${a.view_index} @ ${a.source_rc.map((x) => number(x)).join(", ")}`],
  ["x y z", "mm, held frame", (a) => `${vector(a.xyz_mm)} mm`],
  ["Height z", "mm along the axis", (a) => `${number(a.height_mm)} mm`],
  ["Normal", "outward, held frame", (a) => vector(a.normal, 3)],
  ["Z-angle", "deg", (a) => degrees(a.z_angle_deg)],
  ["Place ±", "mm on the plane: one standard deviation of where this pixel lies, relative to the start view's main piece",
    (a) => a.placement_std_mm === null ? "–" : `${number(a.placement_std_mm)} mm`],
  ["Quality", "image pixels per cm² of cloth, angle between line of sight and normal, change of length by the flattening",
    (a) => `${number(a.density_px_cm2, 0)} px/cm² · ${degrees(a.incidence_deg, 0)} incidence · ${number(a.stretch === null ? null : 100 * a.stretch)} % stretch`],
];

export function showReadout(answer) {
  const list = byId("readout");
  if (!list.childElementCount) {
    list.append(...READOUT.map(([name, about]) =>
      make("div", {}, make("dt", { data: { tip: `${name}: ${about}` } }, name), make("dd", {}, "–"))));
  }
  const values = answer?.shape ?? answer?.proposal ?? null;
  list.classList.toggle("of-proposal", Boolean(!answer?.shape && answer?.proposal));
  READOUT.forEach(([name, , text], i) => {
    const cell = list.children[i].lastChild;
    setText(cell, values ? text(values) : "–");
    if (name === "Color") cell.style.setProperty("--swatch", values ? hex(values.rgb) : "transparent");
  });
}

export function showLegend(legend) {
  const box = byId("legend");
  box.hidden = !legend || legend.kind === "none";
  if (box.hidden) return;
  rebuild(box, legend, () => {
    if (legend.kind === "classes") {
      return [make("h3", {}, legend.title), ...legend.classes.map((c) => {
        const swatch = make("i", { class: "swatch" });
        swatch.style.background = c.color;
        return make("p", {}, swatch, c.label);
      })];
    }
    const ramp = make("i", { class: "ramp" });
    ramp.style.background = `linear-gradient(to top, ${legend.colors.join(", ")})`;
    const middle = (legend.low + legend.high) / 2;
    return [make("h3", {}, legend.title), make("div", { class: "scale" }, ramp,
      make("div", {}, ...[legend.high, middle, legend.low].map((x) => make("span", {}, number(x, 0)))))];
  });
}

// --- proposal ----------------------------------------------------------------------------------

function unitless(name) {
  const units = { mm: "mm", cm2: "cm²", deg: "°", px: "px", m: "m", m2: "m²" };
  const words = name.split("_");
  const unit = units[words.at(-1)];
  return [(unit ? words.slice(0, -1) : words).join(" "), unit ? ` ${unit}` : ""];
}

export function showProposal(state, send) {
  const section = byId("proposal");
  const pending = state.pending;
  section.hidden = !pending;
  if (!pending) return;
  const view = state.views[pending.view_index];
  const low = pending.score !== null && pending.score < state.settings.auto_threshold.value;
  rebuild(byId("proposal-values"), [pending, state.settings.auto_threshold.value, state.layers?.revision], () => [
    make("h2", {}, `${pending.again ? "Again" : "Proposal"}: view ${pending.view_index} (${number(view.angle_deg, 0)}°)`),
    make("div", { class: `score${low ? " low" : ""}`, data: { tip: `Score of the present place, 0 to 1. Auto accepts from ${state.settings.auto_threshold.value}.` } },
      make("meter", { min: 0, max: 1, value: pending.score ?? 0, "aria-label": "Score" }),
      make("strong", {}, pending.score === null ? "no score" : number(pending.score, 2)),
      make("span", {}, low ? "below Auto's limit" : "score")),
    make("details", { class: "parts", id: "parts-of-score", open: localStorage.getItem("flatcloth-parts") === "open", on: { toggle: (event) => localStorage.setItem("flatcloth-parts", event.target.open ? "open" : "closed") } },
      make("summary", {}, "Parts of the score"),
      make("dl", { class: "values" }, ...Object.entries(pending.parts).flatMap(([name, value]) => {
      const [words, unit] = unitless(name);
      return [make("dt", {}, words), make("dd", {}, value === null ? "–" : `${number(value, Math.abs(value) >= 100 ? 0 : 2)}${unit}`)];
      })),
      ...(pending.cameras ? [make("p", { class: "why", data: { tip: "What the registration of all views in space found" } }, pending.cameras.replaceAll("+-", "±"))] : [])),
    make("dl", { class: "values" },
      make("dt", { data: { tip: "What you have moved the proposal by: its centre by u, v on the plane, and clockwise" } }, "moved"),
      make("dd", {}, `${vector([pending.nudge.u_mm, pending.nudge.v_mm])} mm  ${degrees(pending.nudge.theta_deg)}`)),
    pending.margin === null ? null : make("p", { data: { tip: "How much more sure this place is than the second best" } },
      `Margin to the second best: ${number(pending.margin, 2)}`),
    pending.undetermined.length ? make("p", { class: "why" }, `Not determined: ${pending.undetermined.join(", ")}`) : null,
    pending.hypotheses.length > 1 ? make("div", { class: "places", role: "group", "aria-label": "Places found" },
      ...pending.hypotheses.map((h, index) => make("button", {
        type: "button", "aria-label": `${SOURCES[h.source]}, score ${number(h.score, 2)}`, data: { id: `place-${index}`, tip: `${SOURCES[h.source]}: ${vector([h.u_mm, h.v_mm])} mm, ${degrees(h.theta_deg)}. Click: lay it there.` },
        on: { click: () => send({ type: "choose", view_index: pending.view_index, index }) },
      }, make("img", { src: `/hypothesis/${state.layers.revision}-${pending.view_index}/${index}.png`, alt: "", width: 108, height: 75 }),
      make("span", {}, `${SHORT_SOURCES[h.source]} ${number(h.score, 2)}`)))) : null,
    pending.why ? make("p", { class: "asked-again" }, pending.why) : null,
    pending.reason ? make("p", { class: "why" }, pending.reason.replaceAll("cm2", "cm²")) : null,
  ].filter(Boolean));
}

const SHORT_SOURCES = { place: "Space", lines: "Lines", correlation: "Correlation" };
const SOURCES = { place: "Place in space", lines: "Z-angle lines", correlation: "Correlation" };

// --- picks -------------------------------------------------------------------------------------

export function pickText(pick) {
  return [
    `name\t${pick.name}`,
    `position_held_m\t${pick.position_held_m.map((x) => x.toFixed(5)).join(" ")}`,
    `position_camera_m\t${pick.position_camera_m.map((x) => x.toFixed(5)).join(" ")}\t(rotation ${pick.angle_deg} deg)`,
    `normal_held\t${pick.normal_held.map((x) => (x === null ? "nan" : x.toFixed(5))).join(" ")}`,
    `normal_camera\t${pick.normal_camera.map((x) => (x === null ? "nan" : x.toFixed(5))).join(" ")}`,
    `view\t${pick.view_index}`,
    `source_row_col\t${pick.source_rc.map((x) => x.toFixed(2)).join(" ")}`,
    `miss_m\t${pick.miss_m.toFixed(5)}`,
    ...(pick.grip ? [
      `approach_held\t${pick.grip.approach_held.map((x) => x.toFixed(5)).join(" ")}`,
      `axis_held\t${pick.grip.axis_held.map((x) => x.toFixed(5)).join(" ")}\t(${AXIS_FROM[pick.grip.axis_from]})`,
      `opening_m\t${pick.grip.opening_m.toFixed(4)}`,
    ] : []),
  ].join("\n");
}

const AXIS_FROM = { outline: "along the outline", hand: "by hand", level: "level: no outline nearby" };
const OPENING_MM = [5, 300];

const stdMm = (metres) => (metres !== null && metres < 1e-4 ? "< 0.1 mm" : `${number(metres === null ? null : 1000 * metres)} mm`);

/** The grip of a pick: axis on the plane, opening, and how surely it is known. */
function gripTools(pick, send) {
  const grip = pick.grip;
  const change = (field, scale) => (event) => {
    const value = event.target.valueAsNumber;
    if (Number.isFinite(value)) send({ type: "grip", id: pick.id, [field]: value * scale });
  };
  const row = (name, text, tip) => [make("dt", { data: { tip } }, name), make("dd", {}, text)];
  const outline = grip.axis_from === "outline";
  const away = grip.outline_distance_m === null ? "–" : `${number(1000 * grip.outline_distance_m, 0)} mm away`;
  const noAxis = grip.axis_deg === null ? "The pick is not on the present shape." : null;
  return [
    make("div", { class: "grip", role: "group", "aria-label": "Grip" },
      make("label", { class: "field", data: { tip: "Direction of the gripper's axis on the flattened view, clockwise from right; the fingers close across it" } },
        make("span", {}, "Axis °"),
        make("input", { type: "number", step: 5, min: -180, max: 180, value: grip.axis_deg === null ? null : Math.round(grip.axis_deg), disabled: noAxis !== null,
          data: { id: "grip-axis" }, on: { change: change("axis_deg", 1) } })),
      make("button", { type: "button", class: "button small", "aria-pressed": String(outline), data: { id: "grip-outline", tip: `Lay the axis along the nearest outline\nNow: ${AXIS_FROM[grip.axis_from]}` },
        on: { click: () => send({ type: "grip", id: pick.id, outline: true }) } }, "Outline"),
      make("label", { class: "field", data: { tip: "Distance of the fingers" } },
        make("span", {}, "Open mm"),
        make("input", { type: "number", step: 5, min: OPENING_MM[0], max: OPENING_MM[1], value: Math.round(1000 * grip.opening_m),
          data: { id: "grip-opening" }, on: { change: change("opening_m", 0.001) } }))),
    make("dl", { class: "values" },
      ...row("outline", away, "Distance to the nearest outline of the cloth, on the flattened view"),
      ...row("known to", stdMm(grip.position_std_m), "One standard deviation in space, from the scatter of depth nearby"),
      ...row("normal, axis", `${degrees(grip.normal_std_deg, 0)}, ${degrees(grip.axis_std_deg, 0)}`,
        "One standard deviation of each, from the scatter of normals and outline nearby"),
      ...(grip.placement_std_m === null ? [] : row("place", stdMm(grip.placement_std_m), "One standard deviation of its place on the flattened plane"))),
  ];
}

export function showPick(state, copy, send) {
  const pick = state.pick;
  rebuild(byId("pick"), [pick, Boolean(state.layers)], () => {
    if (!pick) {
      return [make("h2", {}, "Pick"), make("p", { class: "nothing" },
        state.layers ? "Click the cloth, flat or in 3D, to get its grasp point." : "Grasp points can be picked once a view is flattened.")];
    }
    const row = (name, text, tip) => [make("dt", { data: { tip } }, name), make("dd", {}, text)];
    return [
      make("div", { class: "heading" }, make("h2", {}, pick.name),
        make("button", { type: "button", class: "button small", data: { id: "copy", tip: "Copy all numbers in metres" }, on: { click: copy } }, "Copy", make("kbd", {}, "C"))),
      make("dl", { class: "values" },
        ...row("held", `${vector(pick.position_held_m, 1, 1000)} mm`, "Position x y z in the held frame"),
        ...row(`camera ${number(pick.angle_deg, 0)}°`, `${vector(pick.position_camera_m, 1, 1000)} mm`, "Position x y z in the camera frame at the present rotation"),
        ...row("normal", vector(pick.normal_held, 3), "Outward normal in the held frame"),
        ...row("n. camera", vector(pick.normal_camera, 3), "Outward normal in the camera frame at the present rotation"),
        ...row("Z-angle", degrees(pick.z_angle_deg), "Z-angle at which the pixel was seen"),
        ...row("source", `view ${pick.view_index} @ ${pick.source_rc.map((x) => number(x)).join(", ")}`, "View and image pixel (row, column) it was measured in"),
        ...row("pixel", pick.in_shape ? pick.rc.join(", ") : "–", "Row, column of the flattened view"),
        ...row("miss", pick.miss_m > 0 ? `${number(1000 * pick.miss_m)} mm` : "on the cloth", "Distance between the click and the nearest cloth")),
      ...(pick.grip ? gripTools(pick, send) : []),
      pick.in_shape ? null : make("p", { class: "why" }, "Its view is not part of the present shape."),
    ].filter(Boolean);
  });
}

/** `send` goes to the server. */
export function showPicks(state, send) {
  rebuild(byId("picks"), [state.picks, state.pick?.id ?? null], () => [
    make("div", { class: "heading" }, make("h2", {}, `Picks${state.picks.length ? ` (${state.picks.length})` : ""}`),
      state.picks.length
        ? make("a", { class: "button small", href: "/export/grasps.json", download: "grasps.json", data: { id: "export", tip: "Download all picks as grasps.json" } }, "Export")
        : null),
    state.picks.length ? make("ol", { class: "picks" }, ...state.picks.map((p) => pickRow(p, p.id === state.pick?.id, send)))
      : make("p", { class: "nothing" }, "Every pick is kept here: name it, show it again, export it."),
  ]);
}

function pickRow(pick, current, send) {
  const rename = (event) => {
    const name = event.target.value.trim();
    if (name && name !== pick.name) send({ type: "rename_pick", id: pick.id, name });
    else event.target.value = pick.name;
  };
  return make("li", { class: current ? "current" : "" },
    make("button", {
      type: "button", class: "show", "aria-label": `Show ${pick.name}`, "aria-pressed": String(current),
      data: { id: `show-${pick.id}`, tip: pick.uv_m ? "Show on both sides" : "Show in 3D; its view is not part of the present shape" },
      on: { click: () => send({ type: "show_pick", id: pick.id }) },
    }, pick.uv_m ? "◎" : "○"),
    make("input", {
      value: pick.name, maxlength: 80, "aria-label": `Name of ${pick.name}`, data: { id: `name-${pick.id}` },
      on: { change: rename, keydown: (e) => { if (e.key === "Enter") e.target.blur(); if (e.key === "Escape") { e.target.value = pick.name; e.target.blur(); } } },
    }),
    make("button", {
      type: "button", class: "close", "aria-label": `Delete ${pick.name}`, data: { id: `delete-${pick.id}`, tip: "Delete" },
      on: { click: () => send({ type: "delete_pick", id: pick.id }) },
    }, "×"));
}

// --- timeline ----------------------------------------------------------------------------------

export function showTimeline(state, choose) {
  const live = state.mode === "live";
  rebuild(byId("timeline"), state.views, () => state.views.map((view) => {
    const [sign, word] = STATES[view.state];
    const detail = view.detail ? ` (${view.detail})` : "";
    const kept = ["start", "pending"].includes(view.state);
    const decided = !kept && view.state !== "unused";
    const act = state.capture ? "\nOn disk." : live ? "\nClick: show this frame." : decided ? "\nClick: look at the decision, reopen it." : view.why_not === null ? "\nClick: propose this view." : kept ? "" : `\nNot now: ${view.why_not}`;
    const about = `View ${view.index}, ${number(view.angle_deg, 0)}°${live ? "" : `: ${word}${detail}`}`;
    return make("button", {
      type: "button", class: `view ${view.state}`, "aria-disabled": String(view.why_not !== null && !decided), "aria-label": about,
      data: { id: `view-${view.index}`, tip: about + act }, on: { click: () => choose(view) },
    }, make("span", { class: "sign", "aria-hidden": "true" }, live ? String(view.index) : sign), make("span", { class: "angle" }, number(view.angle_deg, 0)));
  }));
  if (!live) markPresent(state.present_view); // in live mode each frame does
}

/** Mark the view at whose rotation the item stands. */
export function markPresent(index) {
  const views = byId("timeline").children;
  for (const view of byId("timeline").querySelectorAll(".present")) {
    if (view === views[index]) return;
    view.classList.remove("present");
    view.removeAttribute("aria-current");
  }
  views[index]?.classList.add("present");
  views[index]?.setAttribute("aria-current", "true");
}
