// The result: how much cloth, how reliable, what is missing and why, what to review, and the data to take away.

import { PagePart } from "../page/page.js";
import { askJson, Fetched } from "../page/connection.js";
import { button, byId, closeButton, heading, make, rebuild, values } from "../page/dom.js";
import { exportButton, showExports } from "../page/exports.js";
import { addressOf } from "../joints/panel.js";
import { cm2, count, floatingOf, mm, number, percent } from "../page/format.js";
import { doubtsOf, flagsOf } from "./timeline.js";

const MOST = 4; // of each list
const LEAST_CM2 = 1; // less is not worth a line

export class ResultPanel extends PagePart {
  name = "result";
  section = byId("result");
  asked = false; // open, though the integration has not ended
  closed = /** @type {string | null} */ (null); // the end for which it was closed
  found = /** @type {Found | null} */ (null); // the server's answer
  loading = 0; // the revision that was asked for
  /** @type {Fetched<import("../page/messages").JointsInfo>} */
  joints = new Fetched(askJson, () => this.page.changed());
  actions = { result: () => this.toggle() };

  get pressed() {
    return { result: !this.section.hidden };
  }

  toggle() {
    if (this.section.hidden) {
      this.asked = true;
      this.closed = null;
    } else {
      this.asked = false;
      this.closed = endedBy(this.page.state);
    }
    this.page.changed();
    if (this.asked) this.section.scrollIntoView({ block: "nearest" });
  }

  update(/** @type {State} */ state) {
    const end = endedBy(state);
    const ended = end !== null && this.closed !== end;
    if (end === null) this.closed = null;
    const { layers } = this.page.thisSide; // the result is that of this side; the other one follows below
    this.section.hidden = !state.review || !layers || Boolean(state.pending) || !(ended || this.asked);
    if (this.section.hidden || !layers) return;
    if (this.loading !== layers.revision) this.load(layers.revision);
    this.joints.want(addressOf(this.page.thisSide));
    const found = this.found?.revision === layers.revision ? this.found : null;
    rebuild(
      this.section,
      [state.views, state.sides?.certainty, layers, endedBy(state), found, state.other, this.joints.value],
      () => this.build(state, layers, found),
    );
  }

  async load(/** @type {number} */ revision) {
    this.loading = revision;
    const found = /** @type {Found | null} */ (await askJson("review/result.json"));
    this.found = found ?? {
      revision,
      trouble: "The result cannot be had now; the next decision asks again.",
      median_std_mm: null,
      reliable_share: null,
      wrong: [],
      left_out: [],
      more: null,
    };
    if (this.found.revision !== this.loading) this.loading = 0; // a newer picture is on its way
    this.page.changed();
  }

  /** @param {State} state @param {NonNullable<State["layers"]>} layers @param {Found | null} found */
  build(state, layers, found) {
    const finished = endedBy(state);
    const { pieces, area_cm2: floating } = floatingOf(layers);
    const letters = pieces.map((piece) => piece.label).join(", ");
    return [
      heading(
        finished === null ? "Result so far" : "Result",
        closeButton("Close the result", () => this.toggle(), { key: "close-result" }),
      ),
      found?.wrong.length &&
        make("p.note.warn", { role: "alert" }, `Something about this recording is wrong: ${found.wrong.join("; ")}.`),
      this.sideDoubt(state),
      this.jointDoubt(),
      values(
        ["Shape", `${cm2(layers.area_cm2)} from ${count(state.step, "view")}`],
        state.other?.layers && ["Other side", otherSide(state.other), "Cloth of the other side, and what joins it"],
        floating && ["Floating", `${cm2(floating)} (${letters})`, "Cloth that no view connects to the shape yet"],
        found &&
          found.reliable_share !== null && [
            "Reliable",
            percent(found.reliable_share),
            "Share of the shape placed to 10 mm or better",
          ],
        found &&
          found.median_std_mm !== null && [
            "Uncertainty",
            mm(found.median_std_mm),
            "Median standard deviation of a pixel's place",
          ],
      ),
      !found && make("p.note", { role: "status" }, "Looking for what was left out …"),
      found?.trouble && make("p.note", found.trouble),
      found && !found.trouble && [this.leftOut(found), found.more && this.more(found.more, state)],
      this.toReview(state),
      this.exports(state),
    ];
  }

  /** Of a recording without masks: how much may be of the wrong side, and what helps. */
  sideDoubt(/** @type {State} */ { sides }) {
    if (typeof sides?.certainty !== "number") return null;
    const wrong = percent(1 - sides.certainty);
    return make(
      "p.note.warn",
      `The sides were told without masks: by their own certainty ${wrong} of this cloth is of the wrong side, and it ` +
        "can be several times as much. Compare the source images, and stroke what is wrong: ",
      this.page.smallButton("where_to_stroke"),
    );
  }

