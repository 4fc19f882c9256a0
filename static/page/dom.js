// Small tools to build the page. Text always goes in as text, never as HTML.

/**
 * The element of the page with an id.
 *
 * @template {string} Id
 * @param {Id} id
 * @returns {Id extends keyof Ids ? Ids[Id] : HTMLElement}
 */
export const byId = (id) => /** @type {never} */ (document.getElementById(id));

/** The first element that a selector fits; for those that are there. */
export const find = (/** @type {string} */ selector, /** @type {ParentNode} */ root = document) =>
  /** @type {HTMLElement} */ (root.querySelector(selector));

/** All elements that a selector fits. */
export const findAll = (/** @type {string} */ selector, /** @type {ParentNode} */ root = document) =>
  /** @type {HTMLElement[]} */ ([...root.querySelectorAll(selector)]);

/** The button of an action. */
export const buttonOf = (/** @type {string} */ action) => find(`[data-action="${action}"]`);

/** Give the button of an action another title. @param {string} action @param {string} title */
export function setTitle(action, title) {
  const text = buttonOf(action).firstChild;
  if (text) text.textContent = title;
}

/** Show by its outline, too, that an element has the focus. */
export const focusOn = (/** @type {Element | null | undefined} */ element) =>
  /** @type {HTMLElement | null | undefined} */ (element)?.focus(
    /** @type {FocusOptions} */ ({ focusVisible: true }),
  );

/** The element that an event came from. */
export const targetOf = (/** @type {Event} */ event) => /** @type {HTMLElement} */ (event.target);

/** Whether an event that goes to another element stays within one. */
export const staysIn = (/** @type {Element} */ element, /** @type {FocusEvent | PointerEvent} */ event) =>
  element.contains(/** @type {Node | null} */ (event.relatedTarget));

/** Whether there is a keyboard: keys are not named where there is none. */
export const hasKeys = () => !matchMedia("(pointer: coarse)").matches;

/** Keep an event from the browser, and from what else listens to it. */
export function taken(/** @type {Event} */ event) {
  event.preventDefault();
  event.stopPropagation();
}

/** Whether a key was pressed without others, Shift excepted. */
export const isPlain = (/** @type {KeyboardEvent} */ event) => !event.ctrlKey && !event.altKey && !event.metaKey;

/** What the arrow keys mean: steps to the right and down. @type {Record<string, UV>} */
export const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export const within = (/** @type {number} */ value, /** @type {number} */ least, /** @type {number} */ most) =>
  Math.min(most, Math.max(least, value));

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
  const element = document.createElement(tag);
  if (tag === "button") element.setAttribute("type", "button");
  if (id) element.id = id;
  if (classes) element.className = classes.replaceAll(".", " ").trim();
  const given = /** @type {Record<string, unknown>} */ (isAttributes(parts[0]) ? parts.shift() : {});
  for (const [name, value] of Object.entries(given)) {
    if (typeof value === "function") element.addEventListener(name, /** @type {EventListener} */ (value));
    else if (name === "pressed") element.setAttribute("aria-pressed", String(value));
    else if (value === null || value === undefined || value === false) continue;
    else if (name === "on")
      for (const [type, f] of Object.entries(value)) element.addEventListener(type, /** @type {EventListener} */ (f));
    else if (name === "class") element.className = `${element.className} ${value}`.trim();
    else if (name === "data" || name === "style")
      Object.assign(name === "data" ? element.dataset : element.style, value);
    else if (name === "text") element.append(String(value));
    else element.setAttribute(SHORT[name] ?? name, value === true ? "" : String(value));
  }
  element.append(...nodesOf(/** @type {Child[]} */ (parts)));
  return /** @type {ElementOf<S>} */ (element);
}

/** @type {Record<string, string>} */
const SHORT = { key: "data-id", tip: "data-tip", label: "aria-label" };

const isAttributes = (/** @type {unknown} */ part) => part?.constructor === Object;

