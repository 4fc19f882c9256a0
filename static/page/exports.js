// The sheet of exports: each is made by the server on request, and then saved.

import { ask } from "./connection.js";
import { byId, make, rebuild, setText } from "./dom.js";
import { cm2, number } from "./format.js";

/** Let each button that names a file make and save it; `notify` reports what became of it. */
export function startExports(/** @type {Notify} */ notify, /** @type {() => State} */ stateNow) {
  document.addEventListener("click", ({ target }) => {
    const made = /** @type {HTMLElement} */ (target).closest?.("[data-file]");
    if (made) save(/** @type {HTMLElement} */ (made), notify, stateNow().recording.name);
  });
  byId("hand-eye").addEventListener("change", () => takeHandEye(notify));
}

/** Open the sheet of exports. A piece that floats has a file of its own. */
export function showExports(/** @type {State} */ { layers }) {
  const pieces = layers?.pieces ?? [];
  rebuild(byId("export-pieces"), pieces, () =>
    pieces.map(({ label, file, area_cm2 }) => [
      make("dt", make("button.button", { data: { file } }, `Piece ${label}, NPZ`)),
      make("dd", `The floating piece ${label} (${cm2(area_cm2)}), on a plane of its own.`),
    ]),
  );
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

/** @param {HTMLElement} button @param {Notify} notify @param {string} name */
async function save(button, notify, name) {
  if (button.getAttribute("aria-busy") === "true") return;
  const [file, title] = [button.dataset.file, button.textContent ?? ""];
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
