// The stages of the recording as a whole: which view is the start, and whether it is recorded as it says.

import { boxOf } from "../canvas/geometry.js";
import { cm2, degrees, number } from "../page/format.js";
import { imageBox } from "./detail.js";
import { columns, rows } from "./draw.js";
import { Plot } from "./plot.js";
import { viewName } from "./rotation.js";

/** @type {Record<string, StageCode>} */
export const RECORDING_STAGES = {
  overview: {
    // Of the session's own start view: all views need not be compared for it.
    facts: ({ flattening: lesson }) => [
      ["Views", String(lesson.angles_deg.length)],
      ["The first one shows", cm2(lesson.area_cm2)],
      ["It is seen at", degrees(lesson.angles_deg[lesson.view_index], 0)],
    ],
    draw(sheet, rect, { flattening: lesson }) {
      const { image, color: flat } = lesson.picture;
      const [left, right] = columns(rect, [1, 1]);
      sheet.image("image", image, imageBox(image), sheet.titled(left, "One of the views", "as the item hangs"));
      sheet.image(
        "flat",
        flat,
        boxOf(lesson.flat),
        sheet.titled(right, "The same cloth, flat", "to grow by the others"),
      );
    },
  },
  start_view: {
    facts({ start: lesson }) {
      const { tried, session_view: session } = lesson;
      const part = (/** @type {number} */ area) => (area ? number(area, 0) : "folded");
      return [
        ["Start view", viewName(lesson, lesson.view_index)],
        ["It shows", cm2(lesson.array.area_cm2[lesson.view_index])],
        ["Flattened", tried.map(({ view }) => String(view)).join(", ")],
        ["Largest part, cm²", tried.map(({ part_cm2 }) => part(part_cm2)).join(", ")],
        ["The session begins with", session === null ? "–" : viewName(lesson, session)],
      ];
    },
    draw(sheet, rect, { start: lesson }) {
      const { area_cm2: areas } = lesson.array;
      const { color } = sheet;
      const [top, bottom] = rows(rect, [1, 1.2]);
      const order = [...areas.keys()].sort((a, b) => lesson.angles_deg[a] - lesson.angles_deg[b]);
      const most = areas.reduce((largest, area) => Math.max(largest, area), 1);
      const inner = sheet.titled(top, "Cloth that each view shows", "in the order of their angles");
      const plot = new Plot(sheet, inner, { x: [0, areas.length], y: [0, 1.1 * most], yLabel: "cm²", xAxis: false });
      const edges = [...areas.keys(), areas.length];
      plot.bars(
        edges,
        order.map((view) => areas[view]),
        () => color.line,
      );
      const parts = new Map(lesson.tried.map(({ view, part_cm2 }) => [view, part_cm2]));
      const isFolded = (/** @type {number} */ view) => parts.get(view) === 0;
      const colorOf = (/** @type {number} */ view) =>
        view === lesson.view_index ? color.accent : isFolded(view) ? color.unused : color.soft;
      plot.bars(
        edges,
        order.map((view) => (isFolded(view) ? areas[view] : (parts.get(view) ?? 0))),
        (at) => colorOf(order[Math.floor(at)]),
      );
      const every = Math.ceil(areas.length / Math.max(1, plot.inner.w / (4 * sheet.em)));
      order.forEach((view, at) => {
        if (at % every) return;
        const name = degrees(lesson.angles_deg[view], 0);
        const below = plot.inner.y + plot.inner.h + 0.3 * sheet.em;
        sheet.text(name, plot.px(at + 0.5), below, {
          align: "center",
          baseline: "top",
          size: 0.85,
          color: color.soft,
        });
      });
      const { image, color: flat } = lesson.picture;
      const [left, right] = columns(bottom, [1, 1]);
      const [whole, box] = [imageBox(image), boxOf(lesson.flat)];
      sheet.image("image", image, whole, sheet.titled(left, `Image of ${viewName(lesson, lesson.view_index)}`));
      sheet.image("flat", flat, box, sheet.titled(right, "Flattened view", "the first shape"));
    },
  },
  check: {
    facts: ({ check: lesson }) => [
      ["Views", `${lesson.view_index}, ${lesson.other_view}`],
      ["Recorded turn", degrees(lesson.recorded_deg)],
      ["Seen turn", `${degrees(lesson.seen_deg)} ± ${degrees(lesson.std_deg)}`],
    ],
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
