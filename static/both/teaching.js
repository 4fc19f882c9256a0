// The stages of the seams: where the rims of both sides meet, and what the seams hold together.

import { boxOf } from "/static/canvas/geometry.js";
import { cm2, count, number } from "/static/page/format.js";
import { boxOfPoints, columns } from "/static/teaching/draw.js";
import { stagesOf } from "/static/teaching/lesson.js";
import { equation, fraction, sum, sup, words } from "/static/teaching/math.js";

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

const aboutOf = (/** @type {SeamsLesson} */ lesson) =>
  lesson.is_example ? "the other side of the session is not known yet" : "as seen from outside";

/** @param {Sheet} sheet @param {Rect} rect @param {Lessons} parts */
function drawMeeting(sheet, rect, { seams: lesson }) {
  const [left, right] = columns(rect, [1, 1]);
  /** @type {[string, string, string, Grid, Float32Array, Rect][]} */
  const panes = [
    [
      "this",
      lesson.is_example ? "An example" : "This side",
      aboutOf(lesson),
      lesson.this_grid,
      lesson.array.this_uv,
      left,
    ],
    ["other", "The other side", "as seen from its own outside", lesson.other_grid, lesson.array.other_uv, right],
  ];
  for (const [name, title, detail, grid, uv, pane] of panes)
    sheet.show(
      `seams-${name}`,
      boxOf(grid),
      sheet.titled(pane, title, detail),
      (map) => {
        sheet.picture(map, lesson.picture[name], boxOf(grid), 0.45);
        drawPlaces(sheet, map, lesson, uv, 2.2);
      },
      { margin: 14, bar: true },
    );
}

/** @param {Sheet} sheet @param {Rect} rect @param {Lessons} parts */
function drawHeld(sheet, rect, { seams: lesson }) {
  const { this_uv: own, mirrored_uv: its } = lesson.array;
  const loops = Object.entries(lesson.array).filter(([name]) => name.includes("_loop_"));
  const box = boxOfPoints(Float32Array.from(loops.flatMap(([, uv]) => Array.from(uv))));
  const inner = sheet.titled(rect, lesson.is_example ? "An example" : "One plane", "the other side through this one");
  sheet.show(
    "seams-held",
    box,
    inner,
    (map) => {
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
    },
    { margin: 18, bar: true },
  );
}

const joinedOf = (/** @type {SeamsLesson} */ { seams }) => seams.filter((seam) => !seam.why);
const lengthOf = (/** @type {SeamsLesson["seams"]} */ seams) =>
  `${number(seams.reduce((sum, seam) => sum + seam.length_mm, 0) / 10, 0)} cm`;
const PLACES = { pair: "places of a set that joins", sample: "places of a set that does not" };

export const SEAM_STAGES = stagesOf(
  "seams",
  [],
  [
    {
      name: "Rims that meet",
      figure: "seams · docs/robust.md",
      text: [
        "A garment is two sheets. Where one is hidden in a fold, the cloth goes on over a seam to the other. All " +
          "views lie in one object frame, so the rims of both sheets are compared in space: a place of either is " +
          "the nearest of the other's, within 25 mm, and the rims run in opposite directions.",
        "Such places agree on one motion between the planes if they are a seam. Parts that only touch do so " +
          "along straight lines: a set counts by its places times the width of the strip that they cover.",
      ],
      math: () => [equation("S = n ", fraction("w", "12 mm"), words(",   joins if "), "max(n, S) ≥ 30")],
      facts: ({ seams: lesson }) => [
        ["Places that meet", String(lesson.seams.reduce((sum, seam) => sum + seam.places, 0))],
        ["Sets", `${count(lesson.seams.length, "set")}, ${joinedOf(lesson).length} join`],
        ["Joined along", lengthOf(joinedOf(lesson))],
        ["Decided by hand", String(lesson.seams.filter((seam) => seam.decided).length)],
      ],
      legend: PLACES,
      draw: drawMeeting,
    },
    {
      name: "Seams",
      figure: "seams · docs/robust.md",
      text: [
        "Both sheets lie on one plane, the other one seen through this one: a place on a seam is one place of the " +
          "pattern. Pieces that nothing else joins are moved to where their largest sets lead; then Eq. (2) is " +
          "minimised over all pairs of both sheets, with a node for each place on a seam.",
        "The lines are five times as long as what is left between a place of this side and that of the other.",
      ],
      math: () => [
        equation(
          "H =",
          sum(words("pairs of both")),
          sup("(|u_i − u_j| − E_ij)", "2"),
          "+",
          sum(words("places k")),
          sup("(|u_i − u_k| − E_ik)", "2"),
        ),
      ],
      facts: ({ seams: lesson }) => [
        ["This side", cm2(lesson.this_cm2)],
        ["Other side", cm2(lesson.other_cm2)],
        ["Pieces that float", `${lesson.this_floating} here, ${lesson.other_floating} there`],
        [
          "Residual",
          lesson.residual_mm === null ? "–" : `${number(lesson.residual_mm, 1)} mm (median of those that join)`,
        ],
      ],
      legend: { kept: "outline of this side", new: "outline of the other", ...PLACES },
      draw: drawHeld,
    },
  ],
);
