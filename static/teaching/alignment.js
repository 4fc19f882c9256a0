// What stages 12 to 16 draw: the new view, the lines, the overlay, the search, the renewed view.

import { cm2, degrees, mm, number, rgbOf } from "../page/format.js";
import { applied, boxOf, movedBox, union } from "../canvas/geometry.js";
import { outlineOf } from "../canvas/picture.js";
import { within } from "../page/dom.js";
import { between, lastOf } from "./lesson.js";
import { columns, painted, rows } from "./draw.js";
import { imageBox } from "./detail.js";
import { Plot, ticks } from "./plot.js";
import { viewName } from "./rotation.js";

const POOR = 0.5; // of the score: more likely wrong than right
const [KEPT, NEW, OLD_OF_BOTH, NEW_OF_BOTH] = [1, 2, 3, 4]; // as flatcloth/engine/teaching.py numbers them

// --- lines -----------------------------------------------------------------------------------------

/** @param {Sheet} sheet @param {PaneMap} map @param {LessonLine} line @param {Numbers | undefined} pixels */
function drawLine(sheet, map, line, pixels, /** @type {Motion | null} */ moved = null) {
  /** @type {(at: UV) => UV} */
  const place = ([u, v]) => (moved ? applied(moved, u, v) : [u, v]);
  if (pixels) {
    const dots = Float32Array.from(pixels);
    for (let i = 0; i < dots.length; i += 2) [dots[i], dots[i + 1]] = place([dots[i], dots[i + 1]]);
    sheet.dots(map, dots, Math.max(1.2, 0.001 * map.scaleX), sheet.color.band);
  }
  const { center_uv_m: center, direction } = line;
  let [from, to] = [-0.05, 0.05];
  for (let i = 0; pixels && i < pixels.length; i += 2) {
    const along = (pixels[i] - center[0]) * direction[0] + (pixels[i + 1] - center[1]) * direction[1];
    [from, to] = [Math.min(from, along), Math.max(to, along)];
  }
  const at = (/** @type {number} */ t) =>
    map.at(...place([center[0] + t * direction[0], center[1] + t * direction[1]]));
  sheet.line(at(from), at(to), sheet.color.panel, 5);
  sheet.line(at(from), at(to), sheet.color.text, 2.5);
  sheet.ring(map.at(...place(line.point_uv_m)), 7, sheet.color.mark, 3);
}

// --- overlay and search ----------------------------------------------------------------------------

/**
 * @param {Sheet} sheet @param {Rect} rect @param {AlignmentLesson} lesson @param {Motion} motion
 * @param {boolean} withLines
 */
function drawOverlay(sheet, rect, lesson, motion, withLines) {
  const [currentBox, newBox] = [boxOf(lesson.current), boxOf(lesson.new)];
  const ends = [lesson.initial, lesson.found, motion].map((m) => movedBox(newBox, m));
  const { current_color, new_color } = lesson.picture;
  sheet.show("overlay", ends.reduce(union, currentBox), rect, { margin: 10, bar: true }, (map) => {
    sheet.picture(map, current_color, currentBox, 0.75);
    sheet.movedPicture(map, new_color, newBox, motion, 0.6);
    sheet.picture(map, outlineOf(current_color, sheet.color.kept), currentBox);
    sheet.movedPicture(map, outlineOf(new_color, sheet.color.new), newBox, motion);
    if (!withLines || !lesson.lines) return;
    drawLine(sheet, map, lesson.lines.current, lesson.array.current_pixels_uv);
    drawLine(sheet, map, lesson.lines.new, lesson.array.new_pixels_uv, motion);
  });
}

/** @param {AlignmentLesson} lesson @param {number} slice @param {Sheet} sheet */
function costPicture(lesson, slice, sheet) {
  const side = lesson.search.shifts_mm.length;
  const cost = lesson.array.cost;
  let [low, high] = [Infinity, -Infinity];
  for (const c of cost) [low, high] = [Math.min(low, c), Math.max(high, c)];
  const [good, bad] = [rgbOf(sheet.color.accent), rgbOf(sheet.color.raised)];
  return painted(side, side, (i) => {
    const [v, u] = [Math.floor(i / side), i % side];
    const share = (cost[(slice * side + u) * side + v] - low) / (high - low || 1);
    return [...good.map((g, k) => Math.round(g + share * (bad[k] - g))), 255];
  });
}

function stepName(/** @type {AlignmentLesson} */ lesson, /** @type {Ui} */ ui) {
  const n = Math.round(ui.time);
  const last = lesson.search.motions.length - 1;
  if (n === 0) return "initial estimate";
  if (n === 1 && last > 1) return "best of the coarse search";
  if (n < last) return `finer, step ${n - 1}`;
  return lesson.search.start_stands ? "end of the search" : "found";
}

// --- renewal ---------------------------------------------------------------------------------------

