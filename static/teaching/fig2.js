// The stages of Fig. 2: one view, from samples to the flattened view.

import { cm2, mm, number } from "/static/page/format.js";
import { boxOf, pixelAt } from "/static/canvas/geometry.js";
import { imageBox, middleOf, onImage, shareOf, withDetail } from "/static/teaching/detail.js";
import { boxOfPoints, columns, rows } from "/static/teaching/draw.js";
import { lastOf, stagesOf, strains } from "/static/teaching/lesson.js";
import { equation, root, row, sub, sum, sup, words } from "/static/teaching/math.js";
import {
  drawForeshortening,
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
} from "/static/teaching/states.js";

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

// --- the flattened view ----------------------------------------------------------------------------

/** The pixel of the flattened view under the probe: its index, or -1. */
function probed(/** @type {FlatteningLesson} */ lesson, /** @type {Ui} */ ui) {
  const at = pixelAt(lesson.flat, ...ui.at);
  return at < 0 || lesson.array.source_rc[2 * at] < 0 ? -1 : at;
}

const FLAT_LAYERS = { color: "Color", height: "Height z", normal: "Normal" };

/** @param {Sheet} sheet @param {Rect} rect @param {Lessons} parts @param {Ui} ui */
function drawFlattened(sheet, rect, { flattening: lesson }, ui) {
  const image = lesson.picture.image;
  const share = shareOf(imageBox(image), rect, 0.25, 0.45);
  const [left, right] = columns(rect, [share, 1 - share]);
  const titled = [
    sheet.titled(left, `Image of view ${lesson.view_index}`),
    sheet.titled(right, "Flattened view F(u, v)"),
  ];
  const draw = (/** @type {Drawable} */ picture, /** @type {Box} */ box) => (/** @type {PaneMap} */ map) =>
    sheet.picture(map, picture, box);
  const [imagesBox, flatBox] = [imageBox(image), boxOf(lesson.flat)];
  const from = sheet.show("image", imagesBox, titled[0], draw(image, imagesBox));
  const onto = sheet.show("flat", flatBox, titled[1], draw(lesson.picture[ui.layer ?? "color"], flatBox), {
    bar: true,
  });
  const at = probed(lesson, ui);
  if (at < 0) return;
  const [line, col] = lesson.array.source_rc.subarray(2 * at, 2 * at + 2);
  const [a, b] = [from.at(col, line), onto.at(...ui.at)];
  sheet.line(a, b, sheet.color.mark, 1, [4, 4]);
  sheet.within(from.rect, () => sheet.cross(a, sheet.color.mark));
  sheet.within(onto.rect, () => sheet.cross(b, sheet.color.mark));
}

/** @returns {Fact[]} */
function flattenedFacts(/** @type {Lessons} */ { flattening: lesson }, /** @type {Ui} */ ui) {
  const at = probed(lesson, ui);
  /** @param {Numbers} array @param {number} scale @param {number} decimals */
  const three = (array, scale, decimals) =>
    at < 0 ? "–" : [0, 1, 2].map((i) => number(array[3 * at + i] * scale, decimals)).join(" ");
  const others = lesson.parts_cm2.slice(1);
  /** @type {(Fact | null)[]} */
  const facts = [
    ["r, g, b", three(lesson.array.rgb, 1, 0)],
    ["x, y, z", at < 0 ? "–" : `${three(lesson.array.xyz_mm, 1, 0)} mm`],
    ["normal", three(lesson.array.normal_percent, 0.01, 2)],
    ["Area", cm2(lesson.area_cm2)],
    ["Pixel of F", mm(1000 * lesson.flat.pixel_size_m)],
    others.length ? ["Other parts", others.map((x) => number(x, 0)).join(", ") + " cm²"] : null,
    lesson.folded_share > 0.03
      ? ["Folded", `${number(100 * lesson.folded_share, 0)} % lies on itself: not to be used`]
      : null,
  ];
  return facts.filter((fact) => fact !== null);
}

// --- the stages ------------------------------------------------------------------------------------

const PAIR = "n_1 n_2";
const squared = (/** @type {string} */ name) => sup(row("(", sub(name, "n_1"), "−", sub(name, "n_2"), ")"), "2");

