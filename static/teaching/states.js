// States of the minimisation: pairs colored by their error of length, energy, and shares of errors.

import { count, hex, mm, number, rgbOf } from "../page/format.js";
import { within } from "../page/dom.js";
import { union, boxOfPoints } from "../canvas/geometry.js";
import { columns, rows } from "./draw.js";
import { between, energy, iterationAt, lastOf, strains } from "./lesson.js";
import { Plot } from "./plot.js";

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
