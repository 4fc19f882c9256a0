// What a key means: looked up in the table of actions, in the mode that is open.

import { isMove } from "/static/nudges.js";

const REPEATED = ["zoom_in", "zoom_out", "turn_left_seen", "turn_right_seen", "live_back", "live_forward"];

/** `page`: state(), mode(), run(name, large). Returns the listener, for frames that want it as well. */
export function startKeys(page) {
  let tabbed = false; // whether the focus came by Tab; what a pointer pressed is not meant by a later Space

  function onKeyDown(event) {
    if (event.key === "Tab") tabbed = true;
    const state = page.state();
    if (!state || event.altKey || event.metaKey || document.querySelector("dialog[open]")) return;
    const target = event.target;
    if (target.closest?.("input:not([type=range]):not([type=checkbox]), textarea, select, [contenteditable]")) return;
    if (target.closest?.("input[type=range]") && event.key.startsWith("Arrow")) return;
    const key = keyOf(event);
    const action = (event.shiftKey && actionOf(state, page.mode(), `Shift+${key}`)) || actionOf(state, page.mode(), key);
    if (!action) return;
    // Space presses the button that was tabbed to.
    if (key === "Space" && tabbed && target.closest?.("button, a, input, [role=button]")) return;
    // Without a proposal the arrow keys keep their own meaning, such as scrolling.
    const moves = isMove(action.name);
    if (moves && !state.pending) return;
    event.preventDefault();
    event.stopPropagation();
    if (event.repeat && !moves && !REPEATED.includes(action.name)) return;
    page.run(action.name, event.shiftKey);
  }

  document.addEventListener("keydown", onKeyDown);
  document.addEventListener("pointerdown", () => (tabbed = false));
  window.addEventListener("blur", () => (tabbed = false));
  return onKeyDown;
}

/** The mode that is open comes first, and the other modes' keys stay the browser's. */
function actionOf(state, mode, key) {
  const having = state.actions.filter((a) => a.keys.includes(key));
  const elsewhere = ["", "session"].flatMap((m) => having.filter((a) => a.mode === m));
  // The keys of teaching alone say where they belong; those of live mode and capture stay the browser's.
  return having.find((a) => a.mode === mode) ?? elsewhere[0] ?? having.find((a) => a.mode === "teaching");
}

function keyOf(event) {
  if (event.key === " ") return "Space";
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  return event.ctrlKey ? `Ctrl+${key}` : key;
}