/** @param {Sheet} sheet @param {Rect} rect @param {Lessons} parts @param {Ui} ui */
function drawTriangles(sheet, rect, { flattening: lesson }, ui) {
  const level = lastOf(lesson.levels);
  const points = lastOf(level.states);
  const sides = trianglePairs(lesson, level);
  withDetail(sheet, rect, "mesh", "The plane", boxOfPoints(points), ui, (map, size) => {
    fillTriangles(sheet, map, points, lesson, level);
    sheet.segments(map, points, sides, sheet.color.accent, size === 1 ? 0.6 : 1.4);
    if (size > 1) sheet.dots(map, points, 2.6, sheet.color.text);
    sheet.scaleBar(map);
  });
}

const STRAINS = { short: "too short", even: "right", long: "too long" };

export const FLATTENING_STAGES = stagesOf(
  "flattening",
  ["sampling_interval_px"],
  [
    {
      name: "Sampling",
      figure: "Fig. 2b · section 3",
      probe: "image",
      start: detailStart,
      text: [
        "The camera gives a depth image D: behind every pixel there is a 3D point. Every d-th pixel of the " +
          "cloth, along rows and columns, becomes a sample.",
        "Few samples are solved quickly and safely; more of them follow at stage 5. Pull d: narrow strips of " +
          "cloth lose their samples first.",
      ],
      math: () => [equation("P_n = D(i_n, j_n)"), equation("i_n, j_n ∈ {½ d, 1½ d, 2½ d, …}")],
      facts: ({ flattening: f }) => [
        ["Samples", String(f.levels[0].points)],
        [
          "d on the cloth",
          `${number(f.levels[0].interval_px, 0)} px ≈ ${mm(f.levels[0].interval_px * f.pixel_pitch_mm, 0)}`,
        ],
        ["Cloth in the image", `${number(f.surface_px, 0)} px`],
        ["Distance", mm(f.depth_mm, 0)],
      ],
      legend: { sample: "sample" },
      /** @param {Sheet} sheet @param {Rect} rect @param {Lessons} parts @param {Ui} ui */
      draw(sheet, rect, { flattening: lesson }, ui) {
        onImage(sheet, rect, lesson, ui, (map, size) =>
          sheet.dots(map, lesson.levels[0].xy, dotSize(size), sheet.color.sample),
        );
      },
    },
    {
      name: "Pairs",
      figure: "Fig. 2c · section 3",
      probe: "image",
      start: detailStart,
      text: [
        "Each sample is paired with its eight neighbours if the straight way between them stays on the visible " +
          "cloth (B = 1).",
        "The way along the cloth keeps its length when the cloth is spread out. Between near samples it is about " +
          "the straight distance E, which is measured. A pair across a jump to another layer, or across a fold, " +
          "would be wrong: it is not used (B = 0).",
      ],
      math: () => [
        equation(
          sub("E", PAIR),
          "= |",
          sub("P", "n_1"),
          "−",
          sub("P", "n_2"),
          "|",
          words(" where "),
          sub("B", PAIR),
          "= 1",
        ),
      ],
      facts: ({ flattening: f }) => [
        ["Pairs used", String(f.levels[0].pairs)],
        ["Not used", String(f.levels[0].unused)],
        ["Mean length E", f.levels[0].mean_length_mm === null ? "–" : mm(f.levels[0].mean_length_mm)],
        ["Connected", partsNote(f.levels[0])],
      ],
      legend: { pair: "pair used", unused: "pair not used", point: "sample" },
      /** @param {Sheet} sheet @param {Rect} rect @param {Lessons} parts @param {Ui} ui */
      draw(sheet, rect, { flattening: lesson }, ui) {
        const level = lesson.levels[0];
        onImage(sheet, rect, lesson, ui, (map, size) => {
          sheet.segments(map, level.xy, level.edges, sheet.color.pair, size === 1 ? 1 : 2.2);
          sheet.segments(map, level.xy, level.unusedPairs, sheet.color.unused, size === 1 ? 1 : 2.2);
          sheet.dots(map, level.xy, dotSize(size), sheet.color.point);
        });
      },
    },
    {
      name: "Initial state",
      figure: "Fig. 2c · section 3",
      text: [
        "The minimisation must begin somewhere: each sample is put where its pixel is, scaled to metres.",
        "The camera sees slanted cloth foreshortened. So most pairs are too short on the plane; they have to be " +
          "pushed apart.",
      ],
      math: () => [equation("(u_n, v_n) = s(j_n, i_n)"), equation("s =", words("metres per pixel"))],
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
      legend: { ...STRAINS, text: "sample" },
      draw(/** @type {Sheet} */ sheet, /** @type {Rect} */ rect, /** @type {Lessons} */ { flattening: lesson }) {
        const [left, right] = columns(rect, [planeShare, 1 - planeShare]);
        const [top, bottom] = rows(right, [1.1, 1]);
        const { strain } = statePane(
          sheet,
          sheet.titled(left, "The plane", "every sample at its pixel"),
          lesson.levels[0],
          0,
          "coarse",
        );
        histogram(sheet, sheet.titled(top, "Lengths"), strain, 25);
        drawForeshortening(sheet, sheet.titled(bottom, "Why too short", "seen from above"));
      },
    },
    {
      name: "Minimisation",
      figure: "Fig. 2d · Eq. (2)",
      plays: ({ flattening: f }) => f.levels[0].states.length - 1,
      text: [
        "The samples move in the plane until each pair is as long as it is on the cloth. H adds up the squares " +
          "of all errors of length; every iteration lowers it.",
        "Most is won in the first steps. What is left is cloth that stretches, and noise of the camera.",
      ],
      math: () => [
        equation(
          "H =",
          sum("n_1 < n_2"),
          sub("B", PAIR),
          sup(row("(", sub("ℓ", PAIR), "−", sub("E", PAIR), ")"), "2"),
        ),
        equation(sub("ℓ", PAIR), "=", root(squared("u"), "+", squared("v"))),
      ],
      facts: ({ flattening: f }, ui) => minimisationFacts(f.levels[0], ui),
      legend: { ...STRAINS, mark: "now" },
      draw: (sheet, rect, { flattening: lesson }, ui) =>
        drawMinimisation(sheet, rect, lesson.levels[0], ui, "coarse"),
    },
    {
      name: "Finer level",
      figure: "Fig. 2e · section 3",
      plays: ({ flattening: f }) => lastOf(f.levels).states.length - 1,
      text: [
        "Now with samples at half the interval. The coarse result carries each of them to its place, and the " +
          "same minimisation goes on from there.",
        "From the pixels, so many unknowns would take long and might fold the sheet. From here, H begins low already.",
      ],
      math: () => [
        equation("d^′ = d / 2"),
        equation(sub("(u, v)", "n"), "=", words("as the result for d carries it")),
      ],
      facts: ({ flattening: f }, ui) => [
        ["Samples", `${lastOf(f.levels).points} (before ${f.levels[0].points})`],
        ...minimisationFacts(lastOf(f.levels), ui),
      ],
      legend: { ...STRAINS, mark: "now" },
      draw: (sheet, rect, { flattening: lesson }, ui) =>
        drawMinimisation(sheet, rect, lastOf(lesson.levels), ui, "fine"),
    },
    {
      name: "Triangulation",
      figure: "Fig. 2f · section 3",
      probe: "mesh",
      start: ({ flattening: f }) => {
        const box = boxOfPoints(lastOf(lastOf(f.levels).states));
        return [(box.left + box.right) / 2, box.top + 0.3 * (box.bottom - box.top)];
      },
      text: [
        "Delaunay triangles join the flattened samples and fill the cloth between them. Where no cloth was seen, " +
          "there is no triangle.",
        "A point inside a triangle is a weighted mean of the three corners; the same mean of their pixels " +
          "is its position in the image.",
      ],
      math: () => [equation("p = λ_1 p_1 + λ_2 p_2 + λ_3 p_3"), equation("λ_1 + λ_2 + λ_3 = 1")],
      facts: ({ flattening: f }) => [
        ["Triangles", String(f.triangles)],
        ["Samples", String(lastOf(f.levels).main_points)],
        ["Area", cm2(f.area_cm2)],
      ],
      legend: { accent: "triangle", text: "sample" },
      draw: drawTriangles,
    },
    {
      name: "Flattened view",
      figure: "Fig. 2g · section 3",
      probe: "flat",
      start: ({ flattening: f }) => middleOf(f.flat, (i) => f.array.source_rc[2 * i] >= 0),
      layers: FLAT_LAYERS,
      text: [
        "Every pixel of F takes nine values from the 3D point that it belongs to: color, position and normal.",
        "The link remains. Move the pointer over the flattened view, or the arrow keys on it, and see the same " +
          "cloth in the image: this is how a click on the flat shape becomes a grasp point.",
      ],
      math: () => [equation("F(u, v) = (r, g, b, x, y, z, n_x, n_y, n_z)")],
      facts: flattenedFacts,
      legend: { mark: "the same cloth" },
      draw: drawFlattened,
    },
  ],
);
