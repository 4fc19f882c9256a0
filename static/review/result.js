// The result: how much cloth, how reliable, what is missing and why, what to review, and the data to take away.

import { byId, make, rebuild, valueRow } from "/static/page/dom.js";
import { exportButton, showExports } from "/static/page/exports.js";
import { count, floatingOf, number } from "/static/page/format.js";
import { doubtsOf, flagsOf } from "/static/review/timeline.js";

const MOST = 4; // of each list

/**
 * @typedef {{ view_index: number; reason: string; area_cm2: number }} Left
 *   cloth that a view shows and the result has not
 *
 * @typedef {object} Found what /review/result.json tells; `trouble` if it cannot
 * @property {number} revision
 * @property {string} [trouble]
 * @property {number | null} median_std_mm
 * @property {number} reliable_share
 * @property {Left[]} left_out
 * @property {{ expected: { view_index: number; area_cm2: number }[]; share: number | null; reason: string }} more
 */

export class ResultPanel {
  name = "result";

  constructor(/** @type {Page} */ page, /** @type {Verdicts} */ verdicts) {
    this.page = page;
    this.verdicts = verdicts;
    this.section = byId("result");
    this.asked = this.wanted = false; // open, though the integration has not ended
    /** @type {string | null} */
    this.closed = null; // the end for which it was closed
    /** @type {Found | null} */
    this.found = null; // the server's answer
    this.loading = 0; // the revision that was asked for
    this.actions = { result: () => this.toggle() };
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
      this.closed = this.page.state.finished;
    }
    this.page.changed();
    if (this.asked) this.section.scrollIntoView({ block: "nearest" });
  }

  update(/** @type {State} */ state) {
    const ended = state.phase === "finished" && this.closed !== state.finished;
    if (state.phase !== "finished") this.closed = null;
    this.section.hidden = !state.review || !state.layers || Boolean(state.pending) || !(ended || this.asked);
    if (this.section.hidden) return;
    const { revision } = state.layers;
    if (this.loading !== revision) this.load(revision);
    const found = this.found?.revision === revision ? this.found : null;
    rebuild(this.section, [state.views, state.layers.area_cm2, state.layers.pieces, state.finished, found], () =>
      this.build(state, found),
    );
  }

  async load(/** @type {number} */ revision) {
    this.loading = revision;
    try {
      const answer = await fetch("/review/result.json");
      if (!answer.ok) throw new Error(await answer.text());
      this.found = await answer.json();
    } catch (error) {
      this.found = /** @type {Found} */ ({ revision, trouble: /** @type {Error} */ (error).message });
    }
    if (this.found.revision !== this.loading) this.loading = 0; // a newer picture is on its way
    this.page.changed();
  }

  build(/** @type {State} */ state, /** @type {Found | null} */ found) {
    const { layers, finished } = state;
    const { pieces, area_cm2: floating } = floatingOf(layers);
    const letters = pieces.map((piece) => piece.label).join(", ");
    return [
      make(
        "div.heading",
        make("h2", finished ? "Finished" : "Result so far"),
        make("button.close", { label: "Close the result", key: "close-result", click: () => this.toggle() }, "×"),
      ),
      finished && make("p.note", finished.replaceAll("cm2", "cm²")),
      make(
        "dl.values",
        ...valueRow("Shape", `${number(layers.area_cm2, 0)} cm² from ${count(state.step, "view")}`),
        floating &&
          valueRow(
            "Floating",
            `${number(floating, 0)} cm² (${letters})`,
            "Cloth that no view connects to the shape yet",
          ),
        found && !found.trouble && this.certainty(found),
      ),
      !found && make("p.note", { role: "status" }, "Looking for what was left out …"),
      found?.trouble && make("p.note", found.trouble),
      found && !found.trouble && [...this.leftOut(found), ...this.more(found, state)],
      ...this.toReview(state),
      ...this.exports(state),
    ];
  }

  certainty(/** @type {Found} */ found) {
    if (found.median_std_mm === null || found.median_std_mm === undefined) return [];
    return [
      ...valueRow(
        "Reliable",
        `${number(100 * found.reliable_share, 0)} %`,
        "Share of the shape placed to 10 mm or better",
      ),
      ...valueRow("Uncertainty", `${number(found.median_std_mm)} mm`, "Median standard deviation of a pixel's place"),
    ];
  }

  leftOut(/** @type {Found} */ found) {
    const total = found.left_out.reduce((sum, left) => sum + left.area_cm2, 0);
    const reasons = [...new Set(found.left_out.map((left) => left.reason))];
    return [
      make("h3", "Seen but left out", make("span", `${number(total, 0)} cm²`)),
      ...reasons.flatMap((reason) => this.leftFor(reason, found.left_out)),
      reasons.length ? null : make("p.note", "None: the result has all the cloth that its views show."),
    ];
  }

  /** Cloth left out for one reason, and the views that show it. */
  leftFor(/** @type {string} */ reason, /** @type {Left[]} */ every) {
    const these = every.filter((left) => left.reason === reason);
    const area = these.reduce((sum, left) => sum + left.area_cm2, 0);
    return [
      make("p.note", `${number(area, 0)} cm²: ${reason}`),
      make(
        "div.chips",
        ...these
          .slice(0, MOST)
          .map((left) =>
            make("button", {
              key: `left-${left.view_index}`,
              tip: "Turn the item to this view.",
              click: () => this.page.send({ type: "turn_to", view_index: left.view_index }),
              text: `View ${left.view_index}: ${number(left.area_cm2, 0)}`,
            }),
          ),
      ),
    ];
  }

  more(/** @type {Found} */ found, /** @type {State} */ state) {
    const { expected, share, reason } = found.more;
    const open = expected.filter(({ view_index }) => state.views[view_index].why_not === null);
    const likely = (/** @type {number} */ cm2) => `${number(share === null ? cm2 : share * cm2, 0)} cm²`;
    const best = open.slice(0, 3);
    const total = best.reduce((sum, one) => sum + one.area_cm2, 0);
    const told =
      share === null
        ? "by the planner's estimate"
        : `of ${number(total, 0)} estimated: the last views added ${number(100 * share, 0)} % of their estimates`;
    return [
      make("h3", "Another view"),
      best.length
        ? make("p.note", `${count(best.length, "more view")} would add about ${likely(total)}, ${told}.`)
        : make("p.note", reason.replaceAll("cm2", "cm²")),
      make(
        "ul",
        ...best.map(({ view_index, area_cm2 }) =>
          this.link(view_index, `more-${view_index}`, `about ${likely(area_cm2)}`, "", () =>
            this.verdicts.propose(this.page.state.views[view_index]),
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
          Number(b.flagged) - Number(a.flagged) || doubtsOf(b).length - doubtsOf(a).length || a.score - b.score,
      )
      .slice(0, 3);
    if (!weak.length) return [];
    const items = weak.map((view) => {
      const flags = flagsOf(view, state).join(", ");
      return this.link(view.index, `weak-${view.index}`, `score ${number(view.score, 2)}`, flags, () =>
        this.verdicts.goTo(this.page.state.views[view.index]),
      );
    });
    return [make("h3", "Weakest views"), make("ul", ...items)];
  }

  exports(/** @type {State} */ state) {
    const { name } = state.recording;
    const notify = (/** @type {Note["level"]} */ level, /** @type {string} */ text) => this.page.notify(level, text);
    return [
      make(
        "div.group",
        exportButton("data.zip", "Export data", notify, name, state.phase === "finished" ? "primary" : ""),
        make("button.button", { key: "all-exports", click: () => showExports(notify, state) }, "All exports …"),
      ),
    ];
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