/** Nodes and texts of nested lists; what is null, false, 0 or empty is left out. @returns {(Node | string)[]} */
const nodesOf = (/** @type {Child[]} */ children) =>
  children.flatMap((child) => (Array.isArray(child) ? nodesOf(child) : child ? [child] : []));

/** A button with a text. @param {string} text @param {() => unknown} click @param {Attributes<"button">} more */
export const button = (text, click, more = {}) => make("button.button", { click, ...more }, text);

/** A small one. @param {string} text @param {() => unknown} click @param {Attributes<"button">} more */
export const smallButton = (text, click, more = {}) => make("button.button.small", { click, ...more }, text);

/**
 * The button that closes a part of the page, or removes a thing from it.
 * @param {string} label @param {() => unknown} click @param {Attributes<"button">} more
 */
export const closeButton = (label, click, more = {}) => make("button.close", { label, click, ...more }, "×");

/** Open a sheet; the key that opened it closes it, too. */
export function openSheet(/** @type {string} */ id, /** @type {string} */ key) {
  const sheet = /** @type {HTMLDialogElement} */ (byId(id));
  sheet.onkeydown = (event) => {
    if (event.repeat || event.key.toLowerCase() !== key) return;
    event.stopPropagation(); // the page would open it again
    event.preventDefault();
    sheet.close();
  };
  sheet.showModal();
}

/** A control with its name before it. */
export const field = (/** @type {string} */ name, /** @type {Child} */ control, /** @type {string?} */ tip = null) =>
  make("label.field", { tip }, make("span", name), control);

/**
 * A box for a number.
 * @param {{ low?: number | null; high?: number | null; step: number | null }} range @param {number | null} value
 * @param {Attributes<"input">} more
 */
export const numberBox = ({ low, high, step }, value, more) =>
  make("input", { type: "number", min: low, max: high, step, value, ...more });

/**
 * A choice among [value, words], of which one is chosen.
 * @param {(string | number)[][]} options @param {string | number | null} chosen @param {Attributes<"select">} more
 */
export const choice = (options, chosen, more) => make("select", more, ...optionsOf(options, chosen));

/** Its options alone. @param {(string | number)[][]} options @param {string | number | null} chosen */
export const optionsOf = (options, chosen) =>
  options.map(([value, words]) => make("option", { value, selected: value === chosen }, String(words)));

/** A box to tick. @param {boolean} checked @param {(on: boolean) => void} change @param {Attributes<"input">} more */
export const tickBox = (checked, change, more) =>
  make("input", { type: "checkbox", checked, change: (event) => change(event.target.checked), ...more });

/** Names and values as a list: [name, text, tooltip]; false is left out. @param {...ValueRow} rows */
export const values = (...rows) =>
  make("dl.values", ...rows.map((row) => row && [make("dt", { tip: row[2] }, row[0]), make("dd", row[1])]));

/** A title with what stands beside it. @param {string} title @param {...Child} more */
export const heading = (title, ...more) => make("div.heading", make("h2", title), ...more);

/** A square that shows a colour. */
export const swatch = (/** @type {string} */ color) => make("i.swatch", { style: { background: color } });

/** How a canvas is drawn on in 3D; null where the browser has no WebGL, or refuses it. */
export function graphicsOf(/** @type {HTMLCanvasElement} */ canvas) {
  try {
    return canvas.getContext("webgl2");
  } catch {
    return null;
  }
}

let withoutCard = /** @type {boolean | undefined} */ (undefined);

/**
 * Whether WebGL is drawn without a graphics card. Then pictures are painted by the processor directly: else the
 * browser compiles what draws them as for a card, for seconds in which the page stands still.
 */
export function isWithoutCard() {
  const gl = graphicsOf(document.createElement("canvas"));
  const named = gl?.getExtension("WEBGL_debug_renderer_info");
  return /swiftshader|llvmpipe|software|basic render/i.test(
    named ? gl?.getParameter(named.UNMASKED_RENDERER_WEBGL) : "",
  );
}

