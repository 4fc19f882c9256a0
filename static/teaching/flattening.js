// The stages of Fig. 2: one view, from samples to the flattened view.

import { cm2, mm, number, count, hex, rgbOf } from "../page/format.js";
import { boxOf, pixelAt, boxOfPoints, union } from "../canvas/geometry.js";
import { imageBox, middleOf, onImage, shareOf, withDetail } from "./detail.js";
import { columns, rows } from "./draw.js";
import { lastOf, strains, between, energy, iterationAt } from "./lesson.js";
import { within } from "../page/dom.js";
import { Plot } from "./plot.js";

// --- samples and pairs on the image ----------------------------------------------------------------

const dotSize = (/** @type {number} */ size) => (size === 1 ? 1.7 : 4);

/** Where the detail is first: in the middle of the unused pairs, so that a reason to look is seen. @returns {UV} */
function detailStart(/** @type {Lessons} */ { flattening }) {
  const level = flattening.levels[0];
  const { xy, unusedPairs } = level;
  const middles = /** @type {UV[]} */ ([]);
  for (let e = 0; e < unusedPairs.length; e += 2) {
    const [a, b] = [2 * unusedPairs[e], 2 * unusedPairs[e + 1]];
    middles.push([(xy[a] + xy[b]) / 2, (xy[a + 1] + xy[b + 1]) / 2]);
  }
  if (!middles.length) for (let i = 0; i < xy.length; i += 2) middles.push([xy[i], xy[i + 1]]);
  middles.sort((p, q) => p[1] - q[1]);
  return middles[Math.floor(middles.length / 2)] ?? [0, 0];
}

/** The level that is minimised at a time, and the time in it: the coarse one, then the fine one. @returns {[Level, number]} */
function levelAt(/** @type {FlatteningLesson} */ { levels }, /** @type {number} */ time) {
  const [coarse] = levels;
  const first = coarse.states.length;
  return time < first || levels.length < 2 ? [coarse, Math.min(time, first - 1)] : [lastOf(levels), time - first];
}

// --- the flattened view ----------------------------------------------------------------------------

/** The pixel of the flattened view under the probe: its index, or -1. */
function probed(/** @type {FlatteningLesson} */ lesson, /** @type {Ui} */ ui) {
  const at = pixelAt(lesson.flat, ...ui.at);
  return at < 0 || lesson.array.source_rc[2 * at] < 0 ? -1 : at;
}

// --- the stages ------------------------------------------------------------------------------------

