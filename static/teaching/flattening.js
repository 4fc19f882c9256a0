// The stages of one view: what it is about, samples and pairs, the minimisation, the flattened view; and the start view.

import { boxOf, boxOfPoints, nearest, pixelAt, union } from "../canvas/geometry.js";
import { within } from "../page/dom.js";
import { cm2, degrees, mm, number, percent, rgbOf } from "../page/format.js";
import { columns, imageBox, Plot, rows, shareOf } from "./draw.js";
import { between, lastOf, partsOf } from "./lesson.js";

const DETAIL = 4; // how much larger the detail is drawn, at least
const STRAIN_SPAN = 0.2; // relative errors of length beyond have the last color
const CLASSES = 9;

/** A view as it is named everywhere: its number, and its angle. @param {Lesson} lesson @param {number} view */
export const viewName = (lesson, view) => `view ${view} (${degrees(lesson.angles_deg[view], 0)})`;

/** The index of the place of [x0, y0, x1, y1, ...] that is nearest. @param {Numbers} places @param {UV} at */
function nearestOf(places, [x, y]) {
  const placesOf = (/** @type {number} */ i) => [{ x: places[2 * i], y: places[2 * i + 1] }];
  return nearest(Array(places.length / 2).keys(), placesOf, { x, y }, Infinity) ?? 0;
}

/** The middles of groups of so many of the places [x0, y0, x1, y1, ...]. */
function middlesOf(/** @type {Numbers} */ places, /** @type {number[]} */ groups, /** @type {number} */ size) {
  const middles = new Float32Array((2 * groups.length) / size);
  groups.forEach((k, i) => {
    for (const axis of [0, 1]) middles[2 * Math.floor(i / size) + axis] += places[2 * k + axis] / size;
  });
  return middles;
}

/**
 * A part of a pane around a place, larger; its frame is drawn on the whole. Returns its pane.
 * @param {Sheet} sheet @param {Pane} whole @param {Box} box @param {Rect} rect @param {UV} at
 * @param {(pane: Pane) => void} draw
 */
function showDetail(sheet, whole, box, rect, at, draw) {
  const scale = Math.max(DETAIL * whole.scaling[0], rect.w / (box.right - box.left));
  const [across, down] = [rect.w / (2 * scale), rect.h / (2 * scale)];
  const x = within(at[0], box.left + across, box.right - across);
  const y = within(at[1], box.top + down, box.bottom - down);
  const part = { left: x - across, right: x + across, top: y - down, bottom: y + down };
  const [from, to] = [whole.at(part.left, part.top), whole.at(part.right, part.bottom)];
  sheet.clipped(whole.rect, () => sheet.frame({ ...from, w: to.x - from.x, h: to.y - from.y }, "--text"));
  return sheet.show("detail", part, rect, { margin: 0 }, draw);
}

/** @type {StageCode<FlatteningLesson>} */
const overview = {
  draw(sheet, rect, lesson) {
    const { image, color } = lesson.picture;
    const [left, right] = columns(rect, [1, 1]);
    sheet.image("image", image, imageBox(image), sheet.titled(left, "One of the views", "as the item hangs"));
    const inner = sheet.titled(right, "The same cloth, flat", "to grow by the others");
    sheet.image("flat", color, boxOf(lesson.flat), inner);
    return [
      ["Views", String(lesson.angles_deg.length)],
      ["The first one shows", cm2(lesson.area_cm2)],
      ["It is seen at", degrees(lesson.angles_deg[lesson.view_index], 0)],
    ];
  },
};

