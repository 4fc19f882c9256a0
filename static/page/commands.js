// The sheet of commands: what can be done here, or about one thing, with the keys; found by a few letters, and done when
// it is chosen.

import { find, make, within } from "./dom.js";
import { keyName } from "./format.js";
import { keyOf } from "./keys.js";

/** @typedef {{ name: string; title: string; label?: string; description: string; keys: string[]; group: string }} Row */
/** @typedef {Row & { why_not?: string | null }} Command */

/** @type {Record<string, number>} */
const STEPS = { ArrowDown: 1, ArrowUp: -1, PageDown: 8, PageUp: -8 };
/** What the pointer does: told, not done. @type {Command[]} */
export const GESTURES = [
  ["Click", "Pick a grasp point, on the flattened view or in 3D."],
  ["Drag", "Pan the flattened view, turn the item in 3D; on what can be moved: move it, with Shift turn it."],
  ["Right drag", "Pan, also over what can be moved."],
  ["Wheel", "Zoom at the pointer."],
].map(([title, description]) => ({ name: "", title, description, keys: [], group: "pointer" }));

/**
 * Open it; `run(name)` performs the chosen command after the sheet has closed.
 * @param {Command[]} commands @param {(name: string) => void} run
 * @param {string} about what they are about, if not the page; then the keys of each do it at once
 */
export function showCommands(commands, run, about = "") {
  const box = make("input", {
    id: "palette-box",
    type: "text",
    role: "combobox",
    label: "Command",
    "aria-expanded": "true",
    "aria-controls": "palette-list",
    "aria-autocomplete": "list",
    placeholder: "What do you want to do?",
    autocomplete: "off",
    spellcheck: "false",
    class: about ? "unseen" : "",
    input: () => search(),
  });
  const list = make("ul#palette-list", { role: "listbox", label: "Commands" });
  const none = make("p.nothing", "No command has these words.");
  const dialog = make(
    "dialog#palette.sheet.palette",
    { "aria-label": about || "Commands" },
    about && make("p", about),
    box,
    list,
    none,
  );
  let shown = /** @type {Command[]} */ ([]);
  let at = 0;

  function search() {
    const words = box.value.toLowerCase().split(/\s+/).filter(Boolean);
    const found = commands.map((command) => ({ command, rank: rankOf(command, words) }));
    const off = (/** @type {Command} */ { why_not }) => Number(Boolean(why_not));
    // Without words all are there in their groups, as a sheet of the keys.
    if (words.length) found.sort((a, b) => off(a.command) - off(b.command) || a.rank - b.rank);
    shown = found.filter(({ rank }) => rank < Infinity).map(({ command }) => command);
    list.replaceChildren(...shown.map((command, n) => item(command, n, !words.length)));
    none.hidden = shown.length > 0;
    choose(0);
  }

  /** @param {Command} command @param {number} n @param {boolean} isGrouped */
  function item({ name, title, label, description, keys, group, why_not }, n, isGrouped) {
    return make(
      "li",
      {
        role: "option",
        id: `palette-${n}`,
        data: isGrouped && group !== shown[n - 1]?.group ? { group } : {},
        "aria-disabled": why_not || !name ? "true" : null,
        click: () => take(n),
        pointermove: () => choose(n),
      },
      make("strong", label ?? title),
      make("span", why_not ? `Not now: ${why_not}` : description),
      make("span", ...keys.slice(0, 2).map((key) => make("kbd", keyName(key)))),
    );
  }

  function choose(/** @type {number} */ n) {
    list.children[at]?.setAttribute("aria-selected", "false");
    at = within(n, 0, Math.max(0, shown.length - 1));
    const now = list.children[at];
    now?.setAttribute("aria-selected", "true");
    now?.scrollIntoView({ block: "nearest" });
    if (now) box.setAttribute("aria-activedescendant", now.id);
    else box.removeAttribute("aria-activedescendant");
  }

  function take(/** @type {number} */ n) {
    const command = shown[n];
    if (!command?.name || command.why_not) return;
    dialog.close();
    run(command.name);
  }

  dialog.addEventListener("keydown", (event) => {
    const by = STEPS[event.key];
    const own = about ? shown.findIndex(({ keys }) => keys.includes(keyOf(event))) : -1;
    if (by) choose(at + by);
    else if (event.key === "Enter") take(at);
    else if (event.key === "?" && !box.value) dialog.close();
    else if (own >= 0) take(own);
    else return;
    event.preventDefault();
    event.stopPropagation();
  });
  dialog.addEventListener("click", (event) => event.target === dialog && dialog.close());
  find("#palette")?.remove();
  document.body.append(dialog);
  search();
  dialog.showModal();
  box.focus();
}

/** How well the words fit, less being better; infinite if one does not. */
function rankOf(/** @type {Command} */ command, /** @type {string[]} */ words) {
  const title = command.title.toLowerCase();
  const all = `${title} ${command.description.toLowerCase()} ${command.name.replaceAll("_", " ")}`;
  if (!words.every((word) => all.includes(word))) return Infinity;
  return words.reduce((rank, word) => rank + (title.startsWith(word) ? 0 : title.includes(word) ? 1 : 2), 0);
}