/** @type {Record<string, StageCode>} */
export const FLATTENING_STAGES = {
  sampling: {
    probe: "image",
    start: detailStart,
    facts: ({ flattening: f }) => [
      ["Samples", String(f.levels[0].points)],
      [
        "d on the cloth",
        `${number(f.levels[0].interval_px, 0)} px ≈ ${mm(f.levels[0].interval_px * f.pixel_pitch_mm, 0)}`,
      ],
      ["Cloth in the image", `${number(f.surface_px, 0)} px`],
      ["Distance", mm(f.depth_mm, 0)],
    ],
    draw(sheet, rect, { flattening: lesson }, ui) {
      onImage(sheet, rect, lesson, ui, (map, size) =>
        sheet.dots(map, lesson.levels[0].xy, dotSize(size), sheet.color.sample),
      );
    },
  },
  pairs: {
    probe: "image",
    start: detailStart,
    facts: ({ flattening: f }) => [
      ["Pairs used", String(f.levels[0].pairs)],
      ["Not used", String(f.levels[0].unused)],
      ["Mean length E", f.levels[0].mean_length_mm === null ? "–" : mm(f.levels[0].mean_length_mm)],
      ["Connected", partsNote(f.levels[0])],
    ],
    draw(sheet, rect, { flattening: lesson }, ui) {
      const level = lesson.levels[0];
      onImage(sheet, rect, lesson, ui, (map, size) => {
        sheet.segments(map, level.xy, level.edges, sheet.color.pair, size === 1 ? 1 : 2.2);
        sheet.segments(map, level.xy, level.unusedPairs, sheet.color.unused, size === 1 ? 1 : 2.2);
        sheet.dots(map, level.xy, dotSize(size), sheet.color.point);
      });
    },
  },
  initial_state: {
    facts: ({ flattening: f }) => {
      const level = f.levels[0];
      const strain = strains(level, level.states[0]);
      const short = strain.filter((s) => s < -0.01).length / Math.max(1, strain.length);
      return [
        ["H", `${threeDigits(level.energy_mm2[0])} mm²`],
        ["Error of a pair (rms)", mm(rms(level, level.energy_mm2[0]), 2)],
        ["Too short by 1 % or more", `${number(100 * short, 0)} %`],
        ["Connected", partsNote(level)],
      ];
    },
    draw(sheet, rect, { flattening: lesson }) {
      const [left, right] = columns(rect, [planeShare, 1 - planeShare]);
      const plane = sheet.titled(left, "The plane", "every sample at its pixel");
      const { strain } = statePane(sheet, plane, lesson.levels[0], 0, "coarse");
      histogram(sheet, sheet.titled(right, "Lengths"), strain, 25);
    },
  },
  minimisation: {
    plays: ({ flattening: f }) => f.levels.reduce((sum, level) => sum + level.states.length, 0) - 1,
    facts: ({ flattening: f }, ui) => minimisationFacts(...levelAt(f, ui.time)),
    draw: (sheet, rect, { flattening: f }, ui) => drawMinimisation(sheet, rect, ...levelAt(f, ui.time)),
  },
  triangulation: {
    probe: "mesh",
    start: ({ flattening: f }) => {
      const box = boxOfPoints(lastOf(lastOf(f.levels).states));
      return [(box.left + box.right) / 2, box.top + 0.3 * (box.bottom - box.top)];
    },
    facts: ({ flattening: f }) => [
      ["Triangles", String(f.triangles)],
      ["Samples", String(lastOf(f.levels).main_points)],
      ["Area", cm2(f.area_cm2)],
    ],
    draw(sheet, rect, { flattening: lesson }, ui) {
      const level = lastOf(lesson.levels);
      const points = lastOf(level.states);
      const sides = trianglePairs(lesson, level);
      withDetail(sheet, rect, "mesh", "The plane", boxOfPoints(points), ui, (map, size) => {
        fillTriangles(sheet, map, points, lesson, level);
        sheet.segments(map, points, sides, sheet.color.accent, size === 1 ? 0.6 : 1.4);
        if (size > 1) sheet.dots(map, points, 2.6, sheet.color.text);
        sheet.scaleBar(map);
      });
    },
  },
  flattened_view: {
    probe: "flat",
    start: ({ flattening: f }) => middleOf(f.flat, (i) => f.array.source_rc[2 * i] >= 0),
    layers: { color: "Color", height: "Height z", normal: "Normal", truth: "Error" },
    facts({ flattening: lesson }, ui) {
      const at = probed(lesson, ui);
      /** @param {Numbers} array @param {number} scale @param {number} decimals */
      const three = (array, scale, decimals) =>
        at < 0 ? "–" : [0, 1, 2].map((i) => number(array[3 * at + i] * scale, decimals)).join(" ");
      const others = lesson.parts_cm2.slice(1);
      return [
        ["r, g, b", three(lesson.array.rgb, 1, 0)],
        ["x, y, z", at < 0 ? "–" : `${three(lesson.array.xyz_mm, 1, 0)} mm`],
        ["normal", three(lesson.array.normal_percent, 0.01, 2)],
        lesson.array.error_mm ? ["Error by the kit", `${mm(lesson.array.error_mm[at])}; purple: 20 mm`] : null,
        ["Area", cm2(lesson.area_cm2)],
        ["Pixel of F", mm(1000 * lesson.flat.pixel_size_m)],
        others.length ? ["Other parts", others.map((x) => number(x, 0)).join(", ") + " cm²"] : null,
        lesson.folded_share > 0.03
          ? ["Folded", `${number(100 * lesson.folded_share, 0)} % lies on itself: not to be used`]
          : null,
      ];
    },
    draw(sheet, rect, { flattening: lesson }, ui) {
      const image = lesson.picture.image;
      const share = shareOf(imageBox(image), rect, 0.25, 0.45);
      const [left, right] = columns(rect, [share, 1 - share]);
      const [title, flatTitle] = [`Image of view ${lesson.view_index}`, "Flattened view F(u, v)"];
      const from = sheet.image("image", image, imageBox(image), sheet.titled(left, title));
      const flat = lesson.picture[ui.layer ?? "color"];
      const onto = sheet.image("flat", flat, boxOf(lesson.flat), sheet.titled(right, flatTitle), { bar: true });
      const at = probed(lesson, ui);
      if (at < 0) return;
      const [line, col] = lesson.array.source_rc.subarray(2 * at, 2 * at + 2);
      const [a, b] = [from.at(col, line), onto.at(...ui.at)];
      sheet.line(a, b, sheet.color.mark, 1, [4, 4]);
      sheet.within(from.rect, () => sheet.cross(a, sheet.color.mark));
      sheet.within(onto.rect, () => sheet.cross(b, sheet.color.mark));
    },
  },
};

