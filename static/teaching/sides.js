// The stage of the side of interest: the evidence of two layers, and the sides.

import { boxOfPoints } from "../canvas/geometry.js";
import { cm2, percent, rgbOf } from "../page/format.js";
import { shareOf } from "./detail.js";
import { columns, painted } from "./draw.js";

const UNDECIDED = 0;
const NO_ITEM = 2;
const STRIPE_PX = 6; // undecided cloth is striped, so that it differs without colour, too

/** The sides of a view's cloth as a picture of the size of its crop. @param {Sheet} sheet @param {SidesLesson} lesson */
function labelPicture(sheet, { first, array }) {
  const side = array.first_side;
  const [ours, other, none, low] = ["kept", "new", "even", "panel"].map((color) => rgbOf(sheet.color[color]));
  return painted(first.rows, first.cols, (i) => {
    if (side[i] === NO_ITEM) return null;
    if (side[i] !== UNDECIDED) return [...(side[i] > 0 ? ours : other), 235];
    const isStripe = (Math.floor(i / first.cols) + (i % first.cols)) % (2 * STRIPE_PX) < STRIPE_PX;
    return [...(isStripe ? none : low), 235];
  });
}

// --- the slice seen from above ---------------------------------------------------------------------

/** @param {Sheet} sheet @param {Rect} rect @param {SidesLesson} lesson */
function drawSection(sheet, rect, lesson) {
  const { section_mm: place, section_normal: normal, section_side: side } = lesson.array;
  const box = boxOfPoints(place);
  const map = sheet.pane("section", box, rect, { margin: 24 });
  const dot = Math.max(1.6, Math.min(4, 1.3 * map.scaleX));
  sheet.within(rect, () => {
    sheet.segments(map, place, lesson.array.alike, sheet.color.pair, 1);
    sheet.segments(map, place, lesson.array.opposite, sheet.color.unused, 1);
    for (const [value, color] of Object.entries({ 1: "kept", "-1": "new", 0: "even" })) {
      const own = [];
      for (let k = 0; k < side.length; k++) if (side[k] === Number(value)) own.push(k);
      sheet.dots(
        map,
        own.flatMap((k) => [place[2 * k], place[2 * k + 1]]),
        dot,
        sheet.color[color],
      );
      for (const k of own) {
        const [x, y] = map.at(place[2 * k], place[2 * k + 1]);
        const along = 2.4 * dot * sheet.weight;
        sheet.line([x, y], [x + along * normal[2 * k], y + along * normal[2 * k + 1]], sheet.color[color], 1);
      }
    }
    sheet.text("camera of view 0 ↓", rect.x + rect.w / 2, rect.y + rect.h - 6, {
      align: "center",
      color: sheet.color.soft,
      size: 0.85,
      plate: true,
    });
  });
  sheet.frame(rect);
}

// --- the stages ------------------------------------------------------------------------------------

/** @type {Record<string, StageCode>} */
export const SIDE_STAGES = {
  sides: {
    values: ({ sides: lesson }) => ({ samples: String(lesson.samples) }),
    facts: ({ sides: lesson }) => [
      ["Pairs alike, opposite", `${lesson.n_alike}, ${lesson.n_opposite}`],
      ["Mean certainty", percent(lesson.certainty)],
      ["Of interest", cm2(lesson.found_cm2)],
      ["Undecided", cm2(lesson.undecided_cm2)],
    ],
    draw(sheet, rect, { sides: lesson }) {
      const { rows, cols } = lesson.first;
      const box = { left: -0.5, top: -0.5, right: cols - 0.5, bottom: rows - 0.5 };
      const share = shareOf(box, rect, 0.25, 0.5);
      const [left, right] = columns(rect, [share, 1 - share]);
      const labels = labelPicture(sheet, lesson);
      sheet.image("labels", labels, box, sheet.titled(left, "Sides", `view ${lesson.view_index}`));
      drawSection(sheet, sheet.titled(right, "The slice", "of all views, seen from above"), lesson);
    },
  },
};
