// The sheet of exports: each is made by the server on request, and then saved.

import { make, setText } from "/static/page/dom.js";

/** @type {[string, string, string][]} */
const KINDS = [
  [
    "page.html",
    "Offline page",
    "3D timeline and flattened view with the picks in one HTML file; needs no server and no network.",
  ],
  ["report.html", "Report", "To print: recording, settings, each decision, picks and figures."],
  ["figures.zip", "Figures", "Every map, curve and decision as PNG and SVG."],
  ["growth.gif", "Animation, GIF", "The growth of the shape, view by view."],
  ["growth.mp4", "Animation, MP4", "The same as a video."],
  ["outline.svg", "Outline, SVG", "The outline of the shape in mm, 1:1, to print or cut."],
  ["outline.dxf", "Outline, DXF", "The same for CAD and cutting machines."],
  ["outline.json", "Outline, JSON", "The same as polygons in mm, to compute with."],
  ["grasps.json", "Grasp poses", "The picks with their poses, as JSON."],
];

let sheet = null;

/** Open the sheet; `notify` reports errors, `name` is that of the recording. */
export function showExports(notify, name) {
  sheet ??= build();
  sheet.buttons.forEach((button, i) => (button.onclick = () => save(button, KINDS[i], notify, name)));
  sheet.dialog.showModal();
}

function build() {
  const buttons = KINDS.map(([file, title]) =>
    make("button", { type: "button", class: "button", data: { id: file } }, title),
  );
  const rows = KINDS.flatMap(([, , about], i) => [make("dt", {}, buttons[i]), make("dd", {}, about)]);
  const dialog = make(
    "dialog",
    { class: "sheet", "aria-labelledby": "exports-title" },
    make("h2", { id: "exports-title" }, "Take away"),
    make("dl", { class: "exports" }, ...rows),
    make("form", { method: "dialog" }, make("button", { class: "button", autofocus: true }, "Close")),
  );
  document.body.append(dialog);
  return { dialog, buttons };
}

async function save(button, kind, notify, name) {
  const [file, title] = kind;
  if (button.getAttribute("aria-busy") === "true") return;
  button.setAttribute("aria-busy", "true");
  setText(button, "Preparing …");
  try {
    const response = await fetch(`/export/${file}`);
    if (!response.ok) throw new Error(await response.text());
    const address = URL.createObjectURL(await response.blob());
    make("a", { href: address, download: `${name.replace(/[^\w.-]+/g, "-")}-${file}` }).click();
    setTimeout(() => URL.revokeObjectURL(address), 60000);
    notify("info", `${title}: saved.`);
  } catch (error) {
    notify("error", `${title}: ${error.message || "there is no connection"}`);
  } finally {
    button.removeAttribute("aria-busy");
    setText(button, title);
  }
}
