// What stages 9 to 11 draw: Z-angles, the curves over the columns, and the rotation.

import { cm2, degrees, mm, number, rgbOf } from "../page/format.js";
import { boxOf, pixelAt } from "../canvas/geometry.js";
import { columns, inset, painted, rows } from "./draw.js";
import { middleOf, shareOf } from "./detail.js";
import { Plot, ticks } from "./plot.js";

const UNKNOWN_ANGLE = -128;

/** @type {TextLook} */
const BELOW = { align: "center", baseline: "top", size: 0.85 };
/** @type {TextLook} */
const MIDDLE = { align: "center", baseline: "middle", size: 0.85 };
/** @type {TextLook} */
const NAME = { align: "center", weight: 700, plate: true };

const radians = (/** @type {number} */ deg) => (deg * Math.PI) / 180;

/**
 * A view as it is named everywhere: its number, and its angle.
 * @param {{ angles_deg: number[] }} lesson @param {number} view
 */
export const viewName = (lesson, view) => `view ${view} (${degrees(lesson.angles_deg[view], 0)})`;

/**
 * The Z-angles in color; beyond the limit grey.
 * @param {PlanningLesson} lesson @param {number} limit @param {Sheet} sheet
 */
function zAnglePicture(lesson, limit, sheet) {
  const { rows: down, cols } = lesson.flat;
  const [angle, colors, span] = [lesson.array.z_angle_deg, lesson.z_angle_colors, lesson.z_angle_span_deg];
  const grey = rgbOf(sheet.color.soft);
  return painted(down, cols, (i) => {
    if (angle[i] === UNKNOWN_ANGLE) return null;
    if (Math.abs(angle[i]) >= limit) return [...grey, 110];
    const at = Math.round(((angle[i] / span + 1) / 2) * (colors.length - 1));
    return [...colors[Math.max(0, Math.min(colors.length - 1, at))], 255];
  });
}

/** @param {Sheet} sheet @param {Rect} rect @param {PlanningLesson} lesson @param {number} limit */
function zRamp(sheet, rect, lesson, limit) {
  const { z_angle_colors: colors, z_angle_span_deg: span } = lesson;
  const high = 0.9 * sheet.em;
  const inner = inset(rect, 4, 1.9 * sheet.em, 4, 0);
  sheet.text("Z-angle (°)", rect.x, rect.y + 1.1 * sheet.em, { color: sheet.color.soft, size: 0.85 });
  const context = sheet.context;
  const px = (/** @type {number} */ deg) => inner.x + (inner.w * (deg / span + 1)) / 2;
  colors.forEach((color, i) => {
    const deg = span * ((2 * (i + 0.5)) / colors.length - 1);
    context.fillStyle = Math.abs(deg) < limit ? `rgb(${color.join(" ")})` : sheet.color.line;
    context.fillRect(inner.x + (inner.w * i) / colors.length, inner.y, inner.w / colors.length + 0.6, high);
  });
  for (const t of ticks(-span, span, 4))
    sheet.text(number(t, 0), px(t), inner.y + high + 4, { ...BELOW, color: sheet.color.soft });
  for (const t of [-limit, limit])
    sheet.line([px(t), inner.y - 4], [px(t), inner.y + high + 3], sheet.color.limit, 2);
}

/** The occluding edges, where they are. @param {Sheet} sheet @param {PaneMap} map @param {PlanningLesson} lesson */
function drawEdges(sheet, map, lesson, size = 2) {
  for (const side of lesson.sides) sheet.dots(map, lesson.array[`edge_${side.side}`], size, sheet.color.band);
}

// --- seen from above -------------------------------------------------------------------------------

/**
 * The item from above: the camera below, the directions that count shaded, arrows at Z-angles.
 * @param {Sheet} sheet @param {Rect} rect @param {number} limit @param {Arrow[]} arrows
 */