/** @type {StageCode<FlatteningLesson>} */
const samples = {
  probe: "image",
  /** At a pair that is not used, so that a reason to look is seen. */
  start({ array: { samples_xy: xy, unused_pairs: unused } }) {
    const k = unused[2 * Math.floor(unused.length / 4)] ?? 0;
    return [xy[2 * k], xy[2 * k + 1]];
  },
  draw(sheet, rect, lesson, { at }) {
    const { samples_xy: xy, pairs, unused_pairs: unused, length_mm: length } = lesson.array;
    const { image } = lesson.picture;
    const all = [...pairs, ...unused];
    const pointed = nearestOf(middlesOf(xy, all, 2), at);
    const draw = (/** @type {Pane} */ pane, size = 1) => {
      pane.picture(image, box, 0.5);
      pane.segments(xy, pairs, sheet.palette.pair, size);
      pane.segments(xy, unused, sheet.palette.unused, size);
      pane.segments(xy, all.slice(2 * pointed, 2 * pointed + 2), sheet.palette.mark, 3 * size);
      pane.dots(xy, 1.7 * size, sheet.palette.point);
    };
    const box = imageBox(image);
    const share = shareOf(box, rect);
    const [left, right] = columns(rect, [share, 1 - share]);
    const whole = sheet.show("image", box, sheet.titled(left, `View ${lesson.view_index}`), {}, draw);
    const inner = sheet.titled(right, "Detail", "move the pointer over the left");
    showDetail(sheet, whole, box, inner, at, (pane) => draw(pane, 2.2));
    const d = lesson.parameters.sampling_interval_px;
    return [
      ["Samples", String(xy.length / 2)],
      ["d on the cloth", `${number(d, 0)} px ≈ ${mm(d * lesson.pixel_pitch_mm, 0)}`],
      ["Pairs used", String(length.length)],
      ["Not used", String(unused.length / 2)],
      ["Pair at the pointer", pointed < length.length ? `E = ${mm(length[pointed])}` : "not used, B = 0"],
    ];
  },
};

// --- the minimisation ------------------------------------------------------------------------------

/** The courses of the minimisation: of the coarse samples, then of the fine ones. @returns {Course[]} */
const coursesOf = (/** @type {FlatteningLesson} */ { array }) =>
  ["0", "1"]
    .filter((n) => array[`states_${n}`])
    .map((n) => ({
      energy: array[`energy_mm2_${n}`],
      states: partsOf(array[`states_${n}`], array[`states_${n}`].length / array[`energy_mm2_${n}`].length),
      pairs: array[`state_pairs_${n}`],
      length: array[`state_length_${n}`],
    }));

/** Relative error of length of every pair: below 0 too short, above too long. */
const strainsOf = (/** @type {Course} */ { pairs, length }, /** @type {Numbers} */ uv) =>
  length.map((e, i) => {
    const [a, b] = [2 * pairs[2 * i], 2 * pairs[2 * i + 1]];
    return Math.hypot(uv[a] - uv[b], uv[a + 1] - uv[b + 1]) / e - 1;
  });

function strainColor(/** @type {Sheet} */ sheet, /** @type {number} */ strain) {
  const share = within(strain / STRAIN_SPAN, -1, 1);
  const end = rgbOf(share < 0 ? sheet.palette.short : sheet.palette.long);
  return `rgb(${rgbOf(sheet.palette.even).map((c, i) => Math.round(c + Math.abs(share) * (end[i] - c)))})`;
}

/** @param {Sheet} sheet @param {Rect} rect @param {Course} course @param {Float32Array} uv @param {Float32Array} strain */
function drawState(sheet, rect, { states, pairs }, uv, strain) {
  // All states in one frame, so that nothing jumps while they are played.
  const box = union(boxOfPoints(states[0]), boxOfPoints(lastOf(states)));
  sheet.show("plane", box, rect, { margin: 10, bar: true }, (pane) => {
    for (let c = 0; c < CLASSES; c++) {
      const [low, high] = [c, c + 1].map((n) => STRAIN_SPAN * ((2 * n) / CLASSES - 1));
      const color = strainColor(sheet, (low + high) / 2);
      const isIn = (/** @type {number} */ s) => (c === 0 || s >= low) && (c === CLASSES - 1 || s < high);
      pane.segments(uv, pairs, color, 1.4, (e) => isIn(strain[e]));
    }
    pane.dots(uv, 1.4, sheet.palette.text);
  });
}

