// Histograms that filter: a click on a bar keeps the results in it; a second bar extends the range.

import { make } from "../page/dom.js";

const BINS = 16;

/**
 * @typedef {object} Histogram
 * @property {Column} column
 * @property {(value: number) => number} binOf
 * @property {UV | null} range the chosen bins
 * @property {(shown: Row[]) => void} draw
 */

/** The range of some numbers, widened to round ends. */
function rangeOf(/** @type {number[]} */ values) {
  const low = Math.min(...values);
  const high = Math.max(...values);
  if (low === high) return [low - 0.5, high + 0.5];
  const step = 10 ** Math.floor(Math.log10((high - low) / 2));
  return [Math.floor(low / step) * step, Math.ceil(high / step) * step];
}

/** @param {Element} place @param {Column[]} columns @param {Row[]} rows @param {() => void} onChange */
export function makeHistograms(place, columns, rows, onChange) {
  const made = /** @type {Histogram[]} */ ([]);
  for (const column of columns) {
    const values = rows.map((row) => row[column.name]).filter((value) => typeof value === "number");
    if (values.length < 2) continue;
    const [low, high] = rangeOf(values);
    const width = (high - low) / BINS;
    const binOf = (/** @type {number} */ value) => Math.min(BINS - 1, Math.max(0, Math.floor((value - low) / width)));
    const said = make("span");
    const bars = Array.from({ length: BINS }, (_, n) => ({
      button: make("button", { click: () => press(n) }, make("i")),
      from: low + n * width,
      to: low + (n + 1) * width,
    }));
    /** @type {Histogram} */
    const one = { column, binOf, range: null, draw };
    const press = (/** @type {number} */ n) => {
      const [first, last] = one.range ?? [-1, -1];
      if (!one.range || first !== last) one.range = [n, n];
      else one.range = first === n ? null : [Math.min(n, first), Math.max(n, first)];
      onChange();
    };
    function draw(/** @type {Row[]} */ shown) {
      const counts = new Array(BINS).fill(0);
      for (const { [column.name]: value } of shown) if (typeof value === "number") counts[binOf(value)] += 1;
      const most = Math.max(1, ...counts);
      bars.forEach(({ button, from, to }, n) => {
        /** @type {HTMLElement} */ (button.firstChild).style.height = counts[n]
          ? `${Math.max(4, (100 * counts[n]) / most)}%`
          : "0";
        const words = `${column.format?.(from)} to ${column.format?.(to)}: ${counts[n]}`;
        button.title = words;
        button.setAttribute("aria-label", `${column.title} ${words}`);
        button.setAttribute("aria-pressed", String(Boolean(one.range && n >= one.range[0] && n <= one.range[1])));
      });
      said.textContent = one.range
        ? `${column.format?.(bars[one.range[0]].from)} to ${column.format?.(bars[one.range[1]].to)}`
        : "";
    }
    place.append(
      make(
        "section.histogram",
        { label: `${column.title}: histogram and filter` },
        make("h2", column.title, said),
        make("div.bins", { role: "group", label: `Ranges of ${column.title}` }, ...bars.map(({ button }) => button)),
        make("div.ends", make("span", column.format?.(low)), make("span", column.format?.(high))),
      ),
    );
    made.push(one);
  }
  return {
    /** Whether a row is within all chosen ranges, but that of one column. */
    keeps: (/** @type {Row} */ row, /** @type {string | null} */ except = null) =>
      made.every(({ column, binOf, range }) => {
        if (!range || column.name === except) return true;
        const value = row[column.name];
        return typeof value === "number" && binOf(value) >= range[0] && binOf(value) <= range[1];
      }),
    draw: (/** @type {(name: string) => Row[]} */ shownWithout) =>
      made.forEach((one) => one.draw(shownWithout(one.column.name))),
    clear: () => made.forEach((one) => (one.range = null)),
  };
}
