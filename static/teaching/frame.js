// The page of the teaching mode, with what its stages say (stages.html), and what each of them draws.

import { byId, find, findAll, make, setAllowed, setText, swatch } from "../page/dom.js";
import { keyName } from "../page/format.js";
import { ADDING_STAGES } from "./adding.js";
import { BEYOND_STAGES } from "./beyond.js";
import { FLATTENING_STAGES } from "./flattening.js";

/** @type {Record<string, StageCode<any>>} by the names of the pages, which have their order */
const CODE = { ...FLATTENING_STAGES, ...ADDING_STAGES, ...BEYOND_STAGES };
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
  const [frame, said] = await Promise.all(
    ["teaching", "stages"].map(async (name) => {
      const html = await (await fetch(`static/teaching/${name}.html`)).text();
      return new DOMParser().parseFromString(html, "text/html");
    }),
  );
  FRAME.append(...frame.body.children);
  find("dl", FRAME).before(...said.body.children);
  for (const about of findAll("[data-stage]", FRAME)) {
    const { stage = "", part, parameters } = about.dataset;
    STAGES.push({
      about,
      name: find("h3", about).textContent ?? "",
      part: /** @type {PartName} */ (part),
      parameters: /** @type {ParameterName[]} */ (parameters?.split(" ") ?? []),
      ...CODE[stage],
    });
  }
}

/** Let the elements speak to the teaching mode; once. */
export function connectFrame(/** @type {Teaching} */ mode) {
  document.body.append(FRAME);
  for (const button of findAll("[data-teach]", FRAME)) {
    const name = button.dataset.teach ?? "";
    const { title, keys } = mode.page.action(name);
    if (!button.childElementCount) button.append(make("span", title));
    button.append(make("kbd", keyName(keys[0])));
    setAllowed(button, null, mode.page.tip(name));
    button.addEventListener("click", () => mode.page.run(name));
  }
  byId("teaching-again").addEventListener("click", () => mode.again());
  byId("teaching-reset").addEventListener("click", () => mode.change(null));
  const valueOf = (/** @type {Event} */ { target }) => /** @type {HTMLInputElement} */ (target).valueAsNumber;
  byId("teaching-time").addEventListener("input", (event) => mode.scrub(valueOf(event)));
  for (const label of findAll("[data-slider]", FRAME))
    label.addEventListener("input", (event) => mode.change({ [label.dataset.slider ?? ""]: valueOf(event) }));
  for (const mark of findAll("[data-color]", FRAME)) mark.prepend(swatch(`var(--${mark.dataset.color})`));
  STAGES.forEach(({ about, name }, index) => {
    setText(find("h3", about), `${index + 1}. ${name}`);
    const place = make("span.teaching-number", { "aria-hidden": "true" }, String(index + 1));
    find(".teaching-stages ol", FRAME).append(
      make("li", make("button.teaching-stage", { click: () => mode.go(index) }, place, name)),
    );
  });
}

/** Text with the paper's symbols set as they are written: A_w becomes A with a small w. */
export function symbols(/** @type {string} */ text) {
  return text.split(/\b([A-Za-z]_[a-z0-9])\b/).map((piece) => {
    const found = /^([A-Za-z])_([a-z0-9])$/.exec(piece);
    return found ? make("span", make("i", found[1]), make("sub", found[2])) : piece;
  });
}
