// The stage of the check: two views laid on each other, and the share of them that agrees after each turn.

import { number } from "/static/page/format.js";
import { columns } from "/static/teaching/draw.js";
import { stagesOf } from "/static/teaching/lesson.js";
import { equation, fraction, row, sup, words } from "/static/teaching/math.js";
import { Plot } from "/static/teaching/plot.js";

const degrees = (/** @type {number} */ value) => `${number(value, 1)}°`;

/** @type {StageDrawing} */
function drawCheck(sheet, rect, { check: lesson }) {
  const [left, right] = columns(rect, [0.62, 0.38], sheet.em);
  const { laid } = lesson.picture;
  const box = { left: 0, top: 0, right: laid.width, bottom: laid.height };
  sheet.show("laid", box, left, (map) => sheet.picture(map, laid, box));
  const { turn_deg: turns, share } = lesson.array;
  const plot = new Plot(sheet, right, {
    x: [turns[0], turns[turns.length - 1]],
    y: [0, 1],
    xLabel: "turn, degrees",
    yLabel: "share that agrees",
  });
  plot.curve(turns, share, sheet.color.kept);
  plot.vertical(lesson.recorded_deg, sheet.color.text, "recorded");
}

export const CHECK_STAGES = stagesOf(
  "check",
  [],
  [
    {
      name: "Is it right?",
      figure: "check · docs/checking.md",
      text: [
        "Everything holds only if angles, camera and images are what the recording says. Two neighbouring views are " +
          "laid on each other after the recorded turn, blue and orange: as recorded, and with three mistakes.",
        "The curve shows how much of their surface agrees after any other turn. Where it is highest is the turn that " +
          "the views show; over all pairs, each hypothesis (as recorded, the other way, twice as far, not at all) " +
          "has a likelihood.",
      ],
      math: () => [
        equation(
          "p(δ | f) ∝",
          sup("e", row("−", fraction(sup("(δ − f α)", "2"), "2 s^2"))),
          words("+ a wrong match"),
        ),
      ],
      facts: ({ check: lesson }) => [
        ["Views", `${lesson.view_index}, ${lesson.other_view}`],
        ["Recorded turn", degrees(lesson.recorded_deg)],
        ["Seen turn", `${degrees(lesson.seen_deg)} ± ${degrees(lesson.std_deg)}`],
      ],
      draw: drawCheck,
    },
  ],
);
