// The proposal that waits for a decision: score, parts of it, other places.

import { PagePart } from "../page/page.js";
import { joinsBy, joiningText, overlapOfProposal } from "../canvas/overlap.js";
import { drawDot } from "../canvas/marks.js";
import { drawName } from "../garment/marks.js";
import { button, buttonOf, byId, make, rebuild, valueRows, values } from "../page/dom.js";
import { cm2, degrees, number, vector } from "../page/format.js";

const SEEN = 0.05; // mm, or degrees: what is shown as 0.0 is no move
const MOVES_MM = 1; // of the shape's cloth, and the share of contradictions, that are worth a line
const CONTRADICTS = 0.005;

export class ProposalPanel extends PagePart {
  armed = /** @type {string | null} */ (null); // where Accept was pressed though the score is low

  update(/** @type {State} */ state) {
    const show = (/** @type {UV} */ [u, v]) => this.page.canvas.centerOn(u, v);
    showProposal(state, this.page, show);
    const waits = Boolean(this.armed) && this.armed === this.placeOf(state);
    if (!waits) this.armed = null;
    buttonOf("accept")?.classList.toggle("caution", waits);
  }

  /** Name each part that is placed too where it adds cloth: its outline is one with the proposal's. */
  drawOver(/** @type {Context} */ context, /** @type {Style} */ style) {
    const { canvas } = this;
    const { pending } = this.page.state ?? {};
    if (!pending || !canvas.overlay.shown || canvas.isMoved) return;
    for (const part of pending.also) {
      const at = canvas.transform.toPane(...part.place_uv_m);
      drawDot(context, at, style.getPropertyValue("--accent"), 4);
      drawName(context, style, at, nameOf(part));
    }
  }

  /** Where the proposal lies: another place is another question. */
  placeOf(/** @type {State} */ { pending }) {
    return pending && JSON.stringify([pending.view_index, pending.nudge, pending.score]);
  }

  /** While it is dragged, whether it joins is said at once. */
  moving() {
    const where = document.getElementById("joining");
    if (where) where.textContent = joiningText(overlapOfProposal(this.page) ?? 0);
  }

  /** Accept goes ahead where the verdict is "Sure"; else it asks for a second press, and says why. */
  mayAccept(/** @type {State} */ state) {
    const { pending, settings } = state;
    const place = this.placeOf(state);
    const why = pending ? doubtsOf(pending, settings.auto_threshold, this.page) : [];
    if (!why.length || this.armed === place) return true;
    this.armed = place;
    this.page.changed();
    this.page.notify("warning", `Look here: ${why.join(", ")}. Press Accept again to leave it so, for review.`);
    return false;
  }
}

/** @param {State} state @param {Page} page @param {(place: UV) => void} show */
function showProposal(state, page, show) {
  const { pending, layers } = state;
  byId("proposal").hidden = !pending;
  if (!pending) return;
  const limit = state.settings.auto_threshold;
  const { nudge } = pending;
  const view = `View ${pending.view_index} (${number(state.views[pending.view_index].angle_deg, 0)}°)`;
  const drawn = page.canvas.overlay.shown?.revision;
  rebuild(byId("proposal-values"), [pending, limit, layers?.revision, drawn], () => [
    make("h2", pending.again ? `Again: ${view}` : view),
    pending.brings &&
      pending.joins &&
      make(
        "p#brings.extends",
        `Piece ${pending.brings.label} comes along, to the dotted rectangle, and becomes part of the shape.`,
      ),
    !(pending.extends === null || pending.extends === "A") &&
      make(
        "p#extends.extends",
        `Extends the floating piece ${pending.extends}.` + " It joins the shape once a view connects them.",
      ),
    verdictOn(pending, limit, page),
    isMoved(nudge) &&
      values([
        "Moved",
        `${vector([nudge.u_mm, nudge.v_mm])} mm  ${degrees(nudge.theta_deg)}`,
        "What you have moved the proposal by: its centre by u, v on the plane, and clockwise",
      ]),
    foreseen(pending.foreseen),
    pending.joins !== false && checkList(pending.checks, show),
    pending.why && make("p.asked-again", pending.why),
    placedWithIt(pending, (message) => page.send(message), show),
  ]);
}

const isMoved = (/** @type {Pending["nudge"]} */ { u_mm, v_mm, theta_deg }) =>
  Math.hypot(u_mm, v_mm) >= SEEN || Math.abs(theta_deg) >= SEEN;

/** Why to look at where the proposal lies, before it is accepted; none: it is sure. @returns {string[]} */
function doubtsOf(/** @type {Pending} */ pending, /** @type {number} */ limit, /** @type {Page} */ page) {
  const { score, checks, joins, nudge } = pending;
  const overlap = isMoved(nudge) ? overlapOfProposal(page) : null;
  if (!(joins ?? (overlap === null || joinsBy(overlap)))) return ["it does not join the shape"];
  const failed = checks.filter((check) => check.passed === false);
  const why = failed.map(({ title, value, unit }) => `${title.toLowerCase()} ${number(value)} ${unit}`);
  return score !== null && score < limit ? [`score ${number(score, 2)} is below ${number(limit, 2)}`, ...why] : why;
}

