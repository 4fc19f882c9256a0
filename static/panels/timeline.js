// The views of the recording in a row.

import { byId, make, rebuild } from "/static/page/dom.js";
import { number } from "/static/page/format.js";

const STATES = {
  start: ["●", "start view"],
  accepted: ["✓", "accepted"],
  fixed: ["✎", "accepted, moved by hand"],
  rejected: ["✕", "rejected"],
  skipped: ["»", "skipped"],
  later: ["…", "accepted, waits to follow"],
  pending: ["?", "proposed"],
  unused: ["", "not used"],
};

export function showTimeline(state, choose) {
  const live = state.mode === "live";
  rebuild(byId("timeline"), state.views, () =>
    state.views.map((view) => {
      const [sign, state_word] = STATES[view.state];
      const word = view.flagged ? `${state_word}, flagged: its score was below the limit` : state_word;
      const detail = view.detail ? ` (${view.detail})` : "";
      const kept = ["start", "pending"].includes(view.state);
      const decided = !kept && view.state !== "unused";
      const act = state.capture
        ? "\nOn disk."
        : live
          ? "\nClick: show this frame."
          : decided
            ? "\nClick: look at the decision, reopen it."
            : view.why_not === null
              ? "\nClick: propose this view."
              : kept
                ? ""
                : `\nNot now: ${view.why_not}`;
      const about = `View ${view.index}, ${number(view.angle_deg, 0)}°${live ? "" : `: ${word}${detail}`}`;
      return make(
        "button",
        {
          type: "button",
          class: `view ${view.state}${view.flagged ? " flagged" : ""}`,
          "aria-disabled": String(view.why_not !== null && !decided),
          "aria-label": about,
          data: { id: `view-${view.index}`, tip: about + act },
          on: { click: () => choose(view) },
        },
        make("span", { class: "sign", "aria-hidden": "true" }, live ? String(view.index) : view.flagged ? "⚑" : sign),
        make("span", { class: "angle" }, number(view.angle_deg, 0)),
      );
    }),
  );
  if (!live) markPresent(state.present_view); // in live mode each frame does
}

/** Mark the view at whose rotation the item stands. */
export function markPresent(index) {
  const views = byId("timeline").children;
  for (const view of byId("timeline").querySelectorAll(".present")) {
    if (view === views[index]) return;
    view.classList.remove("present");
    view.removeAttribute("aria-current");
  }
  views[index]?.classList.add("present");
  views[index]?.setAttribute("aria-current", "true");
}
