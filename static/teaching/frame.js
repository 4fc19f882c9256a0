// The page of the teaching mode, with what its stages say (paper.html, beyond.html), and what each of them draws.

import {
  button as textButton,
  byId,
  find,
  findAll,
  make,
  rebuild,
  setAllowed,
  setText,
  swatch,
} from "../page/dom.js";
import { keyName, tipOf } from "../page/format.js";
import { ALIGNMENT_STAGES } from "./alignment.js";
import { FLATTENING_STAGES } from "./flattening.js";
import { GARMENT_STAGES } from "./garment.js";
import { PLANNING_STAGES } from "./rotation.js";
import { SIDE_STAGES } from "./sides.js";
import { RECORDING_STAGES } from "./recording.js";
import { SEAM_STAGES } from "./seams.js";
import { SHAPE_STAGES } from "./joints.js";

/** @type {Record<string, StageCode>} by the names of the pages, which have their order */
const CODE = {
  ...FLATTENING_STAGES,
  ...PLANNING_STAGES,
  ...ALIGNMENT_STAGES,
  ...SIDE_STAGES,
  ...GARMENT_STAGES,
  ...SEAM_STAGES,
  ...SHAPE_STAGES,
  ...RECORDING_STAGES,
};
export const FRAME = make("section#teaching.teaching", {
  role: "dialog",
  "aria-modal": "true",
  "aria-labelledby": "teaching-title",
  tabindex: "-1",
});
export const STAGES = /** @type {Stage[]} */ ([]);

/** Fetch the frame and what its stages say; before the teaching mode is made. */
export async function loadFrame() {
  if (STAGES.length) return;
  const [frame, ...said] = await Promise.all(
    ["teaching", "paper", "beyond"].map(async (name) => {
      const html = await (await fetch(`static/teaching/${name}.html`)).text();
      return new DOMParser().parseFromString(html, "text/html");
    }),
  );
  FRAME.append(...frame.body.children);
  find("dl", FRAME).before(...said.flatMap(({ body }) => [...body.children]));
  STAGES.push(...findAll("[data-stage]", FRAME).map(stageOf));
  addEventListener("resize", fitMath);
}

/** @returns {Stage} */
function stageOf(/** @type {HTMLElement} */ about) {
  const { stage, part, parameters } = about.dataset;
  return {
    about,
    name: find("h3", about).textContent ?? "",
    part: /** @type {PartName} */ (part),
    parameters: /** @type {ParameterName[]} */ (parameters?.split(" ") ?? []),
    ...CODE[stage ?? ""],
  };
}

/** An action of the page's table. @param {Teaching} mode @param {string} name */
export const action = (mode, name) => /** @type {ActionRow} */ (mode.session.actions().find((a) => a.name === name));

/** Let the elements speak to the teaching mode; once. */
export function connectFrame(/** @type {Teaching} */ mode) {
  document.body.append(FRAME);
  for (const button of findAll("[data-teach]", FRAME)) {
    const name = button.dataset.teach ?? "";
    const { title, keys } = action(mode, name);
    if (!button.childElementCount) button.append(make("span", title));
    button.append(make("kbd", keyName(keys[0])));
    setAllowed(button, null, tipOf(action(mode, name)));
    button.addEventListener("click", () => mode.session.run(name));
  }
  find("kbd", byId("teaching-cancel")).textContent = keyName(action(mode, "cancel").keys[0]);
  const clicks = { again: mode.again, defaults: mode.reset, reset: mode.reset, cancel: mode.giveUp };
  for (const [id, act] of Object.entries(clicks)) byId(`teaching-${id}`).addEventListener("click", act.bind(mode));
  byId("teaching-time").addEventListener("input", (event) => mode.scrub(valueOf(event)));
  for (const label of findAll("[data-slider]", FRAME))
    label.addEventListener("input", (event) => mode.change(label.dataset.slider ?? "", valueOf(event)));
  for (const mark of findAll("[data-color]", FRAME)) {
    const [color, alpha = "1"] = (mark.dataset.color ?? "").split(" ");
    mark.prepend(swatch(`color-mix(in srgb, var(--${color}) ${100 * Number(alpha)}%, transparent)`));
  }
  STAGES.forEach(({ about, name }, index) => setText(find("h3", about), `${index + 1}. ${name}`));
  find(".teaching-stages", FRAME).append(...findAll("[data-group]", FRAME).flatMap((group) => listOf(mode, group)));
}

const valueOf = (/** @type {Event} */ { target }) => /** @type {HTMLInputElement} */ (target).valueAsNumber;

/** The stages of a group, to choose from. @param {Teaching} mode @param {HTMLElement} group */
function listOf(mode, group) {
  const stages = STAGES.filter(({ about }) => group.contains(about));
  const items = stages.map((stage) => {
    const index = STAGES.indexOf(stage);
    const number = make("span.teaching-number", { "aria-hidden": "true" }, String(index + 1));
    return make("li", make("button.teaching-stage", { click: () => mode.go(index) }, number, stage.name));
  });
  return [make("h3", group.dataset.group ?? ""), make("ol", { start: STAGES.indexOf(stages[0]) + 1 }, ...items)];
}

/** Text with the paper's symbols set as they are written: A_w becomes A with a small w. */
export function symbols(/** @type {string} */ text) {
  return text.split(/\b([A-Za-z]_[a-z0-9])\b/).map((piece) => {
    const found = /^([A-Za-z])_([a-z0-9])$/.exec(piece);
    return found ? make("span", make("i", found[1]), make("sub", found[2])) : piece;
  });
}

/** Make the formulas of the shown stage smaller where a font makes them wider than the column. */
export function fitMath() {
  const box = find("[data-stage]:not([hidden]) .teaching-math", FRAME);
  let fit = 1;
  const use = () => box.style.setProperty("--fit", String(fit));
  for (use(); box.scrollWidth > box.clientWidth && fit > 0.6; use()) fit -= 0.02;
}

/**
 * The layers of a stage that has several to show: those of which the lesson has a picture.
 * @param {Teaching} teaching @param {Stage} stage @param {Lesson} lesson
 */
export function showLayers(teaching, stage, lesson) {
  const box = byId("teaching-layers");
  box.hidden = !stage.layers;
  const shown = Object.entries(stage.layers ?? {}).filter(([layer]) => lesson.picture[layer]);
  rebuild(box, [shown, teaching.ui.layer], () =>
    shown.map(([key, title]) => {
      const choose = () => {
        teaching.ui.layer = key;
        teaching.update();
      };
      return textButton(title, choose, { key, pressed: key === teaching.ui.layer });
    }),
  );
}
