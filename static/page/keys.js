// The action of a key in the current mode, from the table of actions.

import { taken, targetOf } from "./dom.js";
import { isMove } from "../canvas/nudges.js";

const REPEATED = ["zoom_in", "zoom_out", "turn_left_seen", "turn_right_seen"];

/**
 * Returns the listener, for frames that want it as well.
 * @param {{ state: () => State; modes: () => string[]; mayMove: () => boolean; run: (name: string, large: boolean) => void }} page
 *   with the uppermost of the modes first
 */
export function startKeys(page) {
  let tabbed = false; // whether the focus came by Tab; what a pointer pressed is not meant by a later Space

  function onKeyDown(/** @type {KeyboardEvent} */ event) {
    if (event.key === "Tab") tabbed = true;
    const state = page.state();
    if (!state || event.altKey || event.metaKey || document.querySelector("dialog[open]")) return;
    // The browser lets a dialog that was just closed keep the focus until it draws again.
    const target = targetOf(event).closest?.("dialog") ? document.body : targetOf(event);
    if (target.closest?.("input:not([type=range]):not([type=checkbox]), textarea, select, [contenteditable]")) return;
    if (target.closest?.("input[type=range]") && event.key.startsWith("Arrow")) return;
    const key = keyOf(event);
    const modes = page.modes();
    const action = (event.shiftKey && actionOf(state, modes, `Shift+${key}`)) || actionOf(state, modes, key);
    if (!action) return;
    // Space presses the button that was tabbed to, or that a card or menu has brought; Enter any.
    const brought = tabbed || target.closest?.("[role=dialog]");
    const presses = key === "Enter" || (key === "Space" && brought);
    if (presses && target.closest?.("button, a, input, summary, [role=button]")) return;
    // Where nothing can be moved the arrow keys keep their own meaning, such as scrolling.
    const moves = isMove(action.name);
    if (moves && !page.mayMove()) return;
    taken(event);
    if (event.repeat && !moves && !REPEATED.includes(action.name)) return;
    page.run(action.name, event.shiftKey);
  }

  document.addEventListener("keydown", onKeyDown);
  document.addEventListener("pointerdown", () => (tabbed = false));
  window.addEventListener("blur", () => (tabbed = false));
  return onKeyDown;
}

/**
 * The modes that are open come first; of the others, capture leaves its keys to the browser.
 * @param {State} state @param {string[]} modes @param {string} key
 */
function actionOf(state, modes, key) {
  const having = state.actions.filter((a) => a.keys.includes(key));
  const inOrder = [...modes, "", "session", "teaching"].map((mode) => having.find((a) => a.mode === mode));
  return inOrder.find(Boolean);
}

export function keyOf(/** @type {KeyboardEvent} */ event) {
  if (event.key === " ") return "Space";
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  return event.ctrlKey ? `Ctrl+${key}` : key;
}
