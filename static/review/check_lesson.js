// The stage of the check: two views laid on each other, and the share of them that agrees after each turn.

import { number } from "/static/page/format.js";
import { columns } from "/static/teaching/draw.js";
import { Plot } from "/static/teaching/plot.js";

const degrees = (/** @type {number} */ value) => `${number(value, 1)}°`;

/** @type {Record<string, StageCode>} */
export const CHECK_STAGES = {
  check: {
    facts: ({ check: lesson }) => [
      ["Views", `${lesson.view_index}, ${lesson.other_view}`],
      ["Recorded turn", degrees(lesson.recorded_deg)],
      ["Seen turn", `${degrees(lesson.seen_deg)} ± ${degrees(lesson.std_deg)}`],
    ],
    /** @type {StageDrawing} */
    draw(sheet, rect, { check: lesson }) {
      const [left, right] = columns(rect, [0.62, 0.38], sheet.em);
      const { laid } = lesson.picture;
      const box = { left: 0, top: 0, right: laid.width, bottom: laid.height };
      sheet.image("laid", laid, box, left);
      const { turn_deg: turns, share } = lesson.array;
      const plot = new Plot(sheet, right, {
        x: [turns[0], turns[turns.length - 1]],
        y: [0, 1],
        xLabel: "turn, degrees",
        yLabel: "share that agrees",
      });
      plot.curve(turns, share, sheet.color.kept);
      plot.vertical(lesson.recorded_deg, sheet.color.text, "recorded");
    },
  },
};
