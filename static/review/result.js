// The result: how much cloth, how reliable, what is missing and why, and the data to take away.

import { PagePart } from "../page/page.js";
import { askJson, Fetched } from "../page/connection.js";
import { button, byId, closeButton, heading, make, rebuild, values } from "../page/dom.js";
import { cm2, floatingOf, mm, percent } from "../page/format.js";

const MOST = 4; // of each list
const LEAST_CM2 = 5; // less is not worth a line
const CM2 = 1e4; // in a square metre

export class ResultPanel extends PagePart {
  name = "result";
  section = byId("result");
  asked = false; // open, though the integration has not ended
  closed = /** @type {string | null} */ (null); // the end for which it was closed
  /** @type {Fetched<Found>} */
  fetched = new Fetched(askJson, () => this.page.changed());
  actions = { result: () => this.toggle() };

  get found() {
    return this.fetched.value;
  }

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
    this.fetched.want(`review/result.json?revision=${layers.revision}`);
    this.page.doubts.want();
    const found = this.found?.revision === layers.revision ? this.found : null;
    rebuild(
      this.section,
      [state.views, state.sides?.certainty, layers, endedBy(state), found, state.other, this.page.doubts.found],
      () => this.build(state, layers, found),
    );
  }

  /** @param {State} state @param {NonNullable<State["layers"]>} layers @param {Found | null} found */
  build(state, layers, found) {
    const { pieces, area_cm2: floating } = floatingOf(layers);
    const letters = pieces.map((piece) => piece.label).join(", ");
    const result = found?.result;
    const { firm_share: reliable, placement_std_median_mm: std } = result?.uncertainty ?? {};
    return [
      heading(
        endedBy(state) === null ? "Result so far" : "Result",
        closeButton("Close the result", () => this.toggle(), { key: "close-result" }),
      ),
      result?.wrong.length &&
        make(
          "p.note.warn",
          { role: "alert" },
          `Something about this recording is wrong: ${result.wrong.join("; ")}.`,
        ),
      this.sideDoubt(state),
      this.jointDoubt(result?.wrong.length === 0 && !this.sideDoubt(state), reliable),
      values(
        ["Shape", cm2(layers.area_cm2)],
        state.other?.layers && ["Other side", otherSide(state.other), "Cloth of the other side, and what joins it"],
        floating && ["Floating", `${cm2(floating)} (${letters})`, "Cloth that no view connects to the shape yet"],
        reliable !== undefined && ["Reliable", percent(reliable), "Share of the shape placed to 10 mm or better"],
        std !== undefined && ["Uncertainty", mm(std), "Median standard deviation of a pixel's place"],
      ),
      !found && make("p.note", { role: "status" }, "Looking for what was left out …"),
      found?.trouble && make("p.note", found.trouble),
      result && [this.leftOut(result.left_out), this.more(result.more, state)],
      this.exports(state),
    ];
  }

  /** Of a recording without masks: how much may be of the wrong side, and what helps. */
  sideDoubt(/** @type {State} */ { sides }) {
    if (typeof sides?.certainty !== "number") return null;
    return make(
      "p.note.warn",
      `The sides were found without masks. They estimate that ${percent(1 - sides.certainty)} of this cloth is of the ` +
        "wrong side; it can be several times as much. Compare the source images, and stroke what is wrong: ",
      this.page.smallButton("where_to_stroke"),
    );
  }

  /** What most doubtful cloth hangs on, and the way to look; if nothing else is wrong, that no joint is doubtful. */
  jointDoubt(/** @type {boolean} */ isSure, /** @type {number} */ reliable = 1) {
    const { told } = this.page.doubts;
    if (told !== "") return told && make("p.note.warn", `${told}: `, this.page.smallButton("doubts"));
    if (reliable >= 0.9) return isSure && make("p.note", "No joint is doubtful.");
    const text = "No joint by itself is doubtful, but places that hang on several are less sure: ";
    return isSure && make("p.note", text, this.page.smallButton("doubts"));
  }

  leftOut(/** @type {Left[]} */ every) {
    const large = every.filter((left) => CM2 * left.area_m2 >= LEAST_CM2);
    const reasons = [...new Set(large.map((left) => left.reason))];
    return [
      make("h3", "Seen but left out", make("span", cm2(areaOf(every)))),
      ...reasons.flatMap((reason) => this.leftFor(reason, large)),
      reasons.length ? null : make("p.note", `No view shows ${LEAST_CM2} cm² that are not in the result.`),
    ];
  }

  /** Cloth left out for one reason, and the views that show it. */
  leftFor(/** @type {string} */ reason, /** @type {Left[]} */ every) {
    const these = every.filter((left) => left.reason === reason);
    return [
      make("p.note", `${cm2(areaOf(these))}: ${reason}`),
      make(
        "div.chips",
        ...these.slice(0, MOST).map(({ view_index: view, area_m2 }) => {
          const click = () => this.page.send({ type: "turn_to", view_index: view });
          const about = { key: `left-${view}`, tip: "Turn the item to this view.", click };
          return make("button", about, `View ${view}: ${cm2(CM2 * area_m2)}`);
        }),
      ),
    ];
  }

  more(/** @type {import("../page/messages").More} */ { expected, share, reason }, /** @type {State} */ state) {
    const open = expected.filter(([view]) => state.views[view].why_not === null);
    const likely = (/** @type {number} */ area) => CM2 * (share ?? 1) * area;
    const best = open.slice(0, 3).filter(([, area]) => likely(area) >= LEAST_CM2);
    return [
      make("h3", "Another view"),
      !best.length && make("p.note", reason || "None would add cloth worth a view."),
      make(
        "ul",
        ...best.map(([view, area]) => {
          const click = () => this.page.timeline.propose(this.page.state.views[view]);
          const figure = make("span", `up to ${cm2(likely(area))}`);
          return make("li", make("button", { key: `more-${view}`, click }, make("b", `View ${view}`), figure));
        }),
      ),
    ];
  }

  exports(/** @type {State} */ state) {
    const kind = state.phase === "finished" ? "primary" : "";
    return make(
      "div.group",
      make("button.button", { data: { file: "data.zip" }, class: kind, key: "data.zip" }, "Export data"),
      button("All exports …", () => this.page.run("export"), { key: "all-exports" }),
    );
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

const areaOf = (/** @type {Left[]} */ every) => CM2 * every.reduce((sum, left) => sum + left.area_m2, 0);

/** The other side in a few words. */
function otherSide(/** @type {NonNullable<State["other"]>} */ { layers, is_related, reliable_share }) {
  const about = !is_related ? ", not joined" : reliable_share === null ? "" : `, ${percent(reliable_share)} reliable`;
  return `${cm2(layers?.area_cm2)}${about}`;
}
