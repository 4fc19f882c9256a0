// The lessons: asked for, and prepared for drawing.

import { opened } from "../offline/parcel.js";

/**
 * Ask for a part (flattening, planning, ...) with its parameters; aborting `signal` gives it up.
 * @param {string} part @param {Record<string, any>} query @param {AbortSignal} signal
 * @returns {Promise<{ lesson: any; error: string | null }>} or why there is none, in words for the learner
 */
export async function fetchLesson(part, query, signal) {
  const answer = await fetch(`teaching/${part}?${new URLSearchParams(query)}`, { signal }).catch(() => null);
  const lost = "There is no connection to flatcloth; start it again and try once more.";
  if (!answer?.ok) return { lesson: null, error: answer ? await answer.text() : lost };
  const { values, arrays: array, pictures } = opened(new Uint8Array(await answer.arrayBuffer()));
  const bitmaps = Object.entries(pictures).map(async ([name, png]) => [name, await createImageBitmap(png)]);
  return { lesson: { ...values, array, picture: Object.fromEntries(await Promise.all(bitmaps)) }, error: null };
}

/** Parts of so many numbers each, which come one after the other. */
export const partsOf = (/** @type {Float32Array} */ flat, /** @type {number} */ size) =>
  Array.from({ length: size ? flat.length / size : 0 }, (_, i) => flat.subarray(i * size, (i + 1) * size));

/** The last of a list, which has one. @template T @param {ArrayLike<T>} list */
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
