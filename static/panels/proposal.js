// The proposal that waits for a decision: score, parts of it, other places.

import { byId, make, rebuild, valueRow } from "/static/page/dom.js";
import { degrees, floatingOf, number, vector } from "/static/page/format.js";
import { drawPlacedWithIt, placedWithIt } from "/static/panels/placed_with_it.js";

function unitless(name) {
  const units = { mm: "mm", cm2: "cm²", deg: "°", px: "px", m: "m", m2: "m²" };
  const words = name.split("_");
  const unit = units[words.at(-1)];
  return [(unit ? words.slice(0, -1) : words).join(" "), unit ? ` ${unit}` : ""];
}

export class ProposalPanel {
  constructor(page) {
    this.page = page;
    const { canvas } = page;
    canvas.drawers.push((_, context, style) => drawPlacedWithIt(canvas, context, style, page.state?.pending));
  }

  update(state) {
    this.tellAdded(state);
    const show = ([u, v]) => this.page.canvas.centerOn(u, v);
    showProposal(state, (message) => this.page.send(message), show);
    const accept = document.querySelector('[data-action="accept"]');
    const waits = Boolean(this.armed) && this.armed === this.placeOf(state);
    if (!waits) this.armed = null;
    accept?.classList.toggle("caution", waits);
  }

  /** Where the proposal lies: another place is another question. */
  placeOf({ pending }) {
    return pending && JSON.stringify([pending.view_index, pending.nudge, pending.score]);
  }

  /** Whether Accept may go ahead: a place below the limit asks for a second press, and says why. */
  mayAccept(state) {
    const { pending, settings } = state;
    const limit = settings.auto_threshold.value;
    const place = this.placeOf(state);
    if (!pending || pending.score === null || pending.score >= limit || this.armed === place) return true;
    this.armed = place;
    const failed = pending.checks.filter((check) => check.passed === false);
    const why = failed.map((check) => `${check.title.toLowerCase()} ${number(check.value)} ${check.unit}`).join(", ");
    this.page.notify(
      "warning",
      `The score here is ${number(pending.score, 2)}, below ${number(limit, 2)}${why ? `: ${why}` : ""}.` +
        " Press Accept again to accept it anyway; the view is then flagged for review.",
    );
    this.page.changed();
    return false;
  }

  /** After an acceptance: what it really added, beside what was foreseen. */
  tellAdded(state) {
    const { pending, layers } = state;
    const area = layers && layers.area_cm2 + floatingOf(layers).area_cm2;
    const before = this.before;
    if (before && !pending && state.step === before.step + 1 && layers.revision !== before.revision) {
      const added = `View ${before.view} added ${number(area - before.area, 0)} cm²`;
      this.page.notify("info", `${added}; ${number(before.foreseen.added_cm2, 0)} cm² were predicted.`);
      this.before = null;
    } else if (pending?.foreseen?.added_cm2 !== undefined && layers) {
      const { view_index: view, foreseen: expected } = pending;
      this.before = { view, area, step: state.step, revision: layers.revision, foreseen: expected };
    } else if (state.step !== before?.step && layers?.revision !== before?.revision) {
      this.before = null;
    }
  }
}

function showProposal(state, send, show) {
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
      pending.brings
        ? make(
            "p",
            { class: "extends", id: "brings" },
            `Piece ${pending.brings.label} comes along, to the dotted rectangle, and becomes part of the shape.`,
          )
        : null,
      pending.extends === null || pending.extends === "A"
        ? null
        : make(
            "p",
            { class: "extends", id: "extends" },
            `Extends the floating piece ${pending.extends}, beside the shape.` +
              " It joins the shape once a view connects them.",
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
              make("dt", { data: { tip: PARTS[name] ?? words } }, words),
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
      foreseen(pending.foreseen),
      checkList(pending.checks, show),
      pending.hypotheses.length === 1 ? make("p", { class: "note" }, "No other place was found.") : null,
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
      placedWithIt(pending, send, show),
      pending.reason
        ? make(
            "p",
            {
              class: "note",
              data: { tip: "What the planner expected of this view, before it was laid on the shape" },
            },
            `Planned for: ${pending.reason.replaceAll("cm2", "cm²")}`,
          )
        : null,
    ].filter(Boolean),
  );
}

/** What accepting would do. */
function foreseen(told) {
  if (told?.added_cm2 === undefined) return null;
  return make(
    "dl",
    { class: "values", id: "foreseen" },
    ...valueRow(
      "adds",
      `${number(told.added_cm2, 0)} cm²`,
      "Cloth of the proposal that neither the shape nor a piece has yet",
    ),
    ...valueRow(
      "seen again",
      `${number(told.again_cm2, 0)} cm²`,
      "Cloth of the proposal that the shape or a piece already has",
    ),
    ...(told.joins.length
      ? valueRow("joins", told.joins.join(", "), "Pieces that it would connect (A is the shape)")
      : []),
  );
}

/** The checks with their limits; a click shows the place. */
function checkList(checks, show) {
  const known = checks.filter((check) => check.value !== null);
  if (!known.length) return null;
  const sign = (check) => (check.passed ? "✓" : "✕");
  return make(
    "ul",
    { class: "checks", id: "checks" },
    ...known.map((check) =>
      make(
        "li",
        { class: check.passed ? "passed" : "failed" },
        make(
          "button",
          {
            type: "button",
            "aria-label": `${check.title}: ${number(check.value)} ${check.unit}, ${check.passed ? "passed" : "failed"}`,
            data: { id: `check-${check.name}`, tip: `${CHECKS[check.name]}\nClick: show the place.` },
            on: { click: () => check.place_uv_m && show(check.place_uv_m) },
          },
          make("b", { "aria-hidden": "true" }, sign(check)),
          make("span", {}, check.title),
          make("span", {}, `${number(check.value)} of ${number(check.limit, 0)} ${check.unit}`),
        ),
      ),
    ),
  );
}

const CHECKS = {
  apart: "Median distance in space between proposal and shape where both have cloth",
  twice: "Share of the cloth seen in both that would lie 15 mm or more from its place in the shape",
  outline: "Share of the cloth seen in both that would lie outside the outline of the shape",
};
const SHORT_SOURCES = { place: "Space", lines: "Lines", correlation: "Correlation" };
const SOURCES = { place: "Place in space", lines: "Z-angle lines", correlation: "Correlation" };

/** What the parts of the score mean, by their names in both methods. */
const PARTS = {
  place_agreement: "Agreement of the positions in space where both have cloth: 1 is the same place",
  color_agreement: "Agreement of the colour where both have cloth: 1 is the same colour",
  height_agreement: "Agreement of the height along the turning axis: 1 is the same height",
  outline_agreement: CHECKS.outline.replace("outside", "within"),
  other_cloth_share: "Share of the overlap where the two are different cloth: far apart in space, or facing away",
  twice_share: CHECKS.twice,
  place_median_mm: CHECKS.apart,
  overlap_cm2: "Cloth of the proposal that lies on the shape",
  overlap_share: "The same as a share of the proposal",
  z_angle_agreement: "Agreement of the Z-angles after the rotation: 1 is the same; other cloth has another one",
  intensity_agreement: "Agreement of the brightness, beyond that of pixels paired by chance: 1 is the same",
  height_rms_mm: "Root of the mean squared difference of the heights along the turning axis",
};
