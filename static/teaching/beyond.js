// The stages beyond the paper: sides, garment, a joint, seams, the check of the recording, and what was learned.

import { boxOf, boxOfPoints, union } from "../canvas/geometry.js";
import { mirrored } from "../both/seen.js";
import { words } from "../garment/marks.js";
import { loopsAt, motionOf } from "../doubts/panel.js";
import { cm2, count, degrees, number, percent, rgbOf } from "../page/format.js";
import { columns, imageBox, Plot, rows, shareOf } from "./draw.js";
import { between, lastOf, partsOf } from "./lesson.js";

const NO_ITEM = 2; // of the labels, as 1 and -1 the sides
const STRIPE_PX = 6; // undecided cloth is striped, so that it differs without colour, too
const TRUSTED = 0.6; // an edge that counts this much is drawn as well seen
const EXAGGERATED = 5; // as often are residuals drawn as long as they are
const MOST_APART_M = 0.1;

/** Bars for possibilities, as many as there is room for. @param {Sheet} sheet @param {Rect} rect @param {Possibility[]} all */
function drawBars(sheet, rect, all) {
  const shown = all.slice(0, Math.max(2, Math.floor(rect.h / (2 * sheet.em))));
  const high = Math.min(rect.h / shown.length, 3.2 * sheet.em);
  shown.forEach(({ name, probability, color = sheet.palette.soft }, k) => {
    const [y, end] = [rect.y + (k + 0.5) * high, rect.x + rect.w];
    sheet.text(name, rect.x, y, { weight: k ? 400 : 600 });
    sheet.text(percent(probability), end, y, { align: "right" });
    const at = y + 0.4 * sheet.em;
    const bar = (/** @type {number} */ share, /** @type {string} */ look) =>
      sheet.fill(look, (to) => to.rect(rect.x, at, share * rect.w, 7));
    bar(1, sheet.palette.line);
    bar(probability, color);
  });
}

/** @type {StageCode<SidesLesson>} */
const sides = {
  draw(sheet, rect, lesson) {
    const { section_mm: place, section_normal: normal, section_side: side, first_side: labels } = lesson.array;
    const { palette: color } = sheet;
    const { cols, rows: down } = lesson.first;
    const box = { left: -0.5, top: -0.5, right: cols - 0.5, bottom: down - 0.5 };
    const share = shareOf(box, rect, 0.25, 0.5);
    const [left, right] = columns(rect, [share, 1 - share]);
    const lookOf = (/** @type {number} */ sign) => (sign > 0 ? color.kept : sign < 0 ? color.new : color.even);
    const isStripe = (/** @type {number} */ i) => (Math.floor(i / cols) + (i % cols)) % (2 * STRIPE_PX) < STRIPE_PX;
    sheet.show("labels", box, sheet.titled(left, "Sides", `view ${lesson.view_index}`), {}, (pane) =>
      pane.painted(lesson.first, box, (i) => {
        if (labels[i] === NO_ITEM) return null;
        return [...rgbOf(labels[i] || isStripe(i) ? lookOf(labels[i]) : color.panel), 235];
      }),
    );

    const inner = sheet.titled(right, "A slice of all views", "seen from above; the camera of view 0 is below");
    sheet.show("section", boxOfPoints(place), inner, { margin: 24 }, (pane) => {
      const dot = Math.max(1.6, Math.min(4, 1.3 * pane.scaling[0]));
      const along = (2.4 * dot * sheet.weight) / pane.scaling[0];
      pane.segments(place, lesson.array.alike, color.pair, 1);
      pane.segments(place, lesson.array.opposite, color.unused, 1);
      side.forEach((sign, k) => {
        const from = place.subarray(2 * k, 2 * k + 2);
        const to = from.map((x, axis) => x + along * normal[2 * k + axis]);
        pane.line([from, to], lookOf(sign), 1);
        pane.dots(from, dot, lookOf(sign));
      });
    });
    return [
      ["Pairs alike, opposite", `${lesson.n_alike}, ${lesson.n_opposite}`],
      ["Mean certainty", percent(lesson.certainty)],
      ["Of interest", cm2(lesson.found_cm2)],
      ["Undecided", cm2(lesson.undecided_cm2)],
    ];
  },
};