/** How a canvas is drawn on, which every browser can. */
export const contextOf = (
  /** @type {HTMLCanvasElement | OffscreenCanvas} */ canvas,
  settings = { willReadFrequently: (withoutCard ??= isWithoutCard()) },
) => /** @type {Context} */ (canvas.getContext("2d", settings));

/**
 * Give a canvas the size of its place, sharp on the screen at hand. Returns how it is drawn on, in CSS pixels.
 * @param {HTMLCanvasElement} canvas @param {number} width @param {number} height
 */
export function sized(canvas, width, height) {
  const ratio = devicePixelRatio;
  const [across, down] = [width, height].map((px) => Math.max(1, Math.round(px * ratio)));
  if (canvas.width !== across || canvas.height !== down) Object.assign(canvas, { width: across, height: down });
  const context = contextOf(canvas);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return context;
}

/** The wheel over an element, as a factor to zoom by. */
export const onWheel = (
  /** @type {HTMLElement} */ element,
  /** @type {(factor: number, event: WheelEvent) => void} */ zoom,
) =>
  element.addEventListener(
    "wheel",
    (event) => {
      const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
      zoom(Math.exp(-event.deltaY * lines * (event.ctrlKey ? 0.01 : 0.0016)), event);
    },
    { passive: false },
  );

/** Place an element above a thing, or below it, within the window. */
export function placeBeside(/** @type {HTMLElement} */ element, /** @type {DOMRect} */ at, below = false) {
  const box = element.getBoundingClientRect();
  const left = within(at.left + at.width / 2 - box.width / 2, 8, Math.max(8, innerWidth - box.width - 8));
  Object.assign(element.style, { left: `${left}px`, top: `${below ? at.bottom + 8 : at.top - box.height - 8}px` });
}

/** Set text only if it has changed, so that screen readers do not repeat it. */
export function setText(/** @type {Element} */ element, /** @type {string} */ text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Show words in an element, which is hidden without any. */
export function showWords(/** @type {HTMLElement} */ element, /** @type {string} */ text) {
  element.hidden = !text;
  setText(element, text);
}

/** Say of an element that it is the present one of its list, or that it is not. */
export function setCurrent(/** @type {Element} */ element, /** @type {boolean} */ on, word = "true") {
  if (on) element.setAttribute("aria-current", word);
  else element.removeAttribute("aria-current");
}

/** Say of a button that it is on or off. */
export const setPressed = (/** @type {Element | null} */ element, /** @type {boolean} */ on) =>
  element?.setAttribute("aria-pressed", String(on));

/**
 * Rebuild a container only if what it shows has changed; keeps the focus on the same control, and what is being typed.
 * @param {HTMLElement} container @param {unknown} key @param {() => Child} build
 */
export function rebuild(container, key, build) {
  const text = JSON.stringify(key);
  if (container.dataset.key === text) return;
  const active = /** @type {HTMLInputElement | null} */ (document.activeElement);
  const focused = container.contains(active) ? active?.dataset.id : undefined;
  const isTyped = active?.matches("[type=number], [type=text]") && active.value !== active.defaultValue;
  container.dataset.key = text;
  container.replaceChildren(...nodesOf([build()]));
  const next =
    focused && /** @type {HTMLInputElement | null} */ (find(`[data-id="${CSS.escape(focused)}"]`, container));
  if (!next) return;
  if (isTyped) next.value = active?.value ?? "";
  else next.select?.(); // as it is when one comes to it with the keyboard
  next.focus();
}

/**
 * Rebuild a section of the page, or a part of it; without a key there is nothing to show, and the section is hidden.
 * @param {string} id @param {unknown} key @param {() => Child} build
 */
export function section(id, key, build, part = id) {
  byId(id).hidden = !key;
  if (key) rebuild(byId(part), key, build);
}

/**
 * Enabled or not, with the reason; it stays focusable so that the reason can be read.
 * @param {HTMLElement} button @param {string | null} why @param {string} tip
 */
export function setAllowed(button, why, tip) {
  button.setAttribute("aria-disabled", why ? "true" : "false");
  button.dataset.tip = why ? `${tip}\nNot now: ${why}` : tip;
}