/** @param {Sheet} sheet @param {Rect} rect @param {Course[]} courses @param {number} time @param {number} now */
function drawEnergy(sheet, rect, courses, time, now) {
  const log = (/** @type {number} */ h) => Math.log10(Math.max(h, 1e-3));
  const all = courses.flatMap(({ energy }) => [...energy].map(log));
  const [least, most] = [Math.floor(Math.min(...all) - 0.1), Math.ceil(Math.max(...all) + 0.1)];
  const labels = { log: true, xLabel: "iteration, coarse and then fine", yLabel: "H (mm²)" };
  const plot = new Plot(sheet, rect, [0, Math.max(1, all.length - 1)], [least, most], labels);
  plot.curve([...all.keys()], all, sheet.palette.accent);
  all.forEach((h, n) => plot.ring([n, h], 2, sheet.palette.accent, 2));
  plot.ring([time, log(now)], 6, sheet.palette.mark, 3);
}

/** @type {StageCode<FlatteningLesson>} */
const minimisation = {
  plays: (lesson) => coursesOf(lesson).reduce((sum, { energy }) => sum + energy.length, -1),
  draw(sheet, rect, lesson, { time }) {
    const courses = coursesOf(lesson);
    const isFine = time >= courses[0].energy.length;
    const course = courses[Number(isFine)];
    const own = isFine ? time - courses[0].energy.length : Math.min(time, course.energy.length - 1);
    const uv = between(course.states, own);
    const strain = strainsOf(course, uv);
    const now = strain.reduce((sum, s, e) => sum + (1000 * s * course.length[e]) ** 2, 0);
    const [left, right] = columns(rect, [1.2, 1]);
    const name = `${isFine ? "fine" : "coarse"} samples, iteration ${number(own, 0)}`;
    drawState(sheet, sheet.titled(left, "The plane", name), course, uv, strain);
    drawEnergy(sheet, sheet.titled(right, "Energy"), courses, isFine ? time : own, now);
    return [
      ["Iteration", `${number(own, 0)} of ${course.energy.length - 1}`],
      ["H now", `${number(now, 1)} mm²`],
      ["Error of a pair (rms)", mm(Math.sqrt(now / (course.length.length || 1)), 2)],
    ];
  },
};

// --- the flattened view ----------------------------------------------------------------------------

/** The triangle at a place of the plane: its corners, and their weights there. */
function triangleAt(
  /** @type {FlatteningLesson} */ { array: { triangles, corners_uv: uv } },
  /** @type {UV} */ [u, v],
) {
  for (let i = 0; i < triangles.length; i += 3) {
    const corners = [0, 1, 2].map((k) => triangles[i + k]);
    const [x, y] = [0, 1].map((axis) => corners.map((k) => uv[2 * k + axis]));
    const twice = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
    const weights = [1, 2, 0].map((a, k) => {
      const b = (k + 2) % 3;
      return ((x[a] - u) * (y[b] - v) - (x[b] - u) * (y[a] - v)) / twice;
    });
    if (weights.every((w) => w >= 0)) return { corners, weights };
  }
  return null;
}

