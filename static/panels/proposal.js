// The proposal that waits for a decision: score, parts of it, other places.

import { byId, make, rebuild } from "/static/page/dom.js";
import { degrees, number, vector } from "/static/page/format.js";

function unitless(name) {
  const units = { mm: "mm", cm2: "cm²", deg: "°", px: "px", m: "m", m2: "m²" };
  const words = name.split("_");
  const unit = units[words.at(-1)];
  return [(unit ? words.slice(0, -1) : words).join(" "), unit ? ` ${unit}` : ""];
}

export class ProposalPanel {
  constructor(page) {
    this.page = page;
  }

  update(state) {
    showProposal(state, (message) => this.page.send(message));
  }
}

function showProposal(state, send) {
  const section = byId("proposal");
  const pending = state.pending;
  section.hidden = !pending;
  if (!pending) return;
  const view = state.views[pending.view_index];
  const low = pending.score !== null && pending.score < state.settings.auto_threshold.value;
  rebuild(byId("proposal-values"), [pending, state.settings.auto_threshold.value, state.layers?.revision], () =>
    [
      make(
        "h2",
        {},
        `${pending.again ? "Again" : "Proposal"}: view ${pending.view_index} (${number(view.angle_deg, 0)}°)`,
      ),
      make(
        "div",
        {
          class: `score${low ? " low" : ""}`,
          data: {
            tip: `Score of the present place, 0 to 1. Auto accepts from ${state.settings.auto_threshold.value}.`,
          },
        },
        make("meter", { min: 0, max: 1, value: pending.score ?? 0, "aria-label": "Score" }),
        make("strong", {}, pending.score === null ? "no score" : number(pending.score, 2)),
        make("span", {}, low ? "below Auto's limit" : "score"),
      ),
      make(
        "details",
        {
          class: "parts",
          id: "parts-of-score",
          open: localStorage.getItem("flatcloth-parts") === "open",
          on: { toggle: (event) => localStorage.setItem("flatcloth-parts", event.target.open ? "open" : "closed") },
        },
        make("summary", {}, "Parts of the score"),
        make(
          "dl",
          { class: "values" },
          ...Object.entries(pending.parts).flatMap(([name, value]) => {
            const [words, unit] = unitless(name);
            return [
              make("dt", {}, words),
              make("dd", {}, value === null ? "–" : `${number(value, Math.abs(value) >= 100 ? 0 : 2)}${unit}`),
            ];
          }),
        ),
        ...(pending.cameras
          ? [
              make(
                "p",
                { class: "note", data: { tip: "What the registration of all views in space found" } },
                pending.cameras.replaceAll("+-", "±"),
              ),
            ]
          : []),
      ),
      make(
        "dl",
        { class: "values" },
        make(
          "dt",
          { data: { tip: "What you have moved the proposal by: its centre by u, v on the plane, and clockwise" } },
          "moved",
        ),
        make("dd", {}, `${vector([pending.nudge.u_mm, pending.nudge.v_mm])} mm  ${degrees(pending.nudge.theta_deg)}`),
      ),
      pending.margin === null
        ? null
        : make(
            "p",
            { data: { tip: "How much more sure this place is than the second best" } },
            `Margin to the second best: ${number(pending.margin, 2)}`,
          ),
      pending.undetermined.length
        ? make("p", { class: "note" }, `Not determined: ${pending.undetermined.join(", ")}`)
        : null,
      pending.hypotheses.length > 1
        ? make(
            "div",
            { class: "places", role: "group", "aria-label": "Places found" },
            ...pending.hypotheses.map((h, index) =>
              make(
                "button",
                {
                  type: "button",
                  "aria-label": `${SOURCES[h.source]}, score ${number(h.score, 2)}`,
                  data: {
                    id: `place-${index}`,
                    tip:
                      `${SOURCES[h.source]}: ${vector([h.u_mm, h.v_mm])} mm, ${degrees(h.theta_deg)}.` +
                      " Click: lay it there.",
                  },
                  on: { click: () => send({ type: "choose", view_index: pending.view_index, index }) },
                },
                make("img", {
                  src: `/hypothesis/${state.layers.revision}-${pending.view_index}/${index}.png`,
                  alt: "",
                  width: 108,
                  height: 75,
                }),
                make("span", {}, `${SHORT_SOURCES[h.source]} ${number(h.score, 2)}`),
              ),
            ),
          )
        : null,
      pending.why ? make("p", { class: "asked-again" }, pending.why) : null,
      pending.also.length
        ? make("p", { class: "note" }, `Placed with it: ${pending.also.map(partName).join(", ")}`)
        : null,
      pending.reason ? make("p", { class: "note" }, pending.reason.replaceAll("cm2", "cm²")) : null,
    ].filter(Boolean),
  );
}

const partName = (part) => `part ${part.component + 1} of view ${part.view_index}`;

const SHORT_SOURCES = { place: "Space", lines: "Lines", correlation: "Correlation" };
const SOURCES = { place: "Place in space", lines: "Z-angle lines", correlation: "Correlation" };