// --- States of the minimisation ----------------------------------------------------------------

const STRAIN_SPAN = 0.2; // relative errors beyond have the last color
const CLASSES = 9;
const BARS = 24;

export const threeDigits = (/** @type {number} */ value) => number(value, value >= 100 ? 0 : value >= 10 ? 1 : 2);

function strainColor(/** @type {Sheet} */ sheet, /** @type {number} */ strain) {
  const share = within(strain / STRAIN_SPAN, -1, 1);
  const even = rgbOf(sheet.color.even);
  const end = rgbOf(share < 0 ? sheet.color.short : sheet.color.long);
  return hex(even.map((c, i) => Math.round(c + Math.abs(share) * (end[i] - c))));
}

/**
 * @param {Sheet} sheet @param {PaneMap} map @param {Level} level @param {Numbers} points
 * @param {Float32Array} strain
 */
function drawPairsByStrain(sheet, map, level, points, strain) {
  const width = within((0.12 * level.interval_px * map.scaleX) / 1000, 1, 2.4);
  for (let c = 0; c < CLASSES; c++) {
    const low = c === 0 ? -Infinity : STRAIN_SPAN * ((2 * c) / CLASSES - 1);
    const high = c === CLASSES - 1 ? Infinity : STRAIN_SPAN * ((2 * (c + 1)) / CLASSES - 1);
    const color = strainColor(sheet, STRAIN_SPAN * ((2 * c + 1) / CLASSES - 1));
    sheet.segments(map, points, level.mainEdges, color, width, (e) => strain[e] >= low && strain[e] < high);
  }
}

/** @param {Sheet} sheet @param {Rect} rect @param {Float32Array} strain */
export function histogram(sheet, rect, strain, most = 60) {
  const span = 1.25 * STRAIN_SPAN;
  const edges = Array.from({ length: BARS + 1 }, (_, i) => 100 * span * ((2 * i) / BARS - 1));
  const counts = new Array(BARS).fill(0);
  for (const s of strain) counts[within(Math.floor(((s / span + 1) / 2) * BARS), 0, BARS - 1)] += 1;
  const shares = counts.map((n) => (100 * n) / Math.max(1, strain.length));
  const plot = new Plot(sheet, rect, {
    x: [-100 * span, 100 * span],
    y: [0, most],
    xLabel: "error of length (%)",
    yLabel: "share of the pairs (%)",
  });
  plot.bars(edges, shares, (percent) => strainColor(sheet, percent / 100));
  plot.vertical(0, sheet.color.soft, "", 1, [3, 3]);
}

/** @param {Sheet} sheet @param {Rect} rect @param {Level} level @param {number} time @param {number} now */
function energyPlot(sheet, rect, level, time, now) {
  const all = level.energy_mm2;
  const low = 10 ** Math.floor(Math.log10(Math.max(1e-3, Math.min(...all)) * 0.8));
  const high = 10 ** Math.ceil(Math.log10(Math.max(...all, 10 * low) * 1.2));
  const iterations = all.length - 1;
  const plot = new Plot(sheet, rect, {
    x: [0, Math.max(1, iterations)],
    y: [low, high],
    log: true,
    xLabel: "iteration",
    yLabel: "H (mm²)",
  });
  const xs = all.map((_, i) => i);
  plot.curve(xs, all, sheet.color.accent);
  for (const x of xs) sheet.ring(plot.at(x, all[x]), 2, sheet.color.accent, 2);
  sheet.ring(plot.at(iterationAt(level, time), now), 6, sheet.color.mark, 3);
}