/** @type {StageCode<GarmentLesson>} */
const garment = {
  plays: ({ energy }) => energy.length - 1,
  draw(sheet, rect, lesson, { time }) {
    const { energy, kinds, flat, array } = lesson;
    const { palette: color } = sheet;
    const ends = lastOf(energy);
    const best = ends.indexOf(Math.min(...ends));
    const outlines = between(partsOf(array.states, array.states.length / energy.length), time);
    const loops = partsOf(outlines, outlines.length / ends.length).map((loop) => partsOf(loop, 2));
    const [left, right] = columns(rect, [1.7, 1]);
    const inner = sheet.titled(left, flat ? "The shape of this session" : "An example", "and its starts");
    const box = boxOfPoints([...array.inside_uv, ...array.edge_uv, ...array.states]);
    sheet.show("garment", box, inner, { margin: 18, bar: true }, (pane) => {
      if (flat) pane.picture(lesson.picture.shape, boxOf(flat), 0.4);
      else pane.dots(array.inside_uv, 1.4, color.line);
      pane.dots(array.unseen_uv, 1.8, color.even);
      partsOf(array.edge_uv, 2).forEach((place, i) =>
        pane.dots(place, 2.4, array.edge_trust[i] >= TRUSTED ? color.pair : color.sample),
      );
      loops.forEach((uv, k) => k !== best && pane.loop(uv, color.soft, 1.2, [5, 4]));
      pane.loop(loops[best], color.mark, 2.6);
    });
    const [top, bottom] = rows(right, [1, 1.2]);
    const courses = ends.map((_, k) => energy.map((row) => Math.log10(row[k])));
    const steps = energy.map((_, i) => i);
    const span = /** @type {UV} */ ([Math.min(...courses.flat()) - 0.1, Math.max(...courses.flat()) + 0.1]);
    const labels = { log: true, xLabel: "step" };
    const plot = new Plot(sheet, sheet.titled(top, "Energy E", "of each start"), [0, lastOf(steps)], span, labels);
    courses.forEach((course) => plot.curve(steps, course, color.soft, 1.2));
    plot.curve(steps, courses[best], color.mark, 2.5);
    plot.vertical(time, color.text, 1);
    const bars = kinds.map(({ name, probability }) => ({ name: words(name), probability }));
    const all = [
      { ...bars[0], color: color.mark },
      ...bars.slice(1),
      { name: "none of these", probability: lesson.none },
    ];
    drawBars(sheet, sheet.titled(bottom, "Probability", "by this shape alone"), all);
    return [
      ["True edges", `${number(lesson.edges_m, 2)} m`],
      ["E of the best start", number(energy[Math.round(time)][best], 1)],
      ["Likeliest", `${words(kinds[0].name)}, ${percent(kinds[0].probability)}`],
      ["log Z of the second", `${number(kinds[1].below, 1)} (${words(kinds[1].name)})`],
    ];
  },
};

/** @type {StageCode<ShapeLesson>} */
const joint = {
  plays: ({ joints: [weakest] }) => (weakest ? weakest.choices.length - 1 : 0),
  draw(sheet, rect, lesson, { time }) {
    const [weakest] = lesson.joints;
    if (!weakest) return ending.draw(sheet, rect, lesson, { at: [0, 0], time });
    const { palette: color } = sheet;
    const { choices } = weakest;
    const motions = choices.map(motionOf);
    const colors = [color.mark, color.new, color.kept]; // of the places, the first as it is
    const [left, right] = columns(rect, [1.7, 1]);
    const whole = boxOf(lesson.grid);
    const box = union(whole, boxOfPoints(motions.flatMap((motion) => loopsAt(weakest, motion)).flat(2)));
    const inner = sheet.titled(left, "The shape of this session", "one part may lie elsewhere");
    sheet.show("joint", box, inner, { margin: 18, bar: true }, (pane) => {
      /** @type {(motion: Motion, color: string, width: number, dash?: number[]) => void} */
      const outline = (motion, look, width, dash) => {
        for (const loop of loopsAt(weakest, motion)) pane.loop(loop, look, width, dash);
      };
      pane.picture(lesson.picture.shape, whole, 0.6);
      motions.forEach((motion, n) => outline(motion, colors[n] ?? color.soft, 1.8, [5, 4]));
      outline(between(motions, time), color.text, 2.4);
      pane.dots(weakest.ends_uv_m.flat(2), 2.4, color.unused);
    });
    const bars = choices.map(({ title, probability }, n) => ({
      name: title,
      probability: probability ?? 0,
      color: colors[n],
    }));
    drawBars(sheet, sheet.titled(right, "Probability", "of each place"), bars);
    return [
      ["The part", cm2(weakest.area_cm2)],
      ["Held by", count(weakest.views.length, "view")],
      ["Right with a probability of", percent(weakest.probability)],
    ];
  },
};

