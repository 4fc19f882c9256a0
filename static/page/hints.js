// The line that says what can be done next.

import { count, floatingOf, number } from "/static/page/format.js";

/** How large the shape is, and what floats beside it. */
function shapeOf({ step, layers }) {
  const { pieces, area_cm2: floating } = floatingOf(layers);
  const beside = floating ? ` ${number(floating, 0)} cm² float in ${count(pieces.length, "piece")}.` : "";
  return ` Shape: ${count(step, "view")}, ${number(layers.area_cm2, 0)} cm².${beside}`;
}

/** What to do next, in a line. */
export function hint(state) {
  const angle = (i, word = "view") => `${word} ${i} (${number(state.views[i].angle_deg, 0)}°)`;
  const area = state.layers ? shapeOf(state) : "";
  const waiting = state.n_later
    ? ` Then ${count(state.n_later, "later view")} follow${state.n_later === 1 ? "s" : ""}.`
    : "";
  if (state.auto.running && state.phase !== "computing") return `Auto is running; press Auto (G) to stop it.${area}`;
  if (state.mode === "live") return "";
  switch (state.phase) {
    case "computing":
      if (state.request.kind === "start") return "Choosing and flattening the start view.";
      if (state.request.kind === "follow")
        return `Laying ${angle(state.request.view_index)} on the changed shape.${area}`;
      return state.request.view_index === null
        ? `Looking for the next view.${area}`
        : `Laying ${angle(state.request.view_index)} on the shape.${area}`;
    case "deciding":
      if (state.pending.again && !state.pending.why)
        return (
          `${angle(state.pending.view_index, "View")} is decided again: Accept (A), Reject (R), Skip (K) or move it;` +
          ` Undo (U) leaves it as it was.${waiting}${area}`
        );
      return (
        `Is ${angle(state.pending.view_index)} in its place? Accept (A), Reject (R), Skip (K),` +
        ` or move it with the arrow keys.${waiting}${area}`
      );
    case "finished":
      return `Finished: ${state.finished.replaceAll("cm2", "cm²")} Click the cloth for a grasp point.${area}`;
    default:
      return state.start_view === null
        ? "Press Step (S): the start view is chosen and flattened."
        : state.n_later
          ? `${count(state.n_later, "later view")} wait${state.n_later === 1 ? "s" : ""} to follow.` +
            ` Press Step (S) to go on.${area}`
          : `Press Step (S): the next view is chosen, flattened and placed on the shape.${area}`;
  }
}