function fromAbove(sheet, rect, limit, arrows, /** @type {UV | null} */ turn = null) {
  const context = sheet.context;
  const radius = Math.min(rect.w / 2 - 1.4 * sheet.em, (rect.h - 3.4 * sheet.em) / 1.4);
  const [x, y] = [rect.x + rect.w / 2, rect.y + rect.h / 2 - 0.3 * radius];
  /** @type {(deg: number, r: number) => UV} */
  const at = (deg, r) => [x + r * Math.sin(radians(deg)), y + r * Math.cos(radians(deg))];
  context.beginPath();
  context.moveTo(x, y);
  context.arc(x, y, radius, Math.PI / 2 - radians(limit), Math.PI / 2 + radians(limit));
  context.closePath();
  context.save();
  context.globalAlpha = 0.16;
  context.fillStyle = sheet.color.limit;
  context.fill();
  context.restore();
  for (const deg of [-limit, limit]) {
    sheet.line([x, y], at(deg, radius), sheet.color.limit, 1.5, [5, 4]);
    const [tx, ty] = at(deg, radius + 0.8 * sheet.em);
    sheet.text(degrees(deg, 0), tx, ty, { ...MIDDLE, color: sheet.color.limit, weight: 600 });
  }
  context.beginPath();
  context.ellipse(x, y, 0.3 * radius, 0.2 * radius, 0.2, 0, 2 * Math.PI);
  context.fillStyle = sheet.color.raised;
  context.strokeStyle = sheet.color.text;
  context.lineWidth = 2;
  context.fill();
  context.stroke();
  sheet.text("item", x, y, { ...MIDDLE, color: sheet.color.soft });
  sheet.text("▲ camera", x, y + radius + 1.1 * sheet.em, { ...MIDDLE, color: sheet.color.soft });
  if (turn) {
    context.beginPath();
    const [from, to] = turn;
    context.arc(x, y, 0.66 * radius, Math.PI / 2 - radians(from), Math.PI / 2 - radians(to), to > from);
    context.strokeStyle = sheet.color.accent;
    context.lineWidth = 2;
    context.stroke();
    const back = at(to - 8 * Math.sign(to - from), 0.66 * radius);
    sheet.arrow(back, at(to, 0.66 * radius), sheet.color.accent, 2);
    const [lx, ly] = at((from + to) / 2, 0.66 * radius + 0.9 * sheet.em);
    sheet.text("A", lx, ly, { ...NAME, color: sheet.color.accent, baseline: "middle" });
  }
  for (const { deg, label, color, dash } of arrows) {
    const tip = at(deg, 0.94 * radius);
    if (dash) sheet.line(at(deg, 0.24 * radius), tip, color, 2, dash);
    else sheet.arrow(at(deg, 0.24 * radius), tip, color, 2.5);
    if (label) {
      const [lx, ly] = at(deg, 0.5 * radius);
      sheet.text(label, lx, ly, { ...NAME, color, baseline: "middle" });
    }
  }
}

// --- Z-angle and curves ----------------------------------------------------------------------------

function probedAngle(/** @type {Lessons} */ { planning: lesson }, /** @type {Ui} */ ui) {
  const at = pixelAt(lesson.flat, ...ui.at);
  const angle = at < 0 ? UNKNOWN_ANGLE : lesson.array.z_angle_deg[at];
  return angle === UNKNOWN_ANGLE ? null : angle;
}

/** @param {Lessons} parts */
const angleStart = ({ planning: p }) => middleOf(p.flat, (i) => p.array.z_angle_deg[i] !== UNKNOWN_ANGLE);

/**
 * The curves over the columns, and the flattened view drawn as wide below them. Returns the plot.
 * @param {Sheet} sheet @param {Rect} rect @param {Lessons} parts @param {Ui} ui
 */
