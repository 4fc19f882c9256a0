// The proposal that waits for a decision: score, parts of it, other places.

import { PagePart } from "../page/page.js";
import { joinsBy, joiningText, overlapOfProposal } from "../canvas/overlap.js";
import { buttonOf, make, section, values } from "../page/dom.js";
import { cm2, degrees, number, vector } from "../page/format.js";

const SEEN = 0.05; // mm, or degrees: what is shown as 0.0 is no move
const MOVES_MM = 1; // of the shape's cloth, and the share of contradictions, that are worth a line
const CONTRADICTS = 0.005;

export class ProposalPanel extends PagePart {
  armed = /** @type {string | null} */ (null); // where Accept was pressed though the score is low

  update(/** @type {State} */ state) {
    const { pending, settings, layers } = state;
    const drawn = this.canvas.overlay.shown?.revision;
    const key = pending && [pending, settings.auto_threshold, layers?.revision, drawn];
    section("proposal", key, () => pending && this.parts(state, pending), "proposal-values");
    const waits = Boolean(this.armed) && this.armed === placeOf(state);
    if (!waits) this.armed = null;
    buttonOf("accept")?.classList.toggle("caution", waits);
  }

  /** Name each part that is placed too where it adds cloth: its outline is one with the proposal's. */
  drawOver(/** @type {Pen} */ pen) {
    const { canvas } = this;
    const { pending } = this.page.state ?? {};
    if (!pending || !canvas.overlay.shown || canvas.isMoved) return;
    for (const part of pending.also) {
      const at = pen.at(part.place_uv_m);
      pen.dot(at, "--accent", 4);
      pen.label(nameOf(part), { x: at.x + 12, y: at.y });
    }
  }

  /** While it is dragged, whether it joins is said at once. */
  moving() {
    const where = document.getElementById("joining");
    if (where) where.textContent = joiningText(overlapOfProposal(this.page) ?? 0);
  }

  /** Accept goes ahead where the verdict is "Sure"; else it asks for a second press, and says why. */
  mayAccept(/** @type {State} */ state) {
    const place = placeOf(state);
    const why = state.pending ? this.doubtsOf(state.pending) : [];
    if (!why.length || this.armed === place) return true;
    this.armed = place;
    this.page.changed();
    this.page.notify("warning", `Look here: ${why.join(", ")}. Press Accept again to leave it so, for review.`);
    return false;
  }

  /** Why to look at where the proposal lies, before it is accepted; none: it is sure. @returns {string[]} */
  doubtsOf(/** @type {Pending} */ { score, checks, joins, nudge }) {
    const limit = this.page.state.settings.auto_threshold;
    const overlap = isMoved(nudge) ? overlapOfProposal(this.page) : null;
    if (!(joins ?? (overlap === null || joinsBy(overlap)))) return ["it does not join the shape"];
    const failed = checks.filter((check) => check.passed === false);
    const why = failed.map(({ title, value, unit }) => `${title.toLowerCase()} ${number(value)} ${unit}`);
    return score !== null && score < limit ? [`score ${number(score, 2)} is below ${number(limit, 2)}`, ...why] : why;
  }

  // --- the panel ---------------------------------------------------------------------------------

  parts(/** @type {State} */ { views }, /** @type {Pending} */ pending) {
    const { brings, joins, nudge } = pending;
    const comes = `Piece ${brings?.label} comes along, to the dotted rectangle, and becomes part of the shape.`;
    const extended = `Extends the floating piece ${pending.extends}. It joins the shape once a view connects them.`;
    return [
      make("h2", `View ${pending.view_index} (${number(views[pending.view_index].angle_deg, 0)}°)`),
      brings && joins && make("p#brings.extends", comes),
      !(pending.extends === null || pending.extends === "A") && make("p#extends.extends", extended),
      this.verdict(pending),
      isMoved(nudge) &&
        values([
          "Moved",
          `${vector([nudge.u_mm, nudge.v_mm])} mm  ${degrees(nudge.theta_deg)}`,
          "What you have moved the proposal by: its centre by u, v on the plane, and clockwise",
        ]),
      foreseen(pending.foreseen),
      joins !== false && this.checks(pending.checks),
      pending.why && make("p.asked-again", pending.why),
      this.placedWithIt(pending),
    ];
  }

  /** One verdict on where the proposal lies: sure, or why to look. */
  verdict(/** @type {Pending} */ pending) {
    const { score, joins, nudge } = pending;
    const why = this.doubtsOf(pending);
    const known = joins ? "Joins the shape." : "Does not join the shape: drag it farther onto it.";
    const here = isMoved(nudge) && joins === null ? overlapOfProposal(this.page) : null;
    const limit = this.page.state.settings.auto_threshold;
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

  /** The checks with their limits; a click shows the place. */
  checks(/** @type {Pending["checks"]} */ checks) {
    const known = checks.filter((check) => check.value !== null);
    const row = (/** @type {Pending["checks"][number]} */ check) => {
      const { name, title, value, unit, passed, place_uv_m: place } = check;
      return make(
        "li",
        { class: passed ? "passed" : "failed" },
        make(
          "button",
          {
            key: `check-${name}`,
            tip: `${CHECKS[name]}${SHOWS}`,
            click: () => place && this.canvas.centerOn(...place),
          },
          make("b", { "aria-hidden": "true" }, passed ? "✓" : "✕"),
          make("span", title, make("span.unseen", passed ? ": passed, " : ": failed, ")),
          make("span", `${number(value)} of ${number(check.limit, 0)} ${unit}`),
        ),
      );
    };
    return known.length > 0 && make("ul#checks.checks", ...known.map(row));
  }

  /** The further parts that accepting the proposal places too. */
  placedWithIt(/** @type {Pending} */ { also }) {
    const row = (/** @type {Pending["also"][number]} */ part) => {
      const { area_cm2, place_uv_m } = part;
      const show = {
        key: `show-part-${nameOf(part)}`,
        tip: `Its place is found like the proposal's.${SHOWS}`,
        click: () => this.canvas.centerOn(...place_uv_m),
      };
      return make("li", make("button", show, make("span", nameOf(part)), make("span", cm2(area_cm2))));
    };
    const list = () => [make("p.note", "Accepting also places:"), make("ul", ...also.map(row))];
    return also.length > 0 && make("div#placed-with-it.placed-with-it", ...list());
  }
}

const SHOWS = "\nClick: show the place.";
/** @type {Record<string, string>} */
const CHECKS = {
  apart: "Median distance in space between proposal and shape where both have cloth",
  twice: "Share of the cloth seen in both that would lie 15 mm or more from its place in the shape",
  other: "Share of its cloth that would lie on cloth of the shape that is another",
};

/** Where the proposal lies: another place is another question. */
const placeOf = (/** @type {State} */ { pending }) =>
  pending && JSON.stringify([pending.view_index, pending.nudge, pending.score]);

const isMoved = (/** @type {Pending["nudge"]} */ { u_mm, v_mm, theta_deg }) =>
  Math.hypot(u_mm, v_mm) >= SEEN || Math.abs(theta_deg) >= SEEN;

/** @param {Pending["also"][number]} parts */
const nameOf = ({ view_index, component }) => `view ${view_index}, part ${component + 1}`;

/** What accepting would do. */
function foreseen(/** @type {Pending["foreseen"]} */ cloth) {
  if (!cloth) return null;
  return make(
    "div#foreseen",
    values(
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