  /** What most doubtful cloth hangs on, and the way to look at it. */
  jointDoubt() {
    const joint = this.joints.value?.joints.find(({ weak }) => weak);
    if (!joint) return null;
    const right = `${number(100 * joint.probability, 1)} %`;
    return make(
      "p.note.warn",
      `${cm2(joint.area_cm2)} hang on one joint that is right with a probability of ${right}: `,
      this.page.smallButton("joints"),
    );
  }

  leftOut(/** @type {Found} */ found) {
    const total = found.left_out.reduce((sum, left) => sum + left.area_cm2, 0);
    const large = found.left_out.filter((left) => left.area_cm2 >= LEAST_CM2);
    const reasons = [...new Set(large.map((left) => left.reason))];
    return [
      make("h3", "Seen but left out", make("span", cm2(total))),
      ...reasons.flatMap((reason) => this.leftFor(reason, large)),
      reasons.length ? null : make("p.note", "None: the result has all the cloth that its views show."),
    ];
  }

  /** Cloth left out for one reason, and the views that show it. */
  leftFor(/** @type {string} */ reason, /** @type {Left[]} */ every) {
    const these = every.filter((left) => left.reason === reason);
    const area = these.reduce((sum, left) => sum + left.area_cm2, 0);
    return [
      make("p.note", `${cm2(area)}: ${reason}`),
      make(
        "div.chips",
        ...these.slice(0, MOST).map(({ view_index: view, area_cm2 }) => {
          return this.page.turnTo(view, `left-${view}`, `View ${view}: ${number(area_cm2, 0)}`);
        }),
      ),
    ];
  }

  more(/** @type {NonNullable<Found["more"]>} */ { expected, share, reason }, /** @type {State} */ state) {
    const open = expected.filter(({ view_index }) => state.views[view_index].why_not === null);
    const likely = (/** @type {number} */ area) => cm2(share === null ? area : share * area);
    const best = open.slice(0, 3).filter(({ area_cm2 }) => (share ?? 1) * area_cm2 >= LEAST_CM2);
    return [
      make("h3", "Another view"),
      !best.length && make("p.note", reason || "None would add a square centimetre."),
      make(
        "ul",
        ...best.map(({ view_index, area_cm2 }) =>
          this.link(view_index, `more-${view_index}`, `up to ${likely(area_cm2)}`, "", () =>
            this.page.verdicts.propose(this.page.state.views[view_index]),
          ),
        ),
      ),
    ];
  }

  toReview(/** @type {State} */ state) {
    const weak = state.views
      .filter((view) => view.order && view.score !== null)
      .sort(
        (a, b) =>
          Number(b.flagged) - Number(a.flagged) ||
          doubtsOf(b).length - doubtsOf(a).length ||
          (a.score ?? 0) - (b.score ?? 0),
      )
      .slice(0, 3);
    if (!weak.length) return [];
    const items = weak.map((view) => {
      const flags = flagsOf(view, state).join(", ");
      return this.link(view.index, `weak-${view.index}`, `score ${number(view.score, 2)}`, flags, () =>
        this.page.verdicts.goTo(this.page.state.views[view.index]),
      );
    });
    return [make("h3", "Weakest views"), make("ul", ...items)];
  }

  exports(/** @type {State} */ state) {
    const { notify } = this.page;
    const kind = state.phase === "finished" ? "primary" : "";
    return make(
      "div.group",
      exportButton("data.zip", "Export data", notify, state.recording.name, kind),
      button("All exports …", () => showExports(notify, state), { key: "all-exports" }),
    );
  }

  /**
   * A line about a view; a press goes there.
   * @param {number} index @param {string} id @param {string} figure @param {string} about
   * @param {() => void} press
   */
  link(index, id, figure, about, press) {
    return make(
      "li",
      make(
        "button",
        { key: id, click: press },
        make("b", `View ${index}`),
        make("span", figure),
        about && make("small", about),
      ),
    );
  }

  get status() {
    return { open: !this.section.hidden, found: this.found };
  }
}

/** Why the integration has ended, by the method or by the choice of how far Auto runs; null: it has not. */
const endedBy = (/** @type {State} */ { active, phase, finished, auto }) =>
  active && !active.end
    ? null
    : phase === "finished"
      ? finished
      : phase === "ready" && auto.ended
        ? auto.ended
        : null;

/** The other side in a few words. */
function otherSide(/** @type {NonNullable<State["other"]>} */ { layers, is_related, reliable_share }) {
  const about = !is_related ? ", not joined" : reliable_share === null ? "" : `, ${percent(reliable_share)} reliable`;
  return `${cm2(layers?.area_cm2)}${about}`;
}
