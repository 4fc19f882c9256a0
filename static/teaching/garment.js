// The stages of the garment: true edges, starts and fits, and the evidence of each kind.

import { boxOf, boxOfPoints } from "../canvas/geometry.js";
import { words as asWords } from "../garment/marks.js";
import { cm2, number, percent } from "../page/format.js";
import { columns } from "./draw.js";
import { between, lastOf, statesOf } from "./lesson.js";
import { Plot } from "./plot.js";

const TRUSTED = 0.6; // an edge that counts this much is drawn as well seen
const SHOWN_KINDS = 3;
const KIND_COLORS = ["mark", "kept", "new"];

const metres = (/** @type {number} */ value) => `${number(value, 2)} m`;

// --- what all of them show ---------------------------------------------------------------------------

const NONE = new Float32Array(0);

/**
 * The shape with its evidence, in a pane.
 * @param {Sheet} sheet @param {Rect} rect @param {GarmentLesson} lesson @param {Numbers} more
 * @param {(map: PaneMap) => void} draw
 */
function drawShape(sheet, rect, lesson, more, draw) {
  const { inside_uv: inside, edge_uv: edge } = lesson.array;
  const box = boxOfPoints(Float32Array.from([inside, edge, more].flatMap((uv) => Array.from(uv))));
  sheet.show("garment", box, rect, { margin: 18, bar: true }, (map) => {
    if (lesson.flat) sheet.picture(map, lesson.picture.shape, boxOf(lesson.flat), 0.4);
    else sheet.dots(map, inside, 1.4, sheet.color.line);
    draw(map);
  });
}

/**
 * The true edges that are trusted, and those that are less.
 * @param {Sheet} sheet @param {PaneMap} map @param {GarmentLesson} parts @param {number} radius
 */
function drawEdges(sheet, map, { array }, radius) {
  const { edge_uv: uv, edge_trust: trust } = array;
  const [well, less] = /** @type {number[][]} */ ([[], []]);
  for (let i = 0; i < trust.length; i++) (trust[i] >= TRUSTED ? well : less).push(uv[2 * i], uv[2 * i + 1]);
  sheet.dots(map, well, radius, sheet.color.pair);
  sheet.dots(map, less, radius, sheet.color.sample);
}

const shapeName = (/** @type {GarmentLesson} */ lesson) => (lesson.flat ? "The shape" : "An example");
const detailOf = (/** @type {GarmentLesson} */ lesson) => (lesson.flat ? "" : "no shape of two views yet");

// --- starts and fits ---------------------------------------------------------------------------------

/** The outlines at a time between the recorded steps, one a start. */
function outlinesAt(/** @type {GarmentLesson} */ { state_shape, array }, /** @type {number} */ time) {
  const [, starts, vertices] = state_shape;
  return statesOf(between(statesOf(array.states, starts * vertices), time), vertices);
}

const bestStart = (/** @type {GarmentLesson} */ { energy }) => lastOf(energy).indexOf(Math.min(...lastOf(energy)));

/** @param {Sheet} sheet @param {Rect} rect @param {GarmentLesson} lesson @param {number} time @param {number} best */
function drawEnergy(sheet, rect, lesson, time, best) {
  const all = lesson.energy.flat();
  const [low, high] = [Math.min(...all), Math.max(...all)];
  const steps = lesson.energy.map((_, i) => i);
  const plot = new Plot(sheet, rect, {
    x: [0, steps.length - 1],
    y: [Math.max(0.5, 0.8 * low), 1.2 * high],
    log: true,
    xLabel: "step",
    yLabel: "E",
  });
  lesson.energy[0].forEach((_, k) => {
    const values = lesson.energy.map((row) => row[k]);
    if (k !== best) plot.curve(steps, values, sheet.color.soft, { width: 1.2, dash: [5, 4] });
  });
  plot.curve(
    steps,
    lesson.energy.map((row) => row[best]),
    sheet.color.mark,
    { width: 2.5 },
  );
  plot.vertical(time, sheet.color.text, "", 1);
}

// --- evidence ----------------------------------------------------------------------------------------

/**
 * A bar a kind, with its probability and its evidence below the best.
 * @param {Sheet} sheet @param {Rect} rect @param {{ name: string; probability: number; below: number | null }[]} all
 * @param {string[]} colors names of those of the first
 */
export function drawBars(sheet, rect, all, colors) {
  const high = Math.min(rect.h / all.length, 3.6 * sheet.em);
  all.forEach(({ name, probability, below }, k) => {
    const y = rect.y + k * high;
    const color = sheet.color[colors[k]] ?? sheet.color.soft;
    sheet.text(asWords(name), rect.x, y + 1.1 * sheet.em, { weight: k ? 400 : 600 });
    sheet.text(percent(probability), rect.x + rect.w, y + 1.1 * sheet.em, { align: "right" });
    const at = y + 1.75 * sheet.em;
    sheet.line([rect.x, at], [rect.x + rect.w, at], sheet.color.line, 7);
    if (probability > 0.002) sheet.line([rect.x, at], [rect.x + rect.w * probability, at], color, 7);
    if (below !== null && below < 0)
      sheet.text(`log Z: ${number(below, 1)}`, rect.x, at + 1.05 * sheet.em, { color: sheet.color.soft, size: 0.8 });
  });
}

