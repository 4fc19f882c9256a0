// The stage of the seams: where the rims of both sides meet, and what they hold together.

import { boxOfPoints } from "../canvas/geometry.js";
import { cm2, count, number } from "../page/format.js";

const EXAGGERATED = 5; // as often are residuals drawn as long as they are

/**
 * The places of a seam in an array of all of them.
 * @param {SeamsLesson} lesson @param {Float32Array} uv @param {number} n
 */
const placesOf = ({ seams }, uv, n) => uv.subarray(2 * seams[n].start, 2 * (seams[n].start + seams[n].places));

/**
 * @param {Sheet} sheet @param {PaneMap} map @param {SeamsLesson} lesson @param {Float32Array} uv
 * @param {number} radius
 */
function drawPlaces(sheet, map, lesson, uv, radius) {
  lesson.seams.forEach((seam, n) =>
    sheet.dots(map, placesOf(lesson, uv, n), radius, seam.why ? sheet.color.sample : sheet.color.pair),
  );
}

/** @type {Record<string, StageCode>} */
export const SEAM_STAGES = {
  seams: {
    facts: ({ seams: lesson }) => [
      ["This side, other side", `${cm2(lesson.this_cm2)}, ${cm2(lesson.other_cm2)}`],
      ["Sets", `${count(lesson.seams.length, "set")}, ${lesson.seams.filter((seam) => !seam.why).length} join`],
      ["Pieces that float", `${lesson.this_floating} here, ${lesson.other_floating} there`],
      [
        "Residual",
        lesson.residual_mm === null ? "–" : `${number(lesson.residual_mm, 1)} mm (median of those that join)`,
      ],
    ],
    draw(sheet, rect, { seams: lesson }) {
      const { this_uv: own, mirrored_uv: its } = lesson.array;
      const loops = Object.entries(lesson.array).filter(([name]) => name.includes("_loop_"));
      const box = boxOfPoints(Float32Array.from(loops.flatMap(([, uv]) => Array.from(uv))));
      const inner = sheet.titled(rect, "One plane", "the other side through this one");
      sheet.show("seams-held", box, inner, { margin: 18, bar: true }, (map) => {
        for (const [name, uv] of loops)
          sheet.loop(map, uv, name.startsWith("this") ? sheet.color.kept : sheet.color.new, 1.6);
        lesson.seams.forEach((seam, n) => {
          if (seam.why) return;
          const [here, there] = [placesOf(lesson, own, n), placesOf(lesson, its, n)];
          for (let i = 0; i < here.length; i += 2) {
            const [u, v] = [here[i], here[i + 1]];
            const far = [u + EXAGGERATED * (there[i] - u), v + EXAGGERATED * (there[i + 1] - v)];
            sheet.line(map.at(u, v), map.at(far[0], far[1]), sheet.color.pair, 1);
          }
        });
        drawPlaces(sheet, map, lesson, own, 2);
      });
    },
  },
};