/** @type {StageCode<FlatteningLesson>} */
const flattened = {
  probe: "flat",
  start({ array: { triangles, corners_uv: uv } }) {
    const middles = middlesOf(uv, [...triangles], 3);
    const { left, top, right, bottom } = boxOfPoints(middles);
    const best = nearestOf(middles, [(left + right) / 2, (top + bottom) / 2]);
    return [middles[2 * best], middles[2 * best + 1]];
  },
  draw(sheet, rect, lesson, { at }) {
    const { image, color } = lesson.picture;
    const { triangles, corners_uv: uv, corners_xy: xy, xyz_mm } = lesson.array;
    const [box, flat] = [imageBox(image), boxOf(lesson.flat)];
    const [left, middle, right] = columns(rect, [shareOf(box, rect, 0.2, 0.3), shareOf(flat, rect, 0.2, 0.4), 0.3]);
    const from = sheet.image("image", image, box, sheet.titled(left, `View ${lesson.view_index}`));
    const onto = sheet.image("flat", color, flat, sheet.titled(middle, "Flattened view F(u, v)"), { bar: true });
    const sides = [...triangles].flatMap((k, i) => [k, triangles[i % 3 === 2 ? i - 2 : i + 1]]);
    const detail = showDetail(sheet, onto, flat, sheet.titled(right, "Detail", "with triangles"), at, (pane) => {
      pane.picture(color, flat, 0.6);
      pane.segments(uv, sides, sheet.palette.text, 1);
    });
    const found = triangleAt(lesson, at);
    const mark = (/** @type {Pane} */ pane, /** @type {Numbers} */ of, radius = 8) => {
      if (!found) return;
      const corners = found.corners.map((k) => [of[2 * k], of[2 * k + 1]]);
      const middle = [0, 1].map((axis) => corners.reduce((x, c, k) => x + c[axis] * found.weights[k], 0));
      sheet.clipped(pane.rect, () => {
        pane.area(corners, sheet.palette.mark, 0.5);
        pane.ring(middle, radius, sheet.palette.mark);
      });
    };
    mark(from, xy);
    mark(onto, uv);
    mark(detail, uv, 2);
    const pixel = found ? pixelAt(lesson.flat, ...at) : -1;
    const place = [...xyz_mm.subarray(3 * pixel, 3 * pixel + 3)].map((x) => number(x, 0)).join(" ");
    return [
      ["Lies on itself", percent(lesson.folded_share)],
      ["Weights", found ? found.weights.map((w) => number(w, 2)).join(" ") : "–"],
      ["x, y, z", pixel < 0 ? "–" : `${place} mm`],
    ];
  },
};

// --- the start view --------------------------------------------------------------------------------

/** @type {StageCode<StartLesson>} */
const start = {
  draw(sheet, rect, lesson) {
    const { array, angles_deg: angles, view_index: chosen, tried } = lesson;
    const { palette: color } = sheet;
    const [top, bottom] = rows(rect, [1, 1.2]);
    const [first, last] = [Math.min(...angles), Math.max(...angles)];
    const half = (last - first) / Math.max(1, angles.length - 1) / 2;
    const inner = sheet.titled(top, "Cloth that each view shows", "by its angle");
    const most = 1.1 * Math.max(1, ...array.area_cm2);
    const labels = { xLabel: "angle (°)", yLabel: "cm²" };
    const plot = new Plot(sheet, inner, [first - half, last + half], [0, most], labels);
    const bar = (/** @type {number} */ view, /** @type {number} */ height, /** @type {string} */ look) =>
      plot.block([angles[view] - half, angles[view] + half], [0, height], look);
    array.area_cm2.forEach((area, view) => bar(view, area, color.line));
    for (const { view, part_cm2: part } of tried)
      bar(view, part || array.area_cm2[view], !part ? color.unused : view === chosen ? color.accent : color.soft);
    const { image, color: flat } = lesson.picture;
    const [left, right] = columns(bottom, [1, 1]);
    sheet.image("image", image, imageBox(image), sheet.titled(left, `Image of ${viewName(lesson, chosen)}`));
    sheet.image("flat", flat, boxOf(lesson.flat), sheet.titled(right, "Flattened view", "the first shape"));
    return [
      ["Start view", viewName(lesson, chosen)],
      ["Views flattened", String(tried.length)],
    ];
  },
};

/** By the names of stages.html. */
export const FLATTENING_STAGES = { overview, samples, minimisation, flattened, start };
