// Where the part of a joint may lie: as it is, where garment or seams have a place for it, or anywhere else; and how
// it fits where it is moved to.

import { applied, boxOfPoints, unapplied } from "../canvas/geometry.js";
import { TITLES } from "../canvas/handles.js";
import { areaWhere } from "../canvas/overlap.js";
import { WAYS } from "../page/dom.js";
import { cm2, number, percent } from "../page/format.js";

const ASIDE_M = 0.08; // a part of which no other place is known is shown so far off
const STEP_M = 0.002; // at which gaps are looked for
const ACROSS_M = 0.004; // from the outline of a part to the cloth that is compared on either side
const SAME = 1e-6;
const LEAST = 0.005; // what is less probable is shown when it is asked for

/** @typedef {import("../page/messages").JointInfo} JointInfo */

export class JointOptions {
  constructor(/** @type {JointInfo} */ joint) {
    const ends = joint.ends_uv_m.flat();
    const mean = (/** @type {0 | 1} */ axis) => ends.reduce((sum, end) => sum + end[axis] / ends.length, 0);
    this.loops = joint.outline_uv_m;
    /** @type {UV} the middle of the joint, about which the part turns */
    this.pivot = [mean(0), mean(1)];
    /** @type {UV} from there to the farthest of the part */
    this.arm = [0, 0];
    for (const [u, v] of this.loops.flat()) {
      const [du, dv] = [u - this.pivot[0], v - this.pivot[1]];
      if (Math.hypot(du, dv) > Math.hypot(...this.arm)) this.arm = [du, dv];
    }
    const far = ASIDE_M / (Math.hypot(...this.arm) || 1);
    const [aside_u, aside_v] = [far * this.arm[0], far * this.arm[1]];
    const known = joint.places.reduce((sum, { probability }) => sum + probability, 0);
    this.all = [
      option("As it is", joint.probability, [0, 0, 0], "Keep it as it is", false),
      ...joint.places
        .toSorted((a, b) => b.probability - a.probability)
        .map(({ by, probability, shape_from_part: { theta_rad, u_m, v_m } }) =>
          option(TITLES[by].replace("b", "B"), probability, [theta_rad, u_m, v_m], "Place it there", true),
        ),
      { ...option("Elsewhere", 1 - joint.probability - known, [0, aside_u, aside_v], "Cut it off"), place: null },
    ];
  }

  /** Which of the places a motion of the part leads to; -1: none. */
  at(/** @type {Motion} */ motion) {
    return this.all.findIndex((each) => each.motion.every((x, n) => Math.abs(x - motion[n]) < SAME));
  }

  /** As the handles show them. */
  get ghosts() {
    const likely = this.all.filter(({ probability }) => probability >= LEAST);
    return likely.map(({ title, share, motion: [theta_rad, u_m, v_m] }) => {
      return { source: title, title: `${title} ${share}`, placement: { theta_rad, u_m, v_m }, at: this.arm };
    });
  }

  loopsAt(/** @type {Motion} */ by) {
    return this.loops.map((loop) => loop.map(([u, v]) => applied(by, u, v)));
  }

  /** The outlines at all places. */
  get everywhere() {
    return this.all.flatMap(({ motion }) => this.loopsAt(motion).flat());
  }
}

/**
 * @param {string} title @param {number} probability @param {Motion} motion @param {string} decide @param {boolean} cut
 * @returns {{ title: string; probability: number; share: string; motion: Motion; decide: string; cut: boolean;
 *   place: Motion | null }}
 */
const option = (title, probability, motion, decide, cut = true) => {
  const share = percent(Math.max(probability, 0));
  return { title, probability, share, motion, decide, cut, place: cut ? motion : null };
};

/**
 * How a part fits, moved by so much: what the pairs across its joint are off, the widest gap between their ends, and
 * how much of it lies on other cloth; `covers` tells where there is cloth, `colorAt` in which colour: then also by how
 * much that differs across the part's outline.
 * @param {JointInfo} joint @param {Motion} by @param {(u: number, v: number) => boolean} covers
 * @param {((u: number, v: number) => Numbers) | null} colorAt
 */
export function fitOf(joint, by, covers, colorAt) {
  const isPart = (/** @type {UV} */ [u, v]) => holds(joint, u, v) && covers(u, v);
  const isRest = (/** @type {number} */ u, /** @type {number} */ v) => covers(u, v) && !holds(joint, u, v);
  let gap = 0;
  for (const [own, [u, v]] of joint.ends_uv_m) {
    const [s, t] = applied(by, ...own);
    const steps = Math.ceil(Math.hypot(u - s, v - t) / STEP_M);
    let free = 0;
    for (let n = 1; n < steps; n++) {
      const [x, y] = [s + ((u - s) * n) / steps, t + ((v - t) * n) / steps];
      free += Number(!isRest(x, y) && !isPart(unapplied(by, x, y)));
    }
    gap = Math.max(gap, free * STEP_M);
  }
  const box = boxOfPoints(joint.outline_uv_m.flat(2));
  const overlap = cm2(areaWhere(box, (u, v) => isPart([u, v]) && isRest(...applied(by, u, v))));
  const texture = colorAt && textureOf(joint, by, isPart, isRest, colorAt);
  const apart = texture === null ? "" : `colours ${number((100 * texture) / 255, 0)} % apart, `;
  return `Pairs ${number(offOf(joint, by))} mm off, gap ${number(1000 * gap, 0)} mm, ${apart}${overlap} on other cloth`;
}

/**
 * Mean difference of the colours on both sides of a part's outline, where it meets other cloth; null: nowhere.
 * @param {JointInfo} joint @param {Motion} by @param {(uv: UV) => boolean} isPart
 * @param {(u: number, v: number) => boolean} isRest @param {(u: number, v: number) => Numbers} colorAt
 */
function textureOf({ outline_uv_m }, by, isPart, isRest, colorAt) {
  let [sum, n] = [0, 0];
  for (const [u, v] of outline_uv_m.flat())
    for (const [right, down] of Object.values(WAYS)) {
      const inner = /** @type {UV} */ ([u - ACROSS_M * right, v - ACROSS_M * down]);
      const outer = applied(by, u + ACROSS_M * right, v + ACROSS_M * down);
      if (!isPart(inner) || !isRest(...outer)) continue;
      const [own, other] = [colorAt(...inner), colorAt(...outer)];
      for (let i = 0; i < 3; i++) sum += Math.abs(own[i] - other[i]) / 3;
      n += 1;
    }
  return n ? sum / n : null;
}

/** Median of what the distances of pairs are off their lengths (mm). @param {JointInfo} joint @param {Motion} by */
function offOf({ ends_uv_m, length_m }, by) {
  const off = ends_uv_m.map(([own, [u, v]], n) => {
    const [s, t] = applied(by, ...own);
    return 1000 * Math.abs(Math.hypot(u - s, v - t) - length_m[n]);
  });
  return off.sort((a, b) => a - b)[off.length >> 1] ?? 0;
}

/** Whether the outlines of a part hold a place: an odd number of their edges is crossed on the way out. */
export function holds(/** @type {JointInfo} */ { outline_uv_m }, /** @type {number} */ u, /** @type {number} */ v) {
  let inside = false;
  for (const loop of outline_uv_m)
    loop.forEach(([u1, v1], n) => {
      const [u0, v0] = loop[(n + loop.length - 1) % loop.length];
      if (v0 > v !== v1 > v && u < u0 + ((v - v0) / (v1 - v0)) * (u1 - u0)) inside = !inside;
    });
  return inside;
}
