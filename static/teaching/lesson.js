// The lessons: asked for, taken as they arrive, and prepared for drawing.

import { opened } from "../offline/parcel.js";

/** The reason why a lesson cannot be made; its message is for the learner. */
export class LessonError extends Error {}

/**
 * Ask for a part (flattening, planning, alignment) with its parameters; aborting `signal` gives it up.
 * @param {string} part @param {Record<string, number>} query @param {AbortSignal} signal
 */
export async function fetchLesson(part, query, signal) {
  const asked = new URLSearchParams(/** @type {Record<string, any>} */ (query));
  const answer = await fetch(`teaching/${part}?${asked}`, { signal }).catch((error) => {
    if (signal.aborted) throw error;
    throw new LessonError("There is no connection to flatcloth; start it again and try once more.");
  });
  if (!answer.ok) throw new LessonError(await answer.text());
  return unpack(opened(new Uint8Array(await answer.arrayBuffer())));
}

/** @returns {Promise<Lesson>} */
async function unpack(/** @type {ReturnType<typeof opened>} */ { values, arrays, pictures }) {
  const bitmaps = Object.entries(pictures).map(async ([name, png]) => [name, await createImageBitmap(png)]);
  const picture = Object.fromEntries(await Promise.all(bitmaps));
  for (const level of values.levels ?? []) Object.assign(level, prepared(arrays, level.name));
  return { ...values, array: /** @type {Lesson["array"]} */ (arrays), picture };
}

/** One level's samples as drawn: places in the image, and the largest part's own numbering. */
function prepared(/** @type {Record<string, NumberArray>} */ array, /** @type {string} */ name) {
  const rc = array[`${name}_points_rc`];
  const xy = new Float32Array(rc.length);
  for (let i = 0; i < rc.length; i += 2) [xy[i], xy[i + 1]] = [rc[i + 1], rc[i]];
  const members = array[`${name}_members`];
  const local = new Int32Array(rc.length / 2).fill(-1);
  members.forEach((point, i) => (local[point] = i));
  const edges = array[`${name}_edges`];
  const main = [];
  const lengths = [];
  const length = array[`${name}_length_mm`];
  for (let e = 0; e < length.length; e++) {
    const a = local[edges[2 * e]];
    const b = local[edges[2 * e + 1]];
    if (a < 0 || b < 0) continue;
    main.push(a, b);
    lengths.push(length[e] / 1000);
  }
  return {
    xy,
    edges,
    unusedPairs: array[`${name}_unused`],
    members,
    mainEdges: Int32Array.from(main),
    mainLength: Float32Array.from(lengths),
    states: statesOf(/** @type {Float32Array} */ (array[`${name}_states`]), members.length),
    local,
  };
}

/** States of so many places each, which come one after the other. */
export function statesOf(/** @type {Float32Array} */ flat, /** @type {number} */ count) {
  const size = 2 * count;
  return Array.from({ length: size ? flat.length / size : 0 }, (_, i) => flat.subarray(i * size, (i + 1) * size));
}

/** The last of a list, which has one. @template T @param {T[]} list */
export const lastOf = (list) => list[list.length - 1];

/**
 * What is between recorded states at a time (0 to their number less one).
 * @template {Float32Array | number[]} T
 * @param {T[]} states @param {number} time
 */
export function between(states, time) {
  const last = states.length - 1;
  const from = Math.min(last, Math.floor(time));
  const [a, b] = [states[from], states[Math.min(last, from + 1)]];
  const at = (/** @type {number} */ x, /** @type {number} */ i) => x + (time - from) * (b[i] - x);
  return /** @type {T} */ (a instanceof Float32Array ? a.map(at) : a.map(at));
}

/** The iteration at a time; states are thinned, iterations are not. */
export function iterationAt(/** @type {Level} */ level, /** @type {number} */ time) {
  const at = level.state_iterations;
  const from = Math.min(at.length - 1, Math.floor(time));
  return at[from] + (time - from) * ((at[from + 1] ?? at[from]) - at[from]);
}

/** Relative error of length of every pair of the largest part: below 0 too short, above too long. */
export function strains(/** @type {Level} */ level, /** @type {Numbers} */ points) {
  const { mainEdges: edges, mainLength: length } = level;
  const strain = new Float32Array(length.length);
  for (let e = 0; e < length.length; e++) {
    const a = 2 * edges[2 * e];
    const b = 2 * edges[2 * e + 1];
    strain[e] = Math.hypot(points[a] - points[b], points[a + 1] - points[b + 1]) / length[e] - 1;
  }
  return strain;
}

/** H of Eq. (2), mm². */
export function energy(/** @type {Level} */ level, /** @type {Float32Array} */ strain) {
  return strain.reduce((total, s, e) => total + (1000 * s * level.mainLength[e]) ** 2, 0);
}
