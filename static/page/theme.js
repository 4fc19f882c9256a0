// What this browser keeps: light or dark, as the system until the operator chooses (viser's frame gets the same);
// and switches of the page.

/** A switch that is kept. */
export class KeptSwitch {
  constructor(/** @type {string} */ name, usual = false) {
    this.name = `flatcloth-${name}`;
    this.usual = usual;
  }

  get on() {
    return (localStorage.getItem(this.name) ?? (this.usual ? "yes" : "no")) === "yes";
  }

  set on(on) {
    localStorage.setItem(this.name, on ? "yes" : "no");
  }

  toggle() {
    this.on = !this.on;
  }
}

const STORED = "flatcloth-theme";
const system = matchMedia("(prefers-color-scheme: dark)");
const listeners = /** @type {((dark: boolean) => void)[]} */ ([]);

export const isDark = () => (localStorage.getItem(STORED) ?? (system.matches ? "dark" : "light")) === "dark";

export const onTheme = (/** @type {(dark: boolean) => void} */ listener) => listeners.push(listener);

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
