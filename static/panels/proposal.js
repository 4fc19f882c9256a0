// The proposal that waits for a decision: score, parts of it, other places.

import { byId, make, rebuild, valueRow } from "/static/page/dom.js";
import { degrees, floatingOf, number, vector } from "/static/page/format.js";
import { drawPlacedWithIt, placedWithIt } from "/static/panels/placed_with_it.js";

function unitless(/** @type {string} */ name) {
  /** @type {Record<string, string>} */
  const units = { mm: "mm", cm2: "cm²", deg: "°", px: "px", m: "m", m2: "m²" };
  const words = name.split("_");
  const unit = units[words[words.length - 1]];
  return [(unit ? words.slice(0, -1) : words).join(" "), unit ? ` ${unit}` : ""];
}

export class ProposalPanel {
  constructor(/** @type {Page} */ page) {
    this.page = page;
    /** @type {string | null} the place that Accept was pressed for, though its score is low */
    this.armed = null;
    /**
     * @type {{
     *   view: number; area: number; step: number; revision: number; foreseen: { added_cm2: number }
     * } | null}
     */
    this.before = null;
    const { canvas } = page;
    canvas.drawers.push((_, context, style) => drawPlacedWithIt(canvas, context, style, page.state?.pending));
  }

  update(/** @type {State} */ state) {
    this.tellAdded(state);
    const show = (/** @type {UV} */ [u, v]) => this.page.canvas.centerOn(u, v);
    showProposal(state, (message) => this.page.send(message), show);
    const accept = document.querySelector('[data-action="accept"]');
    const waits = Boolean(this.armed) && this.armed === this.placeOf(state);
    if (!waits) this.armed = null;
    accept?.classList.toggle("caution", waits);
  }

  /** Where the proposal lies: another place is another question. */
  placeOf(/** @type {State} */ { pending }) {
    return pending && JSON.stringify([pending.view_index, pending.nudge, pending.score]);
  }

