// The sheet of exports: each is made by the server on request, and then saved.

import { ask } from "/static/page/connection.js";
import { button, field, make, setText, sheet, showSheet } from "/static/page/dom.js";
import { cm2, number } from "/static/page/format.js";

/**
 * File, title, what it is; a piece that floats has a file of its own.
 *
 * @typedef {[file: string, title: string, about: string]} Kind
 *
 * @type {Record<string, Kind[]>}
 */
const GROUPS = {
  Data: [
    [
      "data.zip",
      "All data, ZIP",
      "Everything of this group: shape, pieces, cloud, grasps and report, as run writes them.",
    ],
    ["flattened.npz", "Shape, NPZ", "Color, 3D point, normal, source view and uncertainty of each pixel."],
    ["cloud.ply", "Cloud, PLY", "The 3D points of the shape with color, normal and place on the plane."],
    ["flattened.png", "Picture, PNG", "The flattened shape, transparent off the cloth."],
    ["grasps.json", "Grasp poses", "The picks with their poses, as JSON."],
    ["outcome.json", "Outcome", "Each view with its score and flags, views left out and why, areas."],
  ],
  Documents: [
    [
      "page.html",
      "Offline page",
      "3D timeline and flattened view with the picks in one HTML file; needs no server and no network.",
    ],
    ["report.html", "Report", "To print: recording, settings, each decision, picks and figures."],
    ["figures.zip", "Figures", "Every map, curve and decision as PNG and SVG."],
    ["growth.gif", "Animation, GIF", "The growth of the shape, view by view."],
    ["growth.mp4", "Animation, MP4", "The same as a video."],
  ],
  Outline: [
    ["outline.svg", "Outline, SVG", "The outline of the shape in mm, 1:1, to print or cut."],
    ["outline.dxf", "Outline, DXF", "The same for CAD and cutting machines."],
    ["outline.json", "Outline, JSON", "The same as polygons in mm, to compute with."],
  ],
};

/** Open the sheet of exports; `notify` reports what became of each. */
export function showExports(/** @type {Notify} */ notify, /** @type {State} */ state) {
  const sections = groups(notify, state);
  showSheet(sheet("#exports.sheet", "Export", make("div.export-groups", ...sections)));
}

function groups(/** @type {Notify} */ notify, /** @type {State} */ state) {
  /** @type {Kind[]} */
  const pieces = (state.layers?.pieces ?? []).map(({ label, file, area_cm2 }) => [
    file,
    `Piece ${label}, NPZ`,
    `The floating piece ${label} (${cm2(area_cm2)}), on a plane of its own.`,
  ]);
  const row = (/** @type {Kind} */ [file, title, about]) => [
    make("dt", exportButton(file, title, notify, state.recording.name)),
    make("dd", about, took()[file] ? ` Took ${number(took()[file], 0)} s last time.` : ""),
  ];
  const sections = Object.entries(GROUPS).map(([title, kinds]) => {
    const rows = title === "Data" ? [...kinds.slice(0, 2), ...pieces, ...kinds.slice(2)] : kinds;
    return make("section", make("h3", title), make("dl.exports", ...rows.map(row)));
  });
  return [...sections, handEye(notify)];
}

/** Choose the file with the camera's pose at the robot: poses are in the robot's frame from then on. */
function handEye(/** @type {Notify} */ notify) {
  const told = make("dd", { role: "status" }, "Grasp poses are in the robot's frame, too, until the page ends.");
  const file = make("input", {
    type: "file",
    accept: ".json,application/json",
    key: "hand-eye",
    label: "Hand-eye file",
    change: async ({ target }) => {
      const chosen = target.files?.[0];
      if (!chosen) return;
      const answer = await ask("/hand-eye", { method: "POST", body: await chosen.text() });
      const { error } = answer ? await answer.json() : { error: "there is no connection" };
      setText(told, error ? `${chosen.name}: ${error}` : `${chosen.name} is used: grasps.json has robot poses now.`);
      notify(error ? "error" : "info", told.textContent ?? "");
    },
  });
  return make("section", make("h3", "Robot"), make("dl.exports", make("dt", field("Hand-eye", file)), told));
}

const TOOK = "flatcloth-export-seconds";

/** How long each export took last, in this browser. @returns {Record<string, number>} */
const took = () => JSON.parse(localStorage.getItem(TOOK) ?? "{}");

/**
 * A button that makes one export and saves it.
 * @param {string} file @param {string} title @param {Notify} notify @param {string} name
 */
export function exportButton(file, title, notify, name, kind = "") {
  const made = button(title, () => save(made, file, title, notify, name), { class: kind, key: file });
  return made;
}

/**
 * @param {HTMLElement} button @param {string} file @param {string} title
 * @param {Notify} notify @param {string} name
 */
async function save(button, file, title, notify, name) {
  if (button.getAttribute("aria-busy") === "true") return;
  button.setAttribute("aria-busy", "true");
  const begun = performance.now();
  const seconds = () => (performance.now() - begun) / 1000;
  setText(button, "Preparing …");
  const ticks = setInterval(() => setText(button, `Preparing … ${number(seconds(), 0)} s`), 1000);
  try {
    const response = await fetch(`/export/${file}`);
    if (!response.ok) throw new Error(await response.text());
    const address = URL.createObjectURL(await response.blob());
    make("a", { href: address, download: `${name.replace(/[^\w.-]+/g, "-")}-${file}` }).click();
    setTimeout(() => URL.revokeObjectURL(address), 60000);
    localStorage.setItem(TOOK, JSON.stringify({ ...took(), [file]: Math.max(1, Math.round(seconds())) }));
    notify("info", `${title}: saved after ${number(seconds(), 0)} s.`);
  } catch (error) {
    notify("error", `${title}: ${/** @type {Error} */ (error).message || "there is no connection"}`);
  } finally {
    clearInterval(ticks);
    button.removeAttribute("aria-busy");
    setText(button, title);
  }
}
