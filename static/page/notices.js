// Notifications: toasts that can be dismissed, and the log of all of them.

import { byId, make } from "/static/page/dom.js";

const STAYS_MS = { info: 7000, warning: 10000 }; // errors stay until they are dismissed
const KEPT = 200;
const WORDS = { info: "Note", warning: "Warning", error: "Error" };

let lastServerNote = null;
const kept = [];

/** Show a message and keep it in the log. */
export function notify(level, text, timeS = Date.now() / 1000) {
  keep(level, text, timeS);
  const toast = make(
    "div",
    { class: `toast ${level}`, role: level === "error" ? "alert" : "status" },
    make("strong", {}, WORDS[level] ?? "Note"),
    make("p", {}, text),
    make(
      "button",
      { type: "button", class: "close", "aria-label": "Dismiss", on: { click: () => toast.remove() } },
      "×",
    ),
  );
  byId("toasts").append(toast);
  while (byId("toasts").childElementCount > 4) byId("toasts").firstElementChild.remove();
  if (level in STAYS_MS) setTimeout(() => toast.remove(), STAYS_MS[level]);
}

function keep(level, text, timeS) {
  kept.push({ level, text, timeS });
  if (kept.length > KEPT) kept.shift();
}

/** Take the server's log: what is new becomes a toast, except what was there before this page. */
export function takeServerLog(log) {
  const first = lastServerNote === null;
  for (const note of log) {
    if (!first && note.id <= lastServerNote) continue;
    if (first) keep(note.level, note.text, note.time_s);
    else notify(note.level, note.text, note.time_s);
  }
  lastServerNote = Math.max(lastServerNote ?? 0, ...log.map((n) => n.id));
}

/** Another server process numbers its notes from the start. */
export function forgetServerLog() {
  lastServerNote = null;
  kept.length = 0;
}

export function showLog() {
  const items = kept.map((n) =>
    make(
      "li",
      { class: n.level },
      make("time", {}, new Date(1000 * n.timeS).toLocaleTimeString()),
      make("strong", {}, WORDS[n.level] ?? "Note"),
      make("span", {}, n.text),
    ),
  );
  byId("log-body").replaceChildren(
    ...(items.length ? items.reverse() : [make("li", {}, make("span", {}, "Nothing to report so far."))]),
  );
  byId("log").showModal();
}

/** One tooltip for the whole page: shown on hover and on keyboard focus, never in the way of the pointer. */
export function startTips() {
  const tip = byId("tip");
  let owner = null;
  const hide = () => {
    tip.hidden = true;
    owner = null;
  };
  const show = (event) => {
    const target = event.target.closest?.("[data-tip]");
    if (!target) return hide();
    if (event.type === "focusin" && !target.matches(":focus-visible")) return;
    owner = target;
    tip.textContent = target.dataset.tip;
    tip.hidden = false;
    const at = target.getBoundingClientRect();
    const box = tip.getBoundingClientRect();
    const below = at.bottom + 8 + box.height < innerHeight;
    tip.style.left = `${Math.max(8, Math.min(innerWidth - box.width - 8, at.left + at.width / 2 - box.width / 2))}px`;
    tip.style.top = `${below ? at.bottom + 8 : at.top - box.height - 8}px`;
  };
  document.addEventListener("pointerover", show);
  document.addEventListener("focusin", show);
  document.addEventListener("focusout", hide);
  document.addEventListener("pointerdown", hide);
  document.addEventListener("keydown", hide);
  document.addEventListener("pointerout", (event) => {
    if (owner && !owner.contains(event.relatedTarget)) hide();
  });
}
