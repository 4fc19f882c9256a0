// The arrow keys of the teaching mode: they move the pointer of a stage, or go on from stage to stage.

import { targetOf } from "/static/page/dom.js";
import { STAGES } from "/static/teaching/frame.js";

/** @type {Record<string, UV>} */
const SIDES = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const PROBE_STEP = 0.02; // of the shorter side of a pane, per arrow key

export function onKey(/** @type {Teaching} */ teaching, /** @type {KeyboardEvent} */ event) {
  const target = targetOf(event);
  if (event.ctrlKey || event.altKey || event.metaKey || target.matches("input")) return;
  const side = SIDES[event.key];
  if (!side) return;
  const stage = STAGES[teaching.at];
  if (target === teaching.canvas && stage.probe) moveProbe(teaching, side, event.shiftKey ? 5 : 1);
  else if (target.matches(".teaching-text") && side[1])
    return; // it scrolls
  else if (side[0]) teaching.takes(side[0] > 0 ? "teach_next" : "teach_back");
  else if (target.matches(".teaching-stage")) moveInList(teaching, target, side[1]);
  else return;
  event.preventDefault();
  event.stopPropagation();
}

/** @param {Teaching} teaching @param {number[]} parts @param {number} times */
function moveProbe(teaching, [right, down], times) {
  const pane = teaching.sheet.panes.find((p) => p.map.key === STAGES[teaching.at].probe);
  if (!pane) return;
  const { rect, scaleX, scaleY } = pane.map;
  const step = times * PROBE_STEP * Math.min(rect.w, rect.h);
  const [u, v] = teaching.ui.at;
  teaching.probe = { at: [u + (right * step) / scaleX, v + (down * step) / scaleY], moved: true };
  teaching.update();
}

/** @param {Teaching} teaching @param {HTMLElement} button @param {number} by */
function moveInList(teaching, button, by) {
  const all = /** @type {HTMLElement[]} */ ([...teaching.root.querySelectorAll(".teaching-stage")]);
  const next = all[Math.min(all.length - 1, Math.max(0, all.indexOf(button) + by))];
  next.focus();
}
