// The elements of the teaching mode, made once: bar, stages, drawing, words, sliders, and the way on.

import {
  button as textButton,
  byId,
  make,
  setAllowed,
  setPressed,
  slider as rangeOf,
  smallButton,
} from "/static/page/dom.js";
import { keyName, number } from "/static/page/format.js";
import { SEAM_STAGES } from "/static/both/teaching.js";
import { FLATTENING_STAGES } from "/static/teaching/fig2.js";
import { EXTENDING_STAGES } from "/static/teaching/fig4.js";
import { GARMENT_STAGES } from "/static/teaching/garment.js";
import { SIDE_STAGES } from "/static/teaching/sides.js";
import { START_STAGES } from "/static/review/start_lesson.js";
import { CHECK_STAGES } from "/static/review/check_lesson.js";

/** @type {[string, Stage[]][]} */
const GROUPS = [
  ["Flattening one view", FLATTENING_STAGES],
  ["Where it begins", START_STAGES],
  ["Adding the next view", EXTENDING_STAGES],
  ["Without masks", SIDE_STAGES],
  ["Which garment it is", GARMENT_STAGES],
  ["Both sides", SEAM_STAGES],
  ["Is the recording right?", CHECK_STAGES],
];
export const STAGES = GROUPS.flatMap(([, stages]) => stages);

/** @type {Record<string, [symbol: string, meaning: string, text: (x: number) => string]>} */
export const SLIDERS = {
  sampling_interval_px: ["d", "sampling interval", (x) => `${number(x, 0)} px`],
  z_angle_limit_deg: ["A_w", "measurement limit", (x) => `${number(x, 0)}°`],
  overlap_cm2: ["S_0", "desired overlap", (x) => `${number(x, 0)} cm²`],
};

/** An action of the page's table. @param {Teaching} mode @param {string} name */
export const action = (mode, name) => /** @type {ActionRow} */ (mode.session.actions().find((a) => a.name === name));

/** Make everything; `mode` is the teaching mode that the elements speak to. */
export function makeFrame(/** @type {Teaching} */ mode) {
  const item = (/** @type {Stage} */ stage) => {
    const index = STAGES.indexOf(stage);
    return make(
      "li",
      make(
        "button.teaching-stage",
        { data: { stage: index }, click: () => mode.go(index) },
        make("span.teaching-number", { "aria-hidden": "true" }, String(index + 1)),
        stage.name,
      ),
    );
  };
  return make(
    "section#teaching.teaching",
    { role: "dialog", "aria-modal": "true", "aria-labelledby": "teaching-title", tabindex: "-1" },
    make(
      "header.teaching-bar",
      make("h2#teaching-title", "How flatcloth works"),
      make("p#teaching-recording.recording"),
      make("div.actions.quiet", pageButton(mode, "theme"), pageButton(mode, "help")),
      button(mode, "teach", { id: "teaching-leave" }, "Leave"),
    ),
    make(
      "nav.teaching-stages",
      { label: "Stages" },
      ...GROUPS.flatMap(([title, stages]) => [
        make("h3", title),
        make("ol", { start: STAGES.indexOf(stages[0]) + 1 }, ...stages.map(item)),
      ]),
    ),
    make(
      "div.teaching-drawing",
      make(
        "div.teaching-sheet",
        mode.canvas,
        make(
          "div#teaching-trouble.teaching-trouble",
          { role: "alert", hidden: true },
          make("p#teaching-trouble-text"),
          make(
            "div.group",
            textButton("Try again", () => mode.again(), { id: "teaching-again" }),
            textButton("Reset", () => mode.reset(), { id: "teaching-defaults" }),
          ),
        ),
      ),
      make(
        "div#teaching-player.teaching-player",
        { hidden: true },
        button(mode, "teach_play", { id: "teaching-play" }),
        rangeOf([0, 1, 0.01], 0, {
          id: "teaching-time",
          label: "Place in the animation",
          input: (event) => mode.scrub(event.target.valueAsNumber),
        }),
      ),
      make("div#teaching-layers.segmented.teaching-layers", { role: "group", label: "Layer", hidden: true }),
    ),
    make(
      "div.teaching-side",
      make(
        "article.teaching-text",
        { tabindex: "0", label: "About this stage" },
        make("p#teaching-figure.teaching-figure"),
        make("h3#teaching-name"),
        make("div#teaching-words.teaching-words"),
        make("div#teaching-math.teaching-math"),
        make("ul#teaching-legend.teaching-legend", { label: "Legend" }),
        make("dl#teaching-facts.values.teaching-facts"),
      ),
      make(
        "fieldset#teaching-sliders.teaching-sliders",
        make("legend", "Try other values"),
        smallButton("Reset", () => mode.reset(), { id: "teaching-reset" }),
        ...Object.keys(SLIDERS).map((name) => slider(mode, name)),
      ),
    ),
    make(
      "footer.teaching-foot",
      button(mode, "teach_back", { id: "teaching-back" }),
      make(
        "div.teaching-middle",
        make("p#teaching-place.teaching-place", { "aria-live": "polite" }),
        make(
          "div#teaching-progress.progress",
          { hidden: true },
          make("span#teaching-progress-text"),
          make("progress#teaching-progress-bar", { max: 1, value: 0, "aria-labelledby": "teaching-progress-text" }),
          make(
            "button#teaching-cancel.button.small",
            { click: () => mode.giveUp() },
            "Cancel",
            make("kbd", keyName(action(mode, "cancel").keys[0])),
          ),
        ),
      ),
      button(mode, "teach_next", { id: "teaching-next" }),
    ),
  );
}