function originPicture(/** @type {AlignmentLesson} */ lesson, /** @type {Sheet} */ sheet) {
  const { rows: down, cols } = lesson.renewed;
  const [kept, fresh] = [rgbOf(sheet.color.kept), rgbOf(sheet.color.new)];
  const colors = {
    [KEPT]: [...kept, 255],
    [OLD_OF_BOTH]: [...kept, 140],
    [NEW]: [...fresh, 255],
    [NEW_OF_BOTH]: [...fresh, 140],
  };
  return painted(down, cols, (i) => colors[lesson.array.origin[i]] ?? null);
}

// --- the stages ------------------------------------------------------------------------------------

/** @type {Record<string, StageCode>} */
export const ALIGNMENT_STAGES = {
  new_view: {
    facts: ({ alignment: a }) => {
      /** @type {Fact[]} */
      const leftOut = [["Left out", `view ${a.planned_view}: it could not be aligned`]];
      return [
        ["New view", viewName(a, a.view_index)],
        [
          "Turned by",
          a.lines
            ? `${degrees(Math.abs(a.lines.rotation_deg), 0)} to the ${a.lines.rotation_deg < 0 ? "left" : "right"}`
            : "–",
        ],
        ["Area", cm2(a.new_cm2)],
        ...(a.planned_view === a.view_index ? [] : leftOut),
      ];
    },
    draw(sheet, rect, { flattening, alignment: lesson }) {
      const before = flattening?.picture.image;
      /** @type {[key: string, title: string, detail: string, image: Drawable, box: Box][]} */
      const views = [
        [
          "after",
          `View ${lesson.view_index}`,
          "after the turn",
          lesson.picture.image,
          imageBox(lesson.picture.image),
        ],
        ["newflat", "Its flattened view", "", lesson.picture.new_color, boxOf(lesson.new)],
      ];
      if (before) views.unshift(["before", `View ${lesson.start_view}`, "before the turn", before, imageBox(before)]);
      const shares = views.map(([, , , , b]) => within((b.right - b.left) / (b.bottom - b.top), 0.2, 0.6));
      const panes = columns(rect, shares);
      views.forEach(([key, title, detail, image, box], i) => {
        const inner = sheet.titled(panes[i], title, detail);
        sheet.image(key, image, box, inner, { bar: key === "newflat" });
      });
    },
  },
  lines: {
    facts: ({ alignment: a }) =>
      a.lines
        ? [
            ["A, with its sign", degrees(a.lines.rotation_deg, 0)],
            ["Shared range", a.lines.common_range_deg.map((x) => degrees(x, 0)).join(" to ")],
            ["A_m", degrees(a.lines.a_m_deg)],
            ["Height of the points", mm(a.lines.height_mm, 0)],
          ]
        : [],
    draw(sheet, rect, { alignment: lesson }) {
      const lines = lesson.lines;
      columns(rect, [1, 1], 20).forEach((half, n) => {
        const name = n === 0 ? "current" : "new";
        const [top, bottom] = rows(half, [1, 1.8], 10);
        const u = lesson.array[`${name}_u_mm`];
        const a = lesson.array[`${name}_a_z_deg`];
        const grid = lesson[name];
        const box = boxOf(grid);
        const view = n === 0 ? lesson.start_view : lesson.view_index;
        const inner = sheet.titled(top, n === 0 ? "Current view" : "New view", viewName(lesson, view));
        const plot = new Plot(sheet, inner, {
          x: [1000 * box.left, 1000 * box.right],
          y: [-120, 120],
          yTicks: [-90, -45, 0, 45, 90],
          xLabel: "u (mm)",
          yLabel: n === 0 ? "A_z (°)" : "A_z, A_z − A (°)",
        });
        if (lines) plot.band(...lines.common_range_deg, sheet.color.soft, 0.24);
        if (!lines) {
          sheet.text("no common Z-angle", inner.x + 8, inner.y + 1.4 * sheet.em, { color: sheet.color.soft });
        } else if (n === 1) {
          plot.curve(u, a, sheet.color.before, { width: 1.8, dash: [5, 4] });
          plot.curve(
            u,
            a.map((x) => x - lines.rotation_deg),
            sheet.color.mean,
            { width: 2.5 },
          );
        } else {
          plot.curve(u, a, sheet.color.mean, { width: 2.5 });
        }
        if (lines) plot.horizontal(lines.a_m_deg, sheet.color.band, "A_m");
        sheet.show(name, box, bottom, { margin: 8, bar: true }, (map) => {
          sheet.picture(map, lesson.picture[`${name}_color`], box, 0.55);
          if (lines) drawLine(sheet, map, lines[name], lesson.array[`${name}_pixels_uv`]);
        });
      });
    },
  },
  search: {
    plays: ({ alignment: a }) => a.search.motions.length - 1,
    facts({ alignment: lesson }) {
      const [turn, u, v] = lesson.array.path.slice(-3);
      const { start_stands: stands, end_score: end } = lesson.search;
      return [
        ["Places tried", number(lesson.search.tried, 0)],
        ["Shifted by", mm(Math.hypot(u, v))],
        ["Turned by", degrees(turn)],
        ["Score", `${number(lesson.initial_score, 2)} → ${number(end, 2)}`],
        [
          "Initial estimate",
          (lesson.initial_score ?? 0) < POOR ? "poor: it rests on one line of pixels" : "near the place",
        ],
        ["Proposed", stands ? "the initial estimate" : "where the search ends"],
        ["Height differs (rms)", mm(lesson.score_parts.height_rms_mm)],
        ["Overlap", cm2(lesson.score_parts.overlap_cm2)],
      ];
    },
    draw(sheet, rect, { alignment: lesson }, ui) {
      const [left, right] = columns(rect, [0.52, 0.48]);
      const { turns_deg: turns, shifts_mm: shifts, motions } = lesson.search;
      const motion = between(motions, ui.time);
      drawOverlay(sheet, sheet.titled(left, "The plane", stepName(lesson, ui)), lesson, motion, ui.time < 0.5);
      const path = lesson.array.path;
      const last = path.slice(-3);
      const slice = turns.reduce(
        (best, t, i) => (Math.abs(t - last[0]) < Math.abs(turns[best] - last[0]) ? i : best),
        0,
      );
      const [top, bottom] = rows(right, [1.75, 1], 10);
      const inner = sheet.titled(top, "Cost of a shift", `turned by ${degrees(turns[slice], 1)}`);
      const size = Math.min(inner.w, inner.h);
      const plot = new Plot(
        sheet,
        { ...inner, x: inner.x + (inner.w - size) / 2, w: size, h: size },
        {
          x: [shifts[0], lastOf(shifts)],
          y: [lastOf(shifts), shifts[0]],
          xLabel: "u (mm)",
          yLabel: "v (mm), strong color: low cost",
          yTicks: ticks(shifts[0], lastOf(shifts), 4),
        },
      );
      const step = (shifts[1] - shifts[0]) / 2;
      const map = { at: plot.at.bind(plot) };
      sheet.within(plot.inner, () => {
        sheet.picture(map, costPicture(lesson, slice, sheet), {
          left: shifts[0] - step,
          right: lastOf(shifts) + step,
          top: shifts[0] - step,
          bottom: lastOf(shifts) + step,
        });
        for (let i = 0; i < lesson.array.starts.length; i += 3)
          sheet.ring(plot.at(lesson.array.starts[i + 1], lesson.array.starts[i + 2]), 3, sheet.color.text, 1.5);
        for (let i = 3; i < path.length; i += 3)
          sheet.line(plot.at(path[i - 2], path[i - 1]), plot.at(path[i + 1], path[i + 2]), sheet.color.mark, 2);
        const now = between(
          Array.from({ length: path.length / 3 }, (_, i) => [path[3 * i], path[3 * i + 1], path[3 * i + 2]]),
          ui.time,
        );
        sheet.ring(plot.at(now[1], now[2]), 6, sheet.color.mark, 3);
      });
      sheet.frame(plot.inner);
      const side = shifts.length ** 2;
      const least = turns.map((_, t) =>
        lesson.array.cost.subarray(t * side, (t + 1) * side).reduce((m, c) => Math.min(m, c), Infinity),
      );
      const span = [Math.min(...least), Math.max(...least)];
      const pad = 0.1 * (span[1] - span[0] || 1);
      const turnPlot = new Plot(sheet, bottom, {
        x: [Math.min(turns[0], last[0]), Math.max(lastOf(turns), last[0])], // finer steps may end beyond the grid
        y: [span[0] - pad, span[1] + pad],
        xLabel: "turn (°)",
        yLabel: "lowest cost of each turn",
      });
      turnPlot.curve(turns, least, sheet.color.accent);
      turnPlot.vertical(last[0], sheet.color.mark, "found", 2, [], true);
    },
  },
  renewal: {
    facts: ({ alignment: a }) => [
      ["Area", `${number(a.current_cm2, 0)} → ${cm2(a.renewed_cm2)}`],
      ["Gained", cm2(a.renewed_cm2 - a.current_cm2)],
      ["Other parts placed", String(a.placed_with)],
      ["Side", a.side ?? "–"],
    ],
    draw(sheet, rect, { alignment: lesson }) {
      const box = boxOf(lesson.renewed);
      const [left, right] = columns(rect, [1, 1]);
      const show = (/** @type {string} */ key, /** @type {Rect} */ inner, /** @type {Drawable} */ image) =>
        sheet.image(key, image, box, inner, { margin: 10, bar: true });
      show("origin", sheet.titled(left, "Who shows each pixel"), originPicture(lesson, sheet));
      show("renewed", sheet.titled(right, "Renewed flattened view"), lesson.picture.renewed_color);
    },
  },
};
