// Light and dark: the system's choice until the operator makes one; viser's frame gets the same.

const STORED = "flatcloth-theme";
const system = matchMedia("(prefers-color-scheme: dark)");
/** @type {((dark: boolean) => void)[]} */
const listeners = [];

export const isDark = () => (localStorage.getItem(STORED) ?? (system.matches ? "dark" : "light")) === "dark";

export function onTheme(/** @type {(dark: boolean) => void} */ listener) {
  listeners.push(listener);
}

/** What the operator chose; nothing: as the system. */
export const chosenTheme = () => localStorage.getItem(STORED) ?? "";

export function setTheme(/** @type {string} */ name) {
  if (name) localStorage.setItem(STORED, name);
  else localStorage.removeItem(STORED);
  applyTheme();
}

export const toggleTheme = () => setTheme(isDark() ? "light" : "dark");

export function applyTheme() {
  document.documentElement.dataset.theme = isDark() ? "dark" : "light";
  for (const listener of listeners) listener(isDark());
}

system.addEventListener("change", applyTheme);