// --- the stages ----------------------------------------------------------------------------------------

/** @type {Record<string, StageCode>} */
export const GARMENT_STAGES = {
  true_edges: {
    facts: ({ garment: lesson }) => [
      ["True edges", metres(lesson.edges_m)],
      ["Not seen further", metres(lesson.unseen_m)],
      ["Mean trust t", lesson.trust === null ? "–" : number(lesson.trust, 2)],
      ["Cloth", cm2(lesson.area_cm2)],
    ],
    draw(sheet, rect, { garment: lesson }) {
      const inner = sheet.titled(rect, shapeName(lesson), detailOf(lesson));
      drawShape(sheet, inner, lesson, lesson.array.unseen_uv, (map) => {
        sheet.dots(map, lesson.array.unseen_uv, 1.8, sheet.color.even);
        const { edge_uv: uv, edge_normal: normal, edge_trust: trust } = lesson.array;
        const along = 9 * sheet.weight;
        for (let i = 0; i < uv.length; i += 8) {
          const [x, y] = map.at(uv[i], uv[i + 1]);
          const color = trust[i / 2] >= TRUSTED ? sheet.color.pair : sheet.color.sample;
          sheet.line([x, y], [x + along * normal[i], y + along * normal[i + 1]], color, 1);
        }
        drawEdges(sheet, map, lesson, 2.4);
      });
    },
  },
  starts_and_fits: {
    plays: ({ garment: lesson }) => lesson.energy.length - 1,
    facts({ garment: lesson }, ui) {
      const best = bestStart(lesson);
      const step = Math.round(ui.time);
      const [first, now, last] = [0, step, lesson.energy.length - 1].map((at) => lesson.energy[at][best]);
      return [
        ["Starts shown", String(lesson.state_shape[1])],
        ["Step", `${step} of ${lesson.energy.length - 1}; deviations times ${number(lesson.widened[step], 0)}`],
        ["E of the best, now", number(now, 1)],
        ["First to last", `${number(first, 1)} → ${number(last, 1)}`],
      ];
    },
    draw(sheet, rect, { garment: lesson }, ui) {
      const [left, right] = columns(rect, [1.7, 1]);
      const outlines = outlinesAt(lesson, ui.time);
      const best = bestStart(lesson);
      const inner = sheet.titled(left, shapeName(lesson), `starts: ${asWords(lesson.kinds[0].name)}`);
      drawShape(sheet, inner, lesson, lesson.array.states, (map) => {
        drawEdges(sheet, map, lesson, 1.8);
        outlines.forEach((uv, k) => k !== best && sheet.loop(map, uv, sheet.color.soft, 1.2, [5, 4]));
        sheet.loop(map, outlines[best], sheet.color.mark, 2.6);
      });
      drawEnergy(sheet, sheet.titled(right, "Energy E", "of each start, step by step"), lesson, ui.time, best);
    },
  },
  evidence: {
    values: ({ garment: lesson }) => ({ temperature: String(lesson.temperature) }),
    facts: ({ garment: lesson }) => [
      ["Likeliest", `${asWords(lesson.kinds[0].name)}, ${percent(lesson.kinds[0].probability)}`],
      ["Its parameters", String(lesson.kinds[0].parameters)],
      ["None of these", percent(lesson.none)],
      ["E per edge", `${number(lesson.misfit, 3)} (limit ${number(lesson.misfit_limit, 3)})`],
    ],
    draw(sheet, rect, { garment: lesson }) {
      const [left, right] = columns(rect, [1.4, 1]);
      const kinds = lesson.kinds.slice(0, SHOWN_KINDS);
      const outlines = kinds.map(({ name }) => lesson.array[`outline_${name}`]);
      const inner = sheet.titled(left, shapeName(lesson), "with three kinds");
      drawShape(sheet, inner, lesson, outlines[0] ?? NONE, (map) => {
        drawEdges(sheet, map, lesson, 1.8);
        for (let k = kinds.length - 1; k >= 0; k--)
          sheet.loop(map, outlines[k], sheet.color[KIND_COLORS[k]], k ? 1.8 : 2.8, k ? [6, 4] : []);
      });
      const all = [...lesson.kinds, { name: "none of these", probability: lesson.none, below: null }];
      drawBars(sheet, sheet.titled(right, "Probability", "by this shape alone"), all, KIND_COLORS);
    },
  },
};