function drawCurves(sheet, rect, { planning: lesson }, ui) {
  const box = boxOf(lesson.flat);
  const [top, bottom] = rows(rect, [1.25, 1], 6);
  const { current_u_mm: u, current_h: h, current_a_z_deg: a } = lesson.array;
  const most = h.reduce((m, x) => Math.max(m, x), 1);
  const plot = new Plot(sheet, top, {
    x: [1000 * box.left, 1000 * box.right],
    y: [0, 1.08 * most],
    y2: [-90, 90],
    xLabel: "",
    yLabel: "h(u), pixels of the column",
    y2Label: "A_z(u) (°)",
    yColor: sheet.color.count,
    y2Color: sheet.color.mean,
    xAxis: false,
  });
  plot.area(u, h, sheet.color.count, 0, u.length - 1, plot.y, 0.18);
  plot.curve(u, h, sheet.color.count);
  plot.curve(u, a, sheet.color.mean, { scale: plot.y2, width: 2.5 });
  const strip = { x: plot.inner.x, w: plot.inner.w, y: bottom.y, h: bottom.h - 3 * sheet.em };
  const map = sheet.pane("columns", box, strip, { margin: 0, stretch: true });
  sheet.within(strip, () => sheet.picture(map, zAnglePicture(lesson, ui.parameters.z_angle_limit_deg, sheet), box));
  sheet.frame(strip);
  const low = { ...BELOW, color: sheet.color.soft };
  for (const t of ticks(...plot.x, Math.max(2, Math.round(strip.w / (7 * sheet.em)))))
    sheet.text(number(t, 0), plot.px(t), strip.y + strip.h + 0.3 * sheet.em, low);
  sheet.text(
    "u (mm); the flattened view is drawn wide",
    strip.x + strip.w / 2,
    strip.y + strip.h + 1.6 * sheet.em,
    low,
  );
  return { plot, strip, map };
}

function columnAt(/** @type {PlanningLesson} */ lesson, /** @type {Ui} */ ui) {
  const u = lesson.array.current_u_mm;
  if (!u.length) return -1;
  const at = Math.round((1000 * ui.at[0] - u[0]) / (1000 * lesson.flat.pixel_size_m));
  return at >= 0 && at < u.length ? at : -1;
}

// --- the rotation ----------------------------------------------------------------------------------

/** @param {PlanningLesson} lesson */
const chosenSide = (lesson) => lesson.sides.find((s) => s.side === lesson.side) ?? lesson.sides[0];

/**
 * The turns to the views on the chosen side, with A and the one that is taken.
 * @param {Sheet} sheet @param {Rect} rect @param {PlanningLesson} lesson @param {PlannedSide} side @param {number} sign
 */
function drawViews(sheet, rect, lesson, side, sign) {
  const here = lesson.angles_deg[lesson.view_index];
  const turns = lesson.angles_deg
    .map((angle, view) => ({ view, turn: (((sign * (angle - here)) % 360) + 360) % 360 }))
    .filter((v) => v.turn > 0 && v.turn <= 60)
    .sort((a, b) => a.turn - b.turn);
  const y = rect.y + Math.min(rect.h * 0.4, 3 * sheet.em);
  const px = (/** @type {number} */ turn) => rect.x + 12 + ((rect.w - 24) * turn) / 60;
  sheet.line([px(0), y], [px(60), y], sheet.color.soft, 1);
  for (const t of [0, 10, 20, 30, 40, 50, 60])
    sheet.text(number(t, 0), px(t), y + 0.9 * sheet.em, { ...BELOW, color: sheet.color.soft });
  sheet.text("turn (°)", rect.x + rect.w / 2, y + 2.3 * sheet.em, { ...BELOW, color: sheet.color.soft });
  for (const { view, turn } of turns) {
    const taken = view === side.view_index;
    sheet.ring([px(turn), y], taken ? 6 : 3.5, taken ? sheet.color.mark : sheet.color.soft, taken ? 3 : 1.5);
    if (taken)
      sheet.text(`view ${view}`, px(turn), y - 1.1 * sheet.em, {
        align: turn > 45 ? "right" : "center",
        color: sheet.color.mark,
        weight: 600,
      });
  }
  if (side.rotation_deg !== null) {
    sheet.line([px(side.rotation_deg), y - 10], [px(side.rotation_deg), y + 10], sheet.color.accent, 3);
    sheet.text("A", px(side.rotation_deg), y + 10, { ...NAME, baseline: "top", color: sheet.color.accent });
  }
}

