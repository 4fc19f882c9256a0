// The result: how much cloth, how reliable, what is missing and why, what to review, and the data to take away.

import { byId, make, rebuild, valueRow } from "/static/page/dom.js";
import { exportButton, showExports } from "/static/page/exports.js";
import { count, floatingOf, number } from "/static/page/format.js";
import { doubtsOf, flagsOf } from "/static/review/timeline.js";

const MOST = 4; // of each list

export class ResultPanel {
  name = "result";

  constructor(page, verdicts) {
    this.page = page;
    this.verdicts = verdicts;
    this.section = byId("result");
    this.asked = this.wanted = false; // open, though the integration has not ended
    this.closed = null; // the end for which it was closed
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

  update(state) {
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

  async load(revision) {
    this.loading = revision;
    try {
      const answer = await fetch("/review/result.json");
      if (!answer.ok) throw new Error(await answer.text());
      this.found = await answer.json();
    } catch (error) {
      this.found = { revision, trouble: error.message };
    }
    if (this.found.revision !== this.loading) this.loading = 0; // a newer picture is on its way
    this.page.changed();
  }

  build(state, found) {
    const { layers, finished } = state;
    const { pieces, area_cm2: floating } = floatingOf(layers);
    const letters = pieces.map((piece) => piece.label).join(", ");
    return [
      make(
        "div",
        { class: "heading" },
        make("h2", {}, finished ? "Finished" : "Result so far"),
        make(
          "button",
          {
            type: "button",
            class: "close",
            "aria-label": "Close the result",
            data: { id: "close-result" },
            on: { click: () => this.toggle() },
          },
          "×",
        ),
      ),
      finished ? make("p", { class: "note" }, finished.replaceAll("cm2", "cm²")) : null,
      make(
        "dl",
        { class: "values" },
        ...valueRow("Shape", `${number(layers.area_cm2, 0)} cm² from ${count(state.step, "view")}`),
        ...(floating
          ? valueRow(
              "Floating",
              `${number(floating, 0)} cm² (${letters})`,
              "Cloth that no view connects to the shape yet",
            )
          : []),
        ...(found && !found.trouble ? this.certainty(found) : []),
      ),
      found ? null : make("p", { class: "note", role: "status" }, "Looking for what was left out …"),
      found?.trouble ? make("p", { class: "note" }, found.trouble) : null,
      ...(found && !found.trouble ? [...this.leftOut(found), ...this.more(found, state)] : []),
      ...this.toReview(state),
      ...this.exports(state),
    ].filter(Boolean);
  }

  certainty(found) {
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

  leftOut(found) {
    const total = found.left_out.reduce((sum, left) => sum + left.area_cm2, 0);
    const reasons = [...new Set(found.left_out.map((left) => left.reason))];
    return [
      make("h3", {}, "Seen but left out", make("span", {}, `${number(total, 0)} cm²`)),
      ...reasons.flatMap((reason) => this.leftFor(reason, found.left_out)),
      reasons.length ? null : make("p", { class: "note" }, "None: the result has all the cloth that its views show."),
    ];
  }

  /** Cloth left out for one reason, and the views that show it. */
  leftFor(reason, every) {
    const these = every.filter((left) => left.reason === reason);
    const area = these.reduce((sum, left) => sum + left.area_cm2, 0);
    return [
      make("p", { class: "note" }, `${number(area, 0)} cm²: ${reason}`),
      make(
        "div",
        { class: "chips" },
        ...these
          .slice(0, MOST)
          .map((left) =>
            make(
              "button",
              {
                type: "button",
                data: { id: `left-${left.view_index}`, tip: "Turn the item to this view." },
                on: { click: () => this.page.send({ type: "turn_to", view_index: left.view_index }) },
              },
              `View ${left.view_index}: ${number(left.area_cm2, 0)}`,
            ),
          ),
      ),
    ];
  }

  more(found, state) {
    const { expected, share, reason } = found.more;
    const open = expected.filter(({ view_index }) => state.views[view_index].why_not === null);
    const likely = (cm2) => `${number(share === null ? cm2 : share * cm2, 0)} cm²`;
    const best = open.slice(0, 3);
    const total = best.reduce((sum, one) => sum + one.area_cm2, 0);
    const told =
      share === null
        ? "by the planner's estimate"
        : `of ${number(total, 0)} estimated: the last views added ${number(100 * share, 0)} % of their estimates`;
    return [
      make("h3", {}, "Another view"),
      best.length
        ? make(
            "p",
            { class: "note" },
            `${count(best.length, "more view")} would add about ${likely(total)}, ${told}.`,
          )
        : make("p", { class: "note" }, reason.replaceAll("cm2", "cm²")),
      make(
        "ul",
        {},
        ...best.map(({ view_index, area_cm2 }) =>
          this.link(view_index, `more-${view_index}`, `about ${likely(area_cm2)}`, "", () =>
            this.verdicts.propose(this.page.state.views[view_index]),
          ),
        ),
      ),
    ];
  }

  toReview(state) {
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
    return [make("h3", {}, "Weakest views"), make("ul", {}, ...items)];
  }

  exports(state) {
    const { name } = state.recording;
    const notify = (level, text) => this.page.notify(level, text);
    return [
      make(
        "div",
        { class: "group" },
        exportButton("data.zip", "Export data", notify, name, state.phase === "finished" ? "primary" : ""),
        make(
          "button",
          {
            type: "button",
            class: "button",
            data: { id: "all-exports" },
            on: { click: () => showExports(notify, state) },
          },
          "All exports …",
        ),
      ),
    ];
  }

  /** A line about a view; a press goes there. */
  link(index, id, figure, about, press) {
    return make(
      "li",
      {},
      make(
        "button",
        { type: "button", data: { id }, on: { click: press } },
        make("b", {}, `View ${index}`),
        make("span", {}, figure),
        about ? make("small", {}, about) : null,
      ),
    );
  }

  get status() {
    return { open: !this.section.hidden, found: this.found };
  }
}
