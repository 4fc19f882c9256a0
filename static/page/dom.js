// Small tools to build the page. Text always goes in as text, never as HTML.

/**
 * The element of the page with an id.
 *
 * @template {string} Id
 * @param {Id} id
 * @returns {Id extends keyof Ids ? Ids[Id] : HTMLElement}
 */
export const byId = (id) => /** @type {any} */ (document.getElementById(id));

/** The button of an action. @returns {HTMLElement} */
export const buttonOf = (/** @type {string} */ action) =>
  /** @type {any} */ (document.querySelector(`[data-action="${action}"]`));

/** Show by its outline, too, that an element has the focus. @param {Element | null | undefined} element */
export const focusOn = (element) => /** @type {any} */ (element)?.focus({ focusVisible: true });

/** The element that an event came from. */
export const targetOf = (/** @type {Event} */ event) => /** @type {HTMLElement} */ (event.target);

/**
 * Make an element of a tag with classes and id, as `make("button#close.small", { click: f }, "Close")`.
 *
 * Of the attributes functions are listeners, `key` names a control, `tip` is its tooltip, `label` its name for
 * screen readers, `pressed` whether it is on, `text` what is written in it, `data` more of data-*.
 *
 * @template {string} S
 * @param {S} selector
 * @param {...(Child | Attributes<S>)} parts attributes first, then nodes and texts
 * @returns {ElementOf<S>}
 */
export function make(selector, ...parts) {
  const [, tag, id, classes] = /** @type {string[]} */ (/^(\w+)(?:#([\w-]+))?(.*)$/.exec(selector));
  const element = /** @type {any} */ (document.createElement(tag));
  if (tag === "button") element.type = "button";
  if (id) element.id = id;
  if (classes) element.className = classes.replaceAll(".", " ").trim();
  const given = /** @type {Record<string, any>} */ (isAttributes(parts[0]) ? parts.shift() : {});
  for (const [name, value] of Object.entries(given)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (name === "pressed") element.setAttribute("aria-pressed", String(value));
    else if (value === null || value === undefined || value === false) continue;
    else if (name === "on") for (const [type, f] of Object.entries(value)) element.addEventListener(type, f);
    else if (name === "class") element.className = `${element.className} ${value}`.trim();
    else if (name === "data" || name === "style")
      Object.assign(name === "data" ? element.dataset : element.style, value);
    else if (name === "text") element.append(value);
    else element.setAttribute(SHORT[name] ?? name, value === true ? "" : value);
  }
  element.append(...nodesOf(/** @type {Child[]} */ (parts)));
  return element;
}

/** @type {Record<string, string>} */
const SHORT = { key: "data-id", tip: "data-tip", label: "aria-label" };

const isAttributes = (/** @type {unknown} */ part) => part?.constructor === Object;

/** Nodes and texts of nested lists; what is null, false, 0 or empty is left out. */
const nodesOf = (/** @type {Child[]} */ children) => /** @type {any[]} */ (children).flat(Infinity).filter(Boolean);

/** The button that closes a part of the page, or removes a thing from it. */
export const closeButton = (/** @type {string} */ label, /** @type {() => unknown} */ click, more = {}) =>
  make("button.close", { label, click, ...more }, "×");

/** A control with its name before it. */
export const field = (/** @type {string} */ name, /** @type {Child} */ control, /** @type {string?} */ tip = null) =>
  make("label.field", { tip }, make("span", name), control);

/** A square that shows a colour. */
export const swatch = (/** @type {string} */ color) => make("i.swatch", { style: { background: color } });

/** A name and its value for a list of values (dl). */
export const valueRow = (
  /** @type {string} */ name,
  /** @type {string} */ text,
  /** @type {string?} */ tip = null,
) => [make("dt", { tip }, name), make("dd", text)];

/** How a canvas is drawn on, which every browser can. */
export const contextOf = (/** @type {HTMLCanvasElement | OffscreenCanvas} */ canvas) =>
  /** @type {Context} */ (canvas.getContext("2d"));

/** Set text only if it has changed, so that screen readers do not repeat it. */
export function setText(/** @type {Element} */ element, /** @type {string} */ text) {
  if (element.textContent !== text) element.textContent = text;
}

/**
 * Rebuild a container only if what it shows has changed; keeps the focus on the same control.
 * @param {HTMLElement} container @param {unknown} key @param {() => Child} build
 */
export function rebuild(container, key, build) {
  const text = JSON.stringify(key);
  if (container.dataset.key === text) return;
  const active = /** @type {HTMLElement | null} */ (document.activeElement);
  const focused = container.contains(active) ? active?.dataset.id : undefined;
  container.dataset.key = text;
  container.replaceChildren(...nodesOf([build()]));
  const same = focused && container.querySelector(`[data-id="${CSS.escape(focused)}"]`);
  if (same) /** @type {HTMLElement} */ (same).focus();
}

/**
 * Enabled or not, with the reason; it stays focusable so that the reason can be read.
 * @param {HTMLElement} button @param {string | null} why @param {string} tip
 */
export function setAllowed(button, why, tip) {
  button.setAttribute("aria-disabled", why ? "true" : "false");
  button.dataset.tip = why ? `${tip}\nNot now: ${why}` : tip;
}