/** @type {StageCode<ShapeLesson>} */
const seams = {
  draw(sheet, rect, lesson) {
    const [own, its] = lesson.outlines;
    const joined = lesson.seams.filter((seam) => !seam.is_apart);
    const { palette: color } = sheet;
    if (!its.length)
      return [...ending.draw(sheet, rect, lesson, { at: [0, 0], time: 0 }), ["Other side", "not known yet"]];
    const behind = its.map((loop) => loop.map(mirrored));
    const inner = sheet.titled(rect, "One plane", "the other side through this one");
    sheet.show("seams", boxOfPoints([...own, ...behind].flat(2)), inner, { margin: 18, bar: true }, (pane) => {
      for (const loop of own) pane.loop(loop, color.kept, 1.6);
      for (const loop of behind) pane.loop(loop, color.new, 1.6);
      for (const { this_uv_m, other_uv_m, is_apart } of lesson.seams) {
        const off = this_uv_m.map(([u, v], n) => [-other_uv_m[n][0] - u, other_uv_m[n][1] - v]);
        const isApart = is_apart || off.some(([du, dv]) => Math.hypot(du, dv) > MOST_APART_M); // it floats
        this_uv_m.forEach(([u, v], n) => {
          const to = [u + EXAGGERATED * off[n][0], v + EXAGGERATED * off[n][1]];
          if (!isApart) pane.line([[u, v], to], color.pair, 1);
        });
        pane.dots(this_uv_m.flat(), 2, isApart ? color.sample : color.pair);
      }
    });
    return [
      ["Sets of places", `${lesson.seams.length}, ${joined.length} join`],
      ["Joined along", `${number(joined.reduce((sum, seam) => sum + seam.length_mm, 0) / 10, 0)} cm`],
    ];
  },
};

/** @type {StageCode<CheckLesson>} */
const check = {
  draw(sheet, rect, lesson) {
    const { laid } = lesson.picture;
    const { turn_deg: turns, share } = lesson;
    const [left, right] = columns(rect, [0.62, 0.38]);
    const inner = sheet.titled(left, "Two views laid on each other", "as recorded, and with mistakes");
    sheet.image("laid", laid, imageBox(laid), inner);
    const labels = { xLabel: "turn (°); the line: as recorded", yLabel: "share that agrees" };
    const plot = new Plot(sheet, sheet.titled(right, "After any turn"), [turns[0], lastOf(turns)], [0, 1], labels);
    plot.curve(turns, share, sheet.palette.kept);
    plot.vertical(lesson.recorded_deg, sheet.palette.text);
    return [
      ["Views", `${lesson.first}, ${lesson.second}`],
      ["Recorded turn", degrees(lesson.recorded_deg)],
      ["Seen turn", `${degrees(lesson.seen_deg)} ± ${degrees(lesson.std_deg)}`],
    ];
  },
};

/** @type {StageCode<ShapeLesson>} */
const ending = {
  draw(sheet, rect, { picture, grid, area_cm2, views, joints }) {
    const inner = sheet.titled(rect, "The shape of this session", `after ${count(views, "view")}`);
    sheet.image("shape", picture.shape, boxOf(grid), inner, { margin: 18, bar: true });
    return [
      ["Shape", cm2(area_cm2)],
      ["Parts in doubt", String(joints.filter(({ weak }) => weak).length)],
    ];
  },
};

/** By the names of stages.html. */
export const BEYOND_STAGES = { sides, garment, joint, seams, check, ending };
