// The arrow keys of the teaching mode: they move the pointer of a stage, or go on from stage to stage.

import { findAll, isPlain, taken, targetOf, WAYS, within } from "../page/dom.js";
import { STAGES } from "./frame.js";

const PROBE_STEP = 0.02; // of the shorter side of a pane, per arrow key

export function onKey(/** @type {Teaching} */ teaching, /** @type {KeyboardEvent} */ event) {
  const target = targetOf(event);
  if (!isPlain(event) || target.matches("input")) return;
  const side = WAYS[event.key];
  if (!side) return;
  const stage = STAGES[teaching.at];
  if (target === teaching.canvas && stage.probe) moveProbe(teaching, side, event.shiftKey ? 5 : 1);
  else if (target.matches(".teaching-text") && side[1])
    return; // it scrolls
  else if (side[0]) teaching.takes(side[0] > 0 ? "teach_next" : "teach_back");
  else if (target.matches(".teaching-stage")) moveInList(target, side[1]);
  else return;
  taken(event);
}

/** @param {Teaching} teaching @param {number[]} parts @param {number} times */
function moveProbe(teaching, [right, down], times) {
  const map = teaching.sheet.panes.find(({ key }) => key === STAGES[teaching.at].probe);
  if (!map) return;
  const { rect, scaleX, scaleY } = map;
  const step = times * PROBE_STEP * Math.min(rect.w, rect.h);
  const [u, v] = teaching.ui.at;
  teaching.probe = { at: [u + (right * step) / scaleX, v + (down * step) / scaleY], moved: true };
  teaching.update();
}

function moveInList(/** @type {HTMLElement} */ button, /** @type {number} */ by) {
  const all = findAll(".teaching-stage");
  all[within(all.indexOf(button) + by, 0, all.length - 1)].focus();
}
