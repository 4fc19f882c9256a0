// What this browser keeps: light or dark, as the system until the operator chooses (viser's frame gets the same);
// and switches of the page.

/** Where it keeps that; null where it forbids to keep anything, as for some files. */
const kept = (() => {
  try {
    return localStorage;
  } catch {
    return null;
  }
})();

/** A switch that is kept. */
export class KeptSwitch {
  constructor(/** @type {string} */ name, usual = false) {
    this.name = `flatcloth-${name}`;
    this.usual = usual;
  }

  get on() {
    return (kept?.getItem(this.name) ?? (this.usual ? "yes" : "no")) === "yes";
  }

  set on(on) {
    kept?.setItem(this.name, on ? "yes" : "no");
  }
}

const STORED = "flatcloth-theme";
const system = matchMedia("(prefers-color-scheme: dark)");
let chosen = kept?.getItem(STORED) ?? ""; // nothing: as the system
const listeners = /** @type {((dark: boolean) => void)[]} */ ([]);

export const isDark = () => (chosen || (system.matches ? "dark" : "light")) === "dark";

export const onTheme = (/** @type {(dark: boolean) => void} */ listener) => listeners.push(listener);

export function toggleTheme() {
  chosen = isDark() ? "light" : "dark";
  kept?.setItem(STORED, chosen);
  applyTheme();
}

export function applyTheme() {
  document.documentElement.dataset.theme = isDark() ? "dark" : "light";
  for (const listener of listeners) listener(isDark());
}

system.addEventListener("change", applyTheme);
