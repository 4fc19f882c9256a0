// The elements of the teaching mode, made once: bar, stages, drawing, words, sliders, and the way on.

import { byId, make, setAllowed } from "/static/page/dom.js";
import { keyName, number } from "/static/page/format.js";
import { FLATTENING_STAGES } from "/static/teaching/fig2.js";
import { EXTENDING_STAGES } from "/static/teaching/fig4.js";
import { GARMENT_STAGES } from "/static/teaching/garment.js";
import { SIDE_STAGES } from "/static/teaching/sides.js";

/** @type {[string, any[]][]} */
const GROUPS = [
  ["Flattening one view", FLATTENING_STAGES],
  ["Adding the next view", EXTENDING_STAGES],
  ["Without masks", SIDE_STAGES],
  ["Which garment it is", GARMENT_STAGES],
];
export const STAGES = GROUPS.flatMap(([, stages]) => stages);

/** The parameters: symbol, meaning, and their value as text. */
export const SLIDERS = {
  sampling_interval_px: ["d", "sampling interval", (x) => `${number(x, 0)} px`],
  z_angle_limit_deg: ["A_w", "measurement limit", (x) => `${number(x, 0)}°`],
  overlap_cm2: ["S_0", "desired overlap", (x) => `${number(x, 0)} cm²`],
};

/** An action of the page's table. */
export const action = (mode, name) => mode.session.actions().find((a) => a.name === name);

/** Make everything; `mode` is the teaching mode that the elements speak to. */
export function makeFrame(mode) {
  const item = (stage) => {
    const index = STAGES.indexOf(stage);
    return make(
      "li",
      {},
      make(
        "button",
        { type: "button", class: "teaching-stage", data: { stage: index }, on: { click: () => mode.go(index) } },
        make("span", { class: "teaching-number", "aria-hidden": "true" }, String(index + 1)),
        stage.name,
      ),
    );
  };
  return make(
    "section",
    {
      id: "teaching",
      class: "teaching",
      role: "dialog",
      "aria-modal": "true",
      "aria-labelledby": "teaching-title",
      tabindex: "-1",
    },
    make(
      "header",
      { class: "teaching-bar" },
      make("h2", { id: "teaching-title" }, "How flatcloth works"),
      make("p", { id: "teaching-recording", class: "recording" }),
      make("div", { class: "actions quiet" }, pageButton(mode, "theme"), pageButton(mode, "help")),
      button(mode, "teach", { id: "teaching-leave" }, "Leave"),
    ),
    make(
      "nav",
      { class: "teaching-stages", "aria-label": "Stages" },
      ...GROUPS.flatMap(([title, stages]) => [
        make("h3", {}, title),
        make("ol", { start: STAGES.indexOf(stages[0]) + 1 }, ...stages.map(item)),
      ]),
    ),
    make(
      "div",
      { class: "teaching-drawing" },
      make(
        "div",
        { class: "teaching-sheet" },
        mode.canvas,
        make(
          "div",
          { id: "teaching-trouble", class: "teaching-trouble", role: "alert", hidden: true },
          make("p", { id: "teaching-trouble-text" }),
          make(
            "div",
            { class: "group" },
            make(
              "button",
              { type: "button", class: "button", id: "teaching-again", on: { click: () => mode.again() } },
              "Try again",
            ),
            make(
              "button",
              { type: "button", class: "button", id: "teaching-defaults", on: { click: () => mode.reset() } },
              "Reset",
            ),
          ),
        ),
      ),
      make(
        "div",
        { id: "teaching-player", class: "teaching-player", hidden: true },
        button(mode, "teach_play", { id: "teaching-play" }),
        make("input", {
          id: "teaching-time",
          type: "range",
          min: 0,
          max: 1,
          step: 0.01,
          value: 0,
          "aria-label": "Place in the animation",
          on: { input: (event) => mode.scrub(Number(event.target.value)) },
        }),
      ),
      make("div", {
        id: "teaching-layers",
        class: "segmented teaching-layers",
        role: "group",
        "aria-label": "Layer",
        hidden: true,
      }),
    ),
    make(
      "div",
      { class: "teaching-side" },
      make(
        "article",
        { class: "teaching-text", tabindex: "0", "aria-label": "About this stage" },
        make("p", { id: "teaching-figure", class: "teaching-figure" }),
        make("h3", { id: "teaching-name" }),
        make("div", { id: "teaching-words", class: "teaching-words" }),
        make("div", { id: "teaching-math", class: "teaching-math" }),
        make("ul", { id: "teaching-legend", class: "teaching-legend", "aria-label": "Legend" }),
        make("dl", { id: "teaching-facts", class: "values teaching-facts" }),
      ),
      make(
        "fieldset",
        { id: "teaching-sliders", class: "teaching-sliders" },
        make("legend", {}, "Try other values"),
        make(
          "button",
          { type: "button", class: "button small", id: "teaching-reset", on: { click: () => mode.reset() } },
          "Reset",
        ),
        ...Object.keys(SLIDERS).map((name) => slider(mode, name)),
      ),
    ),
    make(
      "footer",
      { class: "teaching-foot" },
      button(mode, "teach_back", { id: "teaching-back" }),
      make(
        "div",
        { class: "teaching-middle" },
        make("p", { id: "teaching-place", class: "teaching-place", "aria-live": "polite" }),
        make(
          "div",
          { id: "teaching-progress", class: "progress", hidden: true },
          make("span", { id: "teaching-progress-text" }),
          make("progress", {
            id: "teaching-progress-bar",
            max: 1,
            value: 0,
            "aria-labelledby": "teaching-progress-text",
          }),
          make(
            "button",
            { type: "button", class: "button small", id: "teaching-cancel", on: { click: () => mode.giveUp() } },
            "Cancel",
            make("kbd", {}, keyName(action(mode, "cancel").keys[0])),
          ),
        ),
      ),
      button(mode, "teach_next", { id: "teaching-next" }),
    ),
  );
}

