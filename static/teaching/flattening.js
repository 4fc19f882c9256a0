// The stages of Fig. 2: one view, from samples to the flattened view.

import { cm2, mm, number } from "../page/format.js";
import { boxOf, pixelAt, boxOfPoints } from "../canvas/geometry.js";
import { imageBox, middleOf, onImage, shareOf, withDetail } from "./detail.js";
import { columns } from "./draw.js";
import { lastOf, strains } from "./lesson.js";
import {
  drawMinimisation,
  fillTriangles,
  histogram,
  minimisationFacts,
  partsNote,
  planeShare,
  rms,
  statePane,
  threeDigits,
  trianglePairs,
} from "./states.js";

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