  /** Whether Accept may go ahead: a place below the limit asks for a second press, and says why. */
  mayAccept(/** @type {State} */ state) {
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
  tellAdded(/** @type {State} */ state) {
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

/** @param {State} state @param {Send} send @param {(place: UV) => void} show */
function showProposal(state, send, show) {
  const section = byId("proposal");
  const pending = state.pending;
  section.hidden = !pending;
  if (!pending) return;
  const view = state.views[pending.view_index];
  const low = pending.score !== null && pending.score < state.settings.auto_threshold.value;
  rebuild(byId("proposal-values"), [pending, state.settings.auto_threshold.value, state.layers?.revision], () => [
    make("h2", `${pending.again ? "Again" : "Proposal"}: view ${pending.view_index} (${number(view.angle_deg, 0)}°)`),
    pending.brings &&
      make(
        "p#brings.extends",
        `Piece ${pending.brings.label} comes along, to the dotted rectangle, and becomes part of the shape.`,
      ),
    !(pending.extends === null || pending.extends === "A") &&
      make(
        "p#extends.extends",
        `Extends the floating piece ${pending.extends}, beside the shape.` +
          " It joins the shape once a view connects them.",
      ),
    make(
      "div",
      {
        class: `score${low ? " low" : ""}`,
        tip: `Score of the present place, 0 to 1. Auto accepts from ${state.settings.auto_threshold.value}.`,
      },
      make("meter", { min: 0, max: 1, value: pending.score ?? 0, label: "Score" }),
      make("strong", pending.score === null ? "no score" : number(pending.score, 2)),
      make("span", low ? "below Auto's limit" : "score"),
    ),
    make(
      "details#parts-of-score.parts",
      {
        open: localStorage.getItem("flatcloth-parts") === "open",
        toggle: (event) => localStorage.setItem("flatcloth-parts", event.target.open ? "open" : "closed"),
      },
      make("summary", "Parts of the score"),
      make(
        "dl.values",
        ...Object.entries(pending.parts).flatMap(([name, value]) => {
          const [words, unit] = unitless(name);
          return [
            make("dt", { tip: PARTS[name] ?? words }, words),
            make("dd", value === null ? "–" : `${number(value, Math.abs(value) >= 100 ? 0 : 2)}${unit}`),
          ];
        }),
      ),
      pending.cameras && [
        make(
          "p.note",
          { tip: "What the registration of all views in space found" },
          pending.cameras.replaceAll("+-", "±"),
        ),
      ],
    ),
    make(
      "dl.values",
      make("dt", {
        tip: "What you have moved the proposal by: its centre by u, v on the plane, and clockwise",
        text: "moved",
      }),
      make("dd", `${vector([pending.nudge.u_mm, pending.nudge.v_mm])} mm  ${degrees(pending.nudge.theta_deg)}`),
    ),
    foreseen(pending.foreseen),
    checkList(pending.checks, show),
    pending.hypotheses.length === 1 && make("p.note", "No other place was found."),
    pending.undetermined.length > 0 && make("p.note", `Not determined: ${pending.undetermined.join(", ")}`),
    pending.hypotheses.length > 1 &&
      make(
        "div.places",
        { role: "group", label: "Places found" },
        ...pending.hypotheses.map((h, index) =>
          make(
            "button",
            {
              label: `${SOURCES[h.source]}, score ${number(h.score, 2)}`,
              key: `place-${index}`,
              tip:
                `${SOURCES[h.source]}: ${vector([h.u_mm, h.v_mm])} mm, ${degrees(h.theta_deg)}.` +
                " Click: lay it there.",
              click: () => send({ type: "choose", view_index: pending.view_index, index }),
            },
            make("img", {
              src: `/hypothesis/${state.layers.revision}-${pending.view_index}/${index}.png`,
              alt: "",
              width: 108,
              height: 75,
            }),
            make("span", `${SHORT_SOURCES[h.source]} ${number(h.score, 2)}`),
          ),
        ),
      ),
    pending.why && make("p.asked-again", pending.why),
    placedWithIt(pending, send, show),
    pending.reason &&
      make("p.note", {
        tip: "What the planner expected of this view, before it was laid on the shape",
        text: `Planned for: ${pending.reason.replaceAll("cm2", "cm²")}`,
      }),
  ]);
}

/** What accepting would do. */
function foreseen(/** @type {Pending["foreseen"]} */ told) {
  if (told?.added_cm2 === undefined) return null;
  return make(
    "dl#foreseen.values",
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
    told.joins.length > 0 &&
      valueRow("joins", told.joins.join(", "), "Pieces that it would connect (A is the shape)"),
  );
}

/** The checks with their limits; a click shows the place. */
function checkList(/** @type {Pending["checks"]} */ checks, /** @type {(place: UV) => void} */ show) {
  const known = checks.filter((check) => check.value !== null);
  if (!known.length) return null;
  const sign = (/** @type {Pending["checks"][number]} */ check) => (check.passed ? "✓" : "✕");
  return make(
    "ul#checks.checks",
    ...known.map((check) =>
      make(
        "li",
        { class: check.passed ? "passed" : "failed" },
        make(
          "button",
          {
            label: `${check.title}: ${number(check.value)} ${check.unit}, ${check.passed ? "passed" : "failed"}`,
            key: `check-${check.name}`,
            tip: `${CHECKS[check.name]}\nClick: show the place.`,
            click: () => check.place_uv_m && show(check.place_uv_m),
          },
          make("b", { "aria-hidden": "true" }, sign(check)),
          make("span", check.title),
          make("span", `${number(check.value)} of ${number(check.limit, 0)} ${check.unit}`),
        ),
      ),
    ),
  );
}

/** @type {Record<string, string>} */
const CHECKS = {
  apart: "Median distance in space between proposal and shape where both have cloth",
  twice: "Share of the cloth seen in both that would lie 15 mm or more from its place in the shape",
  outline: "Share of the cloth seen in both that would lie outside the outline of the shape",
};
/** @type {Record<string, string>} */
const SHORT_SOURCES = { place: "Space", lines: "Lines" };
/** @type {Record<string, string>} */
const SOURCES = { place: "Place in space", lines: "Z-angle lines" };

/** @type {Record<string, string>} what the parts of the score mean, by their names in both methods */
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