function button(mode, name, attributes, title) {
  const { title: usual, keys } = action(mode, name);
  const made = make(
    "button",
    { type: "button", class: "button", on: { click: () => mode.takes(name) }, ...attributes },
    make("span", {}, title ?? usual),
    make("kbd", {}, keyName(keys[0])),
  );
  setAllowed(made, null, mode.session.tip(action(mode, name)));
  return made;
}

const pageButton = (mode, name) => button(mode, name, { on: { click: () => mode.session.run(name) } });

function slider(mode, name) {
  const [symbol, about] = SLIDERS[name];
  const spoken = symbol.replace("_", " ");
  return make(
    "label",
    { class: "teaching-slider", data: { slider: name, tip: `${spoken}: ${about}` } },
    make("span", { class: "teaching-symbol" }, ...(symbol.includes("_") ? symbols(symbol) : [make("i", {}, symbol)])),
    make("span", { class: "teaching-about" }, about),
    make("output", {}),
    make("input", {
      type: "range",
      "aria-label": `${spoken}, ${about}`,
      on: { input: (event) => mode.change(name, Number(event.target.value)) },
    }),
  );
}

/** Text with the paper's symbols set as they are written: A_w becomes A with a small w. */
export function symbols(text) {
  return text.split(/\b([A-Za-z]_[a-z0-9])\b/).map((piece) => {
    const found = /^([A-Za-z])_([a-z0-9])$/.exec(piece);
    return found ? make("span", {}, make("i", {}, found[1]), make("sub", {}, found[2])) : piece;
  });
}

/** Show the formulas of a stage, smaller where a font makes them wider than the column. */
export function showMath(formulas) {
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
export function showLayers(teaching, stage) {
  const box = byId("teaching-layers");
  box.hidden = !stage.layers;
  box.replaceChildren(
    ...Object.entries(stage.layers ?? {}).map(([layer, title]) =>
      make(
        "button",
        {
          type: "button",
          class: "button",
          "aria-pressed": String(layer === teaching.ui.layer),
          on: {
            click: () => {
              teaching.ui.layer = layer;
              for (const other of box.children)
                other.setAttribute("aria-pressed", String(other.textContent === title));
              teaching.update();
            },
          },
        },
        title,
      ),
    ),
  );
}
