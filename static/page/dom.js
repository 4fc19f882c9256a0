// Small tools to build the page. Text always goes in as text, never as HTML.

/** @returns {any} the element, of whatever kind it is */
export const byId = (id) => document.getElementById(id);

/**
 * Make an element: attributes, `on` for listeners, `data` for data-*, then children (nodes or text).
 *
 * @param {string} tag
 * @param {Record<string, any>} attributes
 * @param {...(Node | string | null)} children
 * @returns {any}
 */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name === "on") for (const [type, f] of Object.entries(value)) element.addEventListener(type, f);
    else if (name === "class") element.className = value;
    else if (name === "data") Object.assign(element.dataset, value);
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.filter((c) => c !== null && c !== undefined));
  return element;
}

/** A name and its value for a list of values (dl). */
export const valueRow = (name, text, tip = null) => [
  make("dt", { data: tip ? { tip } : {} }, name),
  make("dd", {}, text),
];

/** Set text only if it has changed, so that screen readers do not repeat it. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Rebuild a container only if what it shows has changed; keeps the focus on the same control. */
export function rebuild(container, key, build) {
  const text = JSON.stringify(key);
  if (container.dataset.key === text) return;
  /** @type {any} */
  const active = document.activeElement;
  const focused = container.contains(active) ? active.dataset.id : undefined;
  container.dataset.key = text;
  container.replaceChildren(...build());
  if (focused) container.querySelector(`[data-id="${CSS.escape(focused)}"]`)?.focus();
}

/** Enabled or not, with the reason; it stays focusable so that the reason can be read. */
export function setAllowed(button, why, tip) {
  button.setAttribute("aria-disabled", why ? "true" : "false");
  button.dataset.tip = why ? `${tip}\nNot now: ${why}` : tip;
}
