// The sheet of exports: each is made by the server on request, and then saved.

import { ask } from "./connection.js";
import { button, byId, findAll, make, rebuild, setText } from "./dom.js";
import { cm2, number } from "./format.js";

/** Open the sheet of exports; `notify` reports what became of each. A piece that floats has a file of its own. */
export function showExports(/** @type {Notify} */ notify, /** @type {State} */ { layers, recording }) {
  const pieces = layers?.pieces ?? [];
  rebuild(byId("export-pieces"), pieces, () =>
    pieces.map(({ label, file, area_cm2 }) => [
      make("dt", make("button.button", { data: { file } }, `Piece ${label}, NPZ`)),
      make("dd", `The floating piece ${label} (${cm2(area_cm2)}), on a plane of its own.`),
    ]),
  );
  for (const made of findAll("[data-file]", byId("exports"))) {
    made.dataset.id = made.dataset.file;
    made.onclick = () => save(made, made.dataset.file ?? "", made.textContent ?? "", notify, recording.name);
  }
  byId("hand-eye").onchange = () => takeHandEye(notify);
  byId("exports").showModal();
}

/** Take the chosen file with the camera's pose at the robot: poses are in the robot's frame from then on. */
async function takeHandEye(/** @type {Notify} */ notify) {
  const chosen = byId("hand-eye").files?.[0];
  if (!chosen) return;
  const answer = await ask("hand-eye", { method: "POST", body: await chosen.text() });
  const { error } = answer ? await answer.json() : { error: "there is no connection" };
  const notice = error ? `${chosen.name}: ${error}` : `${chosen.name} is used: grasps.json has robot poses now.`;
  setText(byId("hand-eye-notice"), notice);
  notify(error ? "error" : "info", notice);
}

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
    const response = await fetch(`export/${file}`);
    if (!response.ok) throw new Error(await response.text());
    const address = URL.createObjectURL(await response.blob());
    make("a", { href: address, download: `${name.replace(/[^\w.-]+/g, "-")}-${file}` }).click();
    setTimeout(() => URL.revokeObjectURL(address), 60000);
    notify("info", `${title}: saved after ${number(seconds(), 0)} s.`);
  } catch (error) {
    notify("error", `${title}: ${/** @type {Error} */ (error).message || "there is no connection"}`);
  } finally {
    clearInterval(ticks);
    button.removeAttribute("aria-busy");
    setText(button, title);
  }
}