// --- the stages ------------------------------------------------------------------------------------

/** @type {Record<string, StageCode>} */
export const PLANNING_STAGES = {
  z_angle: {
    probe: "z",
    start: angleStart,
    facts(lessons, ui) {
      const values = lessons.planning.array.z_angle_deg;
      const limit = ui.parameters.z_angle_limit_deg;
      let [low, high, known, within] = [Infinity, -Infinity, 0, 0];
      for (const a of values) {
        if (a === UNKNOWN_ANGLE) continue;
        [low, high] = [Math.min(low, a), Math.max(high, a)];
        known += 1;
        if (Math.abs(a) < limit) within += 1;
      }
      return [
        ["Z-angles", `${degrees(low, 0)} to ${degrees(high, 0)}`],
        ["Within the limit", `${number((100 * within) / Math.max(1, known), 0)} % of the cloth`],
        ["At the pointer", degrees(probedAngle(lessons, ui), 0)],
      ];
    },
    draw(sheet, rect, lessons, ui) {
      const lesson = lessons.planning;
      const limit = ui.parameters.z_angle_limit_deg;
      const box = boxOf(lesson.flat);
      const share = shareOf(box, rect, 0.35, 0.62);
      const [left, right] = columns(rect, [1 - share, share]);
      const angle = probedAngle(lessons, ui);
      const [dial, ramp] = rows(left, [1, 0.17]);
      const arrows = angle === null ? [] : [{ deg: angle, label: degrees(angle, 0), color: sheet.color.mark }];
      fromAbove(sheet, sheet.titled(dial, "Seen from above"), limit, arrows);
      zRamp(sheet, ramp, lesson, limit);
      const inner = sheet.titled(right, "Flattened view", viewName(lesson, lesson.view_index));
      sheet.show("z", box, inner, {}, (map) => {
        sheet.picture(map, zAnglePicture(lesson, limit, sheet), box);
        drawEdges(sheet, map, lesson, 2);
        sheet.scaleBar(map);
        if (angle !== null) sheet.cross(map.at(...ui.at), sheet.color.mark);
      });
    },
  },
  curves: {
    probe: "columns",
    start: angleStart,
    facts({ planning: lesson }, ui) {
      const at = columnAt(lesson, ui);
      const total = lesson.array.current_h.reduce((a, b) => a + b, 0);
      const finite = lesson.array.current_a_z_deg.filter(Number.isFinite);
      return [
        ["Columns", String(lesson.array.current_h.filter((n) => n > 0).length)],
        ["Area that counts", cm2(1e4 * total * lesson.flat.pixel_size_m ** 2)],
        ["A_z", finite.length ? `${degrees(Math.min(...finite), 0)} to ${degrees(Math.max(...finite), 0)}` : "–"],
        ["u at the pointer", at < 0 ? "–" : mm(lesson.array.current_u_mm[at], 0)],
        [
          "h, A_z there",
          at < 0 ? "–" : `${lesson.array.current_h[at]}, ${degrees(lesson.array.current_a_z_deg[at])}`,
        ],
      ];
    },
    draw(sheet, rect, lessons, ui) {
      const { plot, strip } = drawCurves(sheet, rect, lessons, ui);
      const lesson = lessons.planning;
      const at = columnAt(lesson, ui);
      if (at < 0) return;
      const u = lesson.array.current_u_mm[at];
      plot.vertical(u, sheet.color.mark, "", 1.5);
      sheet.line([plot.px(u), strip.y], [plot.px(u), strip.y + strip.h], sheet.color.mark, 1.5);
      sheet.ring(plot.at(u, lesson.array.current_h[at]), 4, sheet.color.count, 2);
      if (Number.isFinite(lesson.array.current_a_z_deg[at]))
        sheet.ring(plot.at(u, lesson.array.current_a_z_deg[at], plot.y2), 4, sheet.color.mean, 2);
    },
  },
  rotation: {
    values: ({ planning: { side } }) => (side === "right" ? { beyond: "≥", sign: "+" } : { beyond: "≤", sign: "−" }),
    facts({ planning: lesson }, ui) {
      const side = chosenSide(lesson);
      const edge = (/** @type {string} */ name) =>
        number(lesson.sides.find((s) => s.side === name)?.occluding_edge_mm, 0);
      const sign = side.side === "right" ? 1 : -1;
      const turn = side.a_0_deg === null ? null : ui.parameters.z_angle_limit_deg + sign * side.a_0_deg;
      return [
        ["Edges, left and right", `${edge("left")}, ${edge("right")} mm`],
        ["Side taken", lesson.side ?? "none left"],
        ["u_b, A_0", side.u_b_mm === null ? "–" : `${mm(side.u_b_mm, 0)}, ${degrees(side.a_0_deg)}`],
        [`A_w ${sign > 0 ? "+" : "−"} A_0`, degrees(turn, 0)],
        ["A, held to 10–50°", degrees(side.rotation_deg, 0)],
        ["Next view", lesson.next_view === null ? lesson.reason : viewName(lesson, lesson.next_view)],
      ];
    },
    draw(sheet, rect, lessons, ui) {
      const lesson = lessons.planning;
      const side = chosenSide(lesson);
      const [left, right] = columns(rect, [0.38, 0.62]);
      const [dial, below] = rows(left, [1, 0.42]);
      const sign = side.side === "left" ? 1 : -1;
      const { a_0_deg: before, rotation_deg: turn, u_b_mm } = side;
      const after = before === null || turn === null ? null : before + sign * turn;
      const color = sheet.color.mark;
      /** @type {Arrow[]} */
      const arrows =
        before === null || after === null
          ? []
          : [
              { deg: before, label: "A_0", color },
              { deg: after, label: "", color, dash: [4, 4] },
            ];
      const way = /** @type {UV | null} */ (arrows.length ? [before, after] : null);
      fromAbove(sheet, sheet.titled(dial, "Seen from above"), ui.parameters.z_angle_limit_deg, arrows, way);
      drawViews(sheet, sheet.titled(below, "Recorded views", "beyond this one"), lesson, side, sign);
      const { plot, strip, map } = drawCurves(sheet, right, lessons, ui);
      sheet.within(strip, () => drawEdges(sheet, map, lesson, 1.6));
      if (u_b_mm === null) return;
      const { current_u_mm: u, current_h: h } = lesson.array;
      const { color: colors } = sheet;
      const b = Math.round((u_b_mm - u[0]) / (1000 * lesson.flat.pixel_size_m));
      const end = sign > 0 ? 0 : u.length - 1;
      plot.area(u, h, colors.accent, Math.min(b, end), Math.max(b, end), plot.y, 0.35);
      const x = plot.px(u_b_mm);
      plot.vertical(u_b_mm, colors.accent, "u_b", 2);
      sheet.line([x, strip.y], [x, strip.y + strip.h], colors.accent, 2);
      const low = plot.inner.y + plot.inner.h - 0.8 * sheet.em;
      sheet.text("S_0", (plot.px(u[end]) + x) / 2, low, { ...NAME, color: colors.accent });
      if (before === null) return;
      const y = plot.py(before, plot.y2);
      sheet.ring([x, y], 7, color, 3);
      sheet.text("A_0", x + sign * 14, y - 8, { ...NAME, color, align: sign > 0 ? "left" : "right" });
    },
  },
};