/** @param {Sheet} sheet @param {Rect} rect @param {Level} level @param {number} time @param {string} key */
export function statePane(sheet, rect, level, time, key) {
  // All states in one frame, so that nothing jumps while they are played.
  const box = union(boxOfPoints(level.states[0]), boxOfPoints(lastOf(level.states)));
  const points = between(level.states, time);
  const strain = strains(level, points);
  sheet.show(key, box, rect, { margin: 10, bar: true }, (map) => {
    drawPairsByStrain(sheet, map, level, points, strain);
    const radius = within((0.14 * level.interval_px * map.scaleX) / 1000, 0.6, 2.6);
    sheet.dots(map, points, radius, sheet.color.text);
  });
  return { strain, now: energy(level, strain) };
}

/** @param {Level} level @param {number} h */
export const rms = (level, h) => Math.sqrt(h / Math.max(1, level.mainLength.length));
export const planeShare = 0.46;

/** @param {Sheet} sheet @param {Rect} rect @param {Level} level @param {number} time */
export function drawMinimisation(sheet, rect, level, time) {
  const [left, right] = columns(rect, [planeShare, 1 - planeShare]);
  const name = `${level.name} samples, iteration ${number(iterationAt(level, time), 0)}`;
  const { strain, now } = statePane(sheet, sheet.titled(left, "The plane", name), level, time, level.name);
  const [top, bottom] = rows(right, [1.1, 1]);
  energyPlot(sheet, sheet.titled(top, "Energy"), level, time, now);
  histogram(sheet, sheet.titled(bottom, "Lengths"), strain);
}

/** @returns {Fact[]} */
export function minimisationFacts(/** @type {Level} */ level, /** @type {number} */ time) {
  const now = energy(level, strains(level, between(level.states, time)));
  const [first, last] = [level.energy_mm2[0], lastOf(level.energy_mm2)];
  return [
    ["Samples", `${level.points}, ${level.name}`],
    ["Iteration", `${number(iterationAt(level, time), 0)} of ${level.energy_mm2.length - 1}`],
    ["H now", `${threeDigits(now)} mm²`],
    ["H, first to last", `${threeDigits(first)} → ${threeDigits(last)} mm²`],
    ["Error of a pair (rms)", mm(rms(level, now), 2)],
  ];
}

export const partsNote = (/** @type {Level} */ level) =>
  level.parts > 1 ? `${count(level.parts, "part")}; the largest is shown` : "1 part";

export function trianglePairs(/** @type {Lesson} */ lesson, /** @type {Level} */ level) {
  const triangles = lesson.array.triangles;
  const pairs = new Int32Array(2 * triangles.length);
  for (let i = 0; i < triangles.length; i += 3) {
    const [a, b, c] = [0, 1, 2].map((k) => level.local[triangles[i + k]]);
    pairs.set([a, b, b, c, c, a], 2 * i);
  }
  return pairs;
}

/** @param {Sheet} sheet @param {PaneMap} map @param {Numbers} points @param {Lesson} lesson @param {Level} level */
export function fillTriangles(sheet, map, points, lesson, level) {
  const context = sheet.context;
  const triangles = lesson.array.triangles;
  context.beginPath();
  for (let i = 0; i < triangles.length; i += 3) {
    for (let k = 0; k < 3; k++) {
      const p = 2 * level.local[triangles[i + k]];
      const place = map.at(points[p], points[p + 1]);
      if (k === 0) context.moveTo(...place);
      else context.lineTo(...place);
    }
    context.closePath();
  }
  context.save();
  context.globalAlpha = 0.14;
  context.fillStyle = sheet.color.accent;
  context.fill();
  context.restore();
}
