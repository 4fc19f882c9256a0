// Notifications: toasts that can be dismissed, and the log of all of them.

import { byId, closeButton, make, openSheet, placeBeside, staysIn, targetOf } from "./dom.js";

const KEPT = 200;
const RESTS_MS = 500; // the pointer on a thing, until its tooltip appears: it only passes over most
const WORDS = { info: "Note", warning: "Warning", error: "Error" };

let lastServerNote = -1; // none
const kept = /** @type {{ level: Note["level"]; text: string; timeS: number }[]} */ ([]);

/** A note is not shown while something worse is, and errors alone while it is `quiet`: the log has all. */
let quiet = false;

/** Show a message and keep it in the log. */
export function notify(/** @type {Note["level"]} */ level, /** @type {string} */ text, timeS = Date.now() / 1000) {
  keep(level, text, timeS);
  if (level !== "error" && quiet) return;
  if (level === "info" && byId("toasts").querySelector(".warning, .error")) return;
  /** @type {HTMLElement} */
  const toast = make(
    "div",
    { class: `toast ${level}`, role: level === "error" ? "alert" : "status" },
    make("p", text),
    closeButton("Dismiss", () => toast.remove()),
  );
  toast.addEventListener("animationend", () => toast.remove()); // its time, by the style sheet
  byId("toasts").replaceChildren(toast); // more would lie over what they are about
}

/** @param {Note["level"]} level @param {string} text @param {number} timeS */
function keep(level, text, timeS) {
  kept.push({ level, text, timeS });
  if (kept.length > KEPT) kept.shift();
}

/**
 * Take the server's log: what is new becomes a toast, except what was there before this page.
 * @param {Note[]} log
 * @param {boolean} isAuto while Auto runs, the hint line says what it does
 */
export function takeServerLog(log, isAuto) {
  quiet = isAuto;
  const first = lastServerNote < 0;
  for (const note of log) {
    if (!first && note.id <= lastServerNote) continue;
    if (first) keep(note.level, note.text, note.time_s);
    else notify(note.level, note.text, note.time_s);
  }
  lastServerNote = Math.max(lastServerNote, 0, ...log.map((n) => n.id));
}

/** Another server process numbers its notes from the start. */
export function forgetServerLog() {
  lastServerNote = -1;
  kept.length = 0;
}

export function showLog() {
  const items = kept.map((n) =>
    make(
      "li",
      { class: n.level },
      make("time", new Date(1000 * n.timeS).toLocaleTimeString()),
      make("strong", WORDS[n.level]),
      make("span", n.text),
    ),
  );
  const none = make("li", make("span", "Nothing to report so far."));
  byId("log-body").replaceChildren(...(items.length ? items.reverse() : [none]));
  openSheet("log", "l");
}

/** One tooltip for the whole page: shown on hover and where keys move the focus, not where something opens. */
export function startTips() {
  const tip = byId("tip");
  let owner = /** @type {Element | null} */ (null);
  let timer = 0;
  let tabbed = false;
  const hide = () => {
    clearTimeout(timer);
    tip.hidden = true;
    owner = null;
  };
  const show = (/** @type {Event} */ event) => {
    const target = /** @type {HTMLElement | null} */ (targetOf(event).closest?.("[data-tip]"));
    if (!target?.dataset.tip) return hide();
    const byPointer = event instanceof PointerEvent;
    const isMoved = target.matches(":focus-visible") && (event.type === "roved" || tabbed);
    if (byPointer ? event.pointerType === "touch" : !isMoved) return;
    if (target === owner) return;
    hide();
    owner = target;
    timer = setTimeout(() => appear(target), byPointer ? RESTS_MS : 0);
  };
  const appear = (/** @type {HTMLElement} */ target) => {
    if (!target.isConnected) return; // what it was about is gone, and something else lies under the pointer
    tip.textContent = target.dataset.tip ?? ""; // as it is by now
    tip.hidden = false;
    const at = target.getBoundingClientRect();
    placeBeside(tip, at, at.bottom + 8 + tip.getBoundingClientRect().height < innerHeight);
  };
  document.addEventListener("pointerover", show);
  document.addEventListener("focusin", show);
  document.addEventListener("roved", show);
  document.addEventListener("focusout", hide);
  document.addEventListener("pointerdown", hide);
  document.addEventListener("keydown", (event) => {
    hide();
    tabbed = event.key === "Tab";
  });
  document.addEventListener("pointerout", (event) => {
    if (owner && !staysIn(owner, event)) hide();
  });
}
