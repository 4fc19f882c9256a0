// The command palette: every action of the table that the present mode has, found by a few letters.

import { byId, make } from "./dom.js";
import { keyName } from "./format.js";

/** @type {Record<string, number>} */
const STEPS = { ArrowDown: 1, ArrowUp: -1, PageDown: 8, PageUp: -8 };

/** Open it; `run(name)` performs the chosen command after the palette has closed. */
export function showPalette(/** @type {ActionRow[]} */ actions, /** @type {(name: string) => void} */ run) {
  const dialog = byId("palette");
  const box = byId("palette-box");
  const list = byId("palette-list");
  let shown = /** @type {ActionRow[]} */ ([]);
  let at = 0;

  function search() {
    const words = box.value.toLowerCase().split(/\s+/).filter(Boolean);
    const found = actions
      .map((action) => ({ action, rank: rankOf(action, words) }))
      .filter(({ rank }) => rank < Infinity)
      .sort((a, b) => Number(a.action.why_not !== null) - Number(b.action.why_not !== null) || a.rank - b.rank);
    shown = found.map(({ action }) => action);
    list.replaceChildren(...shown.map(item));
    byId("palette-none").hidden = shown.length > 0;
    choose(0);
  }

  function item(/** @type {ActionRow} */ action, /** @type {number} */ index) {
    const off = action.why_not !== null;
    return make(
      "li",
      {
        role: "option",
        id: `palette-${index}`,
        "aria-disabled": off ? "true" : null,
        click: () => take(index),
        pointermove: () => choose(index),
      },
      make("strong", action.title),
      make("span", off ? `Not now: ${action.why_not}` : action.description),
      action.keys[0] && make("kbd", keyName(action.keys[0])),
    );
  }

  function choose(/** @type {number} */ index) {
    list.children[at]?.setAttribute("aria-selected", "false");
    at = Math.max(0, Math.min(shown.length - 1, index));
    const now = list.children[at];
    now?.setAttribute("aria-selected", "true");
    now?.scrollIntoView({ block: "nearest" });
    if (now) box.setAttribute("aria-activedescendant", now.id);
    else box.removeAttribute("aria-activedescendant");
  }

  function take(/** @type {number} */ index) {
    const action = shown[index];
    if (!action || action.why_not !== null) return;
    dialog.close();
    run(action.name);
  }

  box.value = "";
  box.oninput = search;
  dialog.onkeydown = (event) => {
    const by = STEPS[event.key];
    if (by) choose(at + by);
    else if (event.key === "Enter") take(at);
    else return;
    event.preventDefault();
  };
  dialog.onclick = (event) => event.target === dialog && dialog.close();
  search();
  dialog.showModal();
  box.focus();
}

/** How well the words fit, less being better; infinite if one does not. */
function rankOf(/** @type {ActionRow} */ action, /** @type {string[]} */ words) {
  const title = action.title.toLowerCase();
  const all = `${title} ${action.description.toLowerCase()} ${action.name.replaceAll("_", " ")}`;
  if (!words.every((word) => all.includes(word))) return Infinity;
  return words.reduce((rank, word) => rank + (title.startsWith(word) ? 0 : title.includes(word) ? 1 : 2), 0);
}
