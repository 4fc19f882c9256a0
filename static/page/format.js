// Numbers as people read them, with units; a true minus sign and fixed decimals keep columns still.

export function number(/** @type {number | null | undefined} */ value, decimals = 1) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = value.toFixed(decimals);
  return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "\u2212");
}

export const vector = (/** @type {(number | null)[]} */ values, decimals = 1, scale = 1) =>
  values.map((x) => number(x === null ? null : x * scale, decimals)).join(" ");

export const degrees = (/** @type {number | null | undefined} */ value, decimals = 1) =>
  value === null || value === undefined ? "–" : `${number(value, decimals)}°`;

export const mm = (/** @type {number | null | undefined} */ value, decimals = 1) => `${number(value, decimals)} mm`;

export const cm2 = (/** @type {number | null | undefined} */ value) => `${number(value, 0)} cm²`;

/** A share; what is nearly none or all is not called so. */
export const percent = (/** @type {number} */ share) =>
  share > 0.995 ? "> 99 %" : share < 0.005 && share > 0 ? "< 1 %" : `${number(100 * share, 0)} %`;

export const count = (/** @type {number} */ n, /** @type {string} */ word) => `${n} ${word}${n === 1 ? "" : "s"}`;

export const keyName = (/** @type {string} */ key) =>
  ({ Escape: "Esc", Space: "Space", ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓" })[key] ??
  (key.length === 1 ? [key] : key.replace("Shift+", "⇧").split("+"))
    .map((part) => (part.length === 1 || part.startsWith("⇧") ? part.toUpperCase() : part))
    .join("+");

/** What an action does, and its keys. */
export const tipOf = (/** @type {{ description: string; keys: string[] }} */ { description, keys }) =>
  `${description}\nKey: ${keys.slice(0, 2).map(keyName).join(" or ")}`;

/** Of a colour as #rrggbb. */
export const rgbOf = (/** @type {string} */ color) => [1, 3, 5].map((i) => parseInt(color.slice(i, i + 2), 16));

/** The longest of 1, 2, 5 times a power of ten (mm) that is at most `limit_mm`. */
export function niceLength(/** @type {number} */ limitMm) {
  const power = 10 ** Math.floor(Math.log10(limitMm));
  return power * ([5, 2].find((factor) => factor * power <= limitMm) ?? 1);
}

export const length = (/** @type {number} */ mm) =>
  mm >= 1000 ? `${mm / 1000} m` : `${Number(mm.toPrecision(1))} mm`;

/** The pieces that nothing connects to the shape yet, and their area. */
export function floatingOf(/** @type {{ pieces: Piece[] }} */ layers) {
  const pieces = layers.pieces.filter((piece) => !piece.placed);
  return { pieces, area_cm2: pieces.reduce((sum, piece) => sum + piece.area_cm2, 0) };
}

const MUCH_FLOATS = 0.1; // of all cloth: from here on an end is no success

/** The end of an integration in a word, or that much cloth still floats. */
export function endOf(/** @type {State} */ { layers }) {
  const floating = layers ? floatingOf(layers).area_cm2 : 0;
  const share = floating / Math.max(1, floating + (layers?.area_cm2 ?? 0));
  return share < MUCH_FLOATS ? "Finished" : `Ended, but ${percent(share)} of the cloth floats`;
}