/** One verdict on where the proposal lies: sure, or why to look. */
function verdictOn(/** @type {Pending} */ pending, /** @type {number} */ limit, /** @type {Page} */ page) {
  const { score, joins, nudge } = pending;
  const why = doubtsOf(pending, limit, page);
  const known = joins ? "Joins the shape." : "Does not join the shape: drag it farther onto it.";
  const here = isMoved(nudge) && joins === null ? overlapOfProposal(page) : null;
  return make(
    "div",
    {
      class: `score${why.length ? " low" : ""}`,
      tip: `Score of the present place, 0 to 1. Auto accepts from ${limit}.`,
    },
    make("meter", { min: 0, max: 1, value: score ?? 0, label: "Score" }),
    make("strong", why.length ? "Look here" : score === null ? "No score yet" : "Sure"),
    make("span", why.join(", ") || (score === null ? "" : number(score, 2))),
    isMoved(nudge) &&
      make("span#joining", { role: "status" }, here === null ? joins !== null && known : joiningText(here)),
  );
}

/** What accepting would do. */
function foreseen(/** @type {Pending["foreseen"]} */ cloth) {
  if (!cloth) return null;
  return make(
    "dl#foreseen.values",
    ...valueRows(
      ["Adds", cm2(cloth.added_cm2), "Cloth of the proposal that neither the shape nor a piece has yet"],
      cloth.joins.length > 0 && ["Joins", cloth.joins.join(", "), "Pieces that it would connect (A is the shape)"],
      (cloth.moved_mm ?? 0) >= MOVES_MM && [
        "Moves the shape",
        `${number(cloth.moved_mm)} mm`,
        "Nine tenths of the shape's cloth move by less",
      ],
      cloth.contradicted !== null &&
        cloth.contradicted >= CONTRADICTS && [
          "Contradicts",
          `${number(100 * cloth.contradicted)} %`,
          "Share of what it measures that the other views contradict",
        ],
    ),
  );
}

/** The checks with their limits; a click shows the place. */
function checkList(/** @type {Pending["checks"]} */ checks, /** @type {(place: UV) => void} */ show) {
  const known = checks.filter((check) => check.value !== null);
  const row = (/** @type {Pending["checks"][number]} */ check) => {
    const { name, title, value, unit, passed, place_uv_m: place } = check;
    return make(
      "li",
      { class: passed ? "passed" : "failed" },
      make(
        "button",
        { key: `check-${name}`, tip: `${CHECKS[name]}\nClick: show the place.`, click: () => place && show(place) },
        make("b", { "aria-hidden": "true" }, passed ? "✓" : "✕"),
        make("span", title, make("span.unseen", passed ? ": passed, " : ": failed, ")),
        make("span", `${number(value)} of ${number(check.limit, 0)} ${unit}`),
      ),
    );
  };
  return known.length ? make("ul#checks.checks", ...known.map(row)) : null;
}

/** @type {Record<string, string>} */
const CHECKS = {
  apart: "Median distance in space between proposal and shape where both have cloth",
  twice: "Share of the cloth seen in both that would lie 15 mm or more from its place in the shape",
  other: "Share of its cloth that would lie on cloth of the shape that is another",
};

// --- the further parts that accepting a proposal places too ------------------------------------------

/** @param {Pending["also"][number]} parts */
const nameOf = ({ view_index, component }) => `view ${view_index}, part ${component + 1}`;

/** @param {Pending} parts @param {Send} send @param {(place: UV) => void} show */
function placedWithIt({ also, view_index }, send, show) {
  if (!also.length) return null;
  return make(
    "div#placed-with-it.placed-with-it",
    make("p.note", "Accepting also places:"),
    make("ul", ...also.map((part) => placedRow(part, view_index, send, show))),
  );
}

/**
 * @param {Pending["also"][number]} part @param {number} view_index @param {Send} send
 * @param {(place: UV) => void} show
 */
function placedRow(part, view_index, send, show) {
  const { component, area_cm2, place_uv_m } = part;
  const name = nameOf(part);
  const id = `${part.view_index}-${component}`;
  const shown = {
    key: `show-part-${id}`,
    tip: "Its place is found like the proposal's.\nClick: show the place.",
    click: () => show(place_uv_m),
  };
  const leaveOut = () => send({ type: "leave_out", view_index, part_view: part.view_index, component });
  return make(
    "li",
    make("button", shown, make("span", name), make("span", cm2(area_cm2))),
    button("Leave out", leaveOut, {
      label: `Leave out ${name}`,
      key: `leave-out-${id}`,
      tip: "Accept the proposal without this part. It is not proposed again; Undo takes it back.",
    }),
  );
}
