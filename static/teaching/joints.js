// The stages of the session's own shape: a joint that little evidence holds, with its alternatives; the shape itself.

import { boxOf, boxOfPoints, union } from "../canvas/geometry.js";
import { cm2, count, number, percent } from "../page/format.js";
import { JointOptions } from "../joints/places.js";
import { columns } from "./draw.js";
import { between } from "./lesson.js";
import { drawBars } from "./garment.js";

const COLORS = ["mark", "new", "kept"]; // of the places, the first as it is

const optionsOf = (/** @type {ShapeLesson} */ { joints: [joint] }) => joint && new JointOptions(joint);

/** @type {Record<string, StageCode>} */
export const SHAPE_STAGES = {
  joint: {
    plays: ({ shape }) => (optionsOf(shape)?.all.length ?? 1) - 1,
    facts({ shape }) {
      const [joint] = shape.joints;
      if (!joint)
        return [
          ["Parts in doubt", "none"],
          ["Shape", cm2(shape.area_cm2)],
          ["Views", String(shape.views)],
        ];
      return [
        ["The part", cm2(joint.area_cm2)],
        ["Held by", count(joint.views.length, "view")],
        ["Evidence C", number(joint.evidence, 1)],
        ["Right with a probability of", percent(joint.probability)],
        ["Other parts in doubt", String(shape.joints.length - 1)],
      ];
    },
    draw(sheet, rect, { shape }, ui) {
      const options = optionsOf(shape);
      const [left, right] = columns(rect, [1.7, 1]);
      const whole = boxOf(shape.grid);
      const box = options ? union(whole, boxOfPoints(options.everywhere.flat())) : whole;
      const inner = sheet.titled(left, "The shape of this session", options ? "one part may lie elsewhere" : "");
      sheet.show("joint", box, inner, { margin: 18, bar: true }, (map) => {
        sheet.picture(map, shape.picture.shape, whole, options ? 0.6 : 1);
        if (!options) return;
        options.all.forEach(({ motion }, n) => {
          for (const loop of options.loopsAt(motion)) sheet.loop(map, loop.flat(), colorOf(sheet, n), 1.8, [5, 4]);
        });
        const motions = options.all.map(({ motion }) => motion);
        const now = /** @type {Motion} */ (between(motions, ui.time));
        for (const loop of options.loopsAt(now)) sheet.loop(map, loop.flat(), sheet.color.text, 2.4);
        sheet.dots(map, shape.joints[0].ends_uv_m.flat(2), 2.4, sheet.color.unused);
      });
      const bars = (options?.all ?? []).map(({ title, probability }) => ({ name: title, probability, below: null }));
      drawBars(sheet, sheet.titled(right, "Probability", "of each place"), bars, COLORS);
    },
  },
  looking_back: {
    facts: ({ shape }) => [
      ["Shape", cm2(shape.area_cm2)],
      ["From", count(shape.views, "view")],
      ["Parts in doubt", String(shape.joints.filter(({ weak }) => weak).length)],
    ],
    draw(sheet, rect, { shape }) {
      const inner = sheet.titled(rect, "The shape of this session", `after ${count(shape.views, "view")}`);
      sheet.image("shape", shape.picture.shape, boxOf(shape.grid), inner, { margin: 18, bar: true });
    },
  },
};

/** @param {Sheet} sheet @param {number} n */
const colorOf = (sheet, n) => sheet.color[COLORS[n]] ?? sheet.color.soft;
