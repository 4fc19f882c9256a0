// Kinds with their probabilities, and dimensions, as lists.

import { words } from "./marks.js";
import { make, values } from "../page/dom.js";
import { mm as inMm, number, percent } from "../page/format.js";

const LEAST_SHOWN = 0.005; // of a probability

/** The kinds by probability, [[name, share], ...]. */
export function shares(/** @type {[string, number][]} */ probabilities) {
  return make(
    "ul.kinds",
    { label: "Kinds and their probabilities" },
    ...probabilities
      .filter(([, share]) => share >= LEAST_SHOWN)
      .map(([name, share]) => {
        const bar = make("meter", { min: 0, max: 1, value: share, "aria-hidden": "true" });
        return make("li", make("span", words(name)), bar, make("strong", percent(share)));
      }),
  );
}

/** @param {GarmentPoint} point */
const stateOf = (point) => (point.held ? "held by hand" : point.seen ? "seen" : "predicted");

/**
 * The button of a named point: its state as a sign and in words, its name, how well it is known.
 * @param {GarmentPoint} point @param {string} more @param {(name: string | null) => void} pointAt tells which one the
 *   pointer or the focus is at @param {Listeners} on
 */
export function pointButton(point, more, pointAt, on) {
  const state = stateOf(point);
  const [at, off] = [point.name, null].map((name) => () => pointAt(name));
  const pointing = { mouseenter: at, mouseleave: off, focus: at, blur: off };
  return make(
    "button.point",
    { key: `point-${point.name}`, tip: `${state}, known to ${inMm(point.std_mm, 0)}${more}`, ...pointing, on },
    make("i.sign", { "aria-hidden": "true" }, point.held ? "◆" : point.seen ? "●" : "○"),
    make("span", words(point.name), make("span.unseen", `, ${state}, `)),
    make("small", `± ${inMm(point.std_mm, 0)}`),
  );
}

/** @param {FoundGarment} found */
export const dimensions = (found) =>
  values(
    ...found.dimensions.map(({ name, mm, std_mm }) => {
      const text = `${number(mm, 0)} ± ${inMm(std_mm, 0)}`;
      return /** @type {ValueRow} */ ([words(name), text, "Measured flat; one standard deviation"]);
    }),
  );