/** @param {Teaching} mode @param {string} name @param {object} attributes */
function button(mode, name, attributes, title = "") {
  const { title: usual, keys } = action(mode, name);
  const made = make(
    "button.button",
    { click: () => mode.takes(name), ...attributes },
    make("span", title || usual),
    make("kbd", keyName(keys[0])),
  );
  setAllowed(made, null, mode.session.tip(action(mode, name)));
  return made;
}

/** @param {Teaching} mode @param {string} name */
const pageButton = (mode, name) => button(mode, name, { click: () => mode.session.run(name) });

function slider(/** @type {Teaching} */ mode, /** @type {string} */ name) {
  const [symbol, about] = SLIDERS[name];
  const spoken = symbol.replace("_", " ");
  return make(
    "label.teaching-slider",
    { tip: `${spoken}: ${about}`, data: { slider: name } },
    make("span.teaching-symbol", symbol.includes("_") ? symbols(symbol) : [make("i", symbol)]),
    make("span.teaching-about", about),
    make("output"),
    make("input", {
      type: "range",
      label: `${spoken}, ${about}`,
      input: (event) => mode.change(name, Number(event.target.value)),
    }),
  );
}

/** Text with the paper's symbols set as they are written: A_w becomes A with a small w. */
export function symbols(/** @type {string} */ text) {
  return text.split(/\b([A-Za-z]_[a-z0-9])\b/).map((piece) => {
    const found = /^([A-Za-z])_([a-z0-9])$/.exec(piece);
    return found ? make("span", make("i", found[1]), make("sub", found[2])) : piece;
  });
}

/** Show the formulas of a stage, smaller where a font makes them wider than the column. */
export function showMath(/** @type {Element[]} */ formulas) {
  byId("teaching-math").replaceChildren(...formulas);
  fitMath();
}

function fitMath() {
  const box = byId("teaching-math");
  box?.style.setProperty("--fit", "1");
  if (box && box.scrollWidth > box.clientWidth)
    box.style.setProperty("--fit", String(Math.max(0.6, (0.98 * box.clientWidth) / box.scrollWidth)));
}

addEventListener("resize", fitMath);

/** The layers of a stage that has several to show. */
export function showLayers(/** @type {Teaching} */ teaching, /** @type {Stage} */ stage) {
  const box = byId("teaching-layers");
  box.hidden = !stage.layers;
  box.replaceChildren(
    ...Object.entries(stage.layers ?? {}).map(([layer, title]) =>
      textButton(
        title,
        () => {
          teaching.ui.layer = layer;
          for (const other of box.children) setPressed(other, other.textContent === title);
          teaching.update();
        },
        { pressed: layer === teaching.ui.layer },
      ),
    ),
  );
}
