// The stages of adding the next view: the rotation, lines of equal Z-angle, the search and the renewed view.

import { boxOf, endsOf, movedBox, union } from "../canvas/geometry.js";
import { outlineOf } from "../canvas/picture.js";
import { within } from "../page/dom.js";
import { cm2, degrees, mm, number, rgbOf } from "../page/format.js";
import { columns, imageBox, Pane, Plot, rows, shareOf } from "./draw.js";
import { viewName } from "./flattening.js";
import { between, lastOf } from "./lesson.js";

const UNKNOWN_ANGLE = -128;
const degreesOf = (/** @type {number} */ radians) => (180 * radians) / Math.PI;

/** @type {TextLook} */
const NAME = { weight: 700, plate: true };

// --- the rotation ----------------------------------------------------------------------------------

/** Beyond the limit it is grey. @param {Sheet} sheet @param {PlanningLesson} lesson @param {number} deg */
function angleColor(sheet, { z_angle_colors: colors, z_angle_span_deg: span, parameters }, deg) {
  if (Math.abs(deg) >= parameters.z_angle_limit_deg) return [...rgbOf(sheet.palette.soft), 110];
  const at = Math.round(((deg / span + 1) / 2) * (colors.length - 1));
  return [...colors[within(at, 0, colors.length - 1)], 255];
}

/**
 * The item from above: the camera below, directions in the colors of their Z-angles, and arrows.
 * @param {Sheet} sheet @param {Rect} rect @param {PlanningLesson} lesson @param {Arrow[]} arrows
 */
function drawFromAbove(sheet, rect, lesson, arrows) {
  const { palette: color } = sheet;
  const limit = lesson.parameters.z_angle_limit_deg;
  const pane = new Pane(sheet, "above", { left: -1.2, right: 1.2, top: -0.4, bottom: 1.3 }, rect, {});
  const at = (/** @type {number} */ deg, /** @type {number} */ share) =>
    [Math.sin, Math.cos].map((of) => share * of((Math.PI * deg) / 180));
  for (let deg = -90; deg < 90; deg += 3) {
    const [r, g, b, alpha] = angleColor(sheet, lesson, deg + 1.5);
    const part = [at(deg, 1), at(deg + 3, 1), at(deg + 3, 0.86), at(deg, 0.86)];
    pane.area(part, `rgb(${r} ${g} ${b})`, alpha / 255);
  }
  for (const deg of [-limit, limit]) {
    pane.line([[0, 0], at(deg, 1)], color.limit, 1.5, [5, 4]);
    pane.text(degrees(deg, 0), at(deg, 1.1), { ...NAME, color: color.limit });
  }
  const { x, y } = pane.at(0, 0);
  const [radius] = pane.scaling;
  sheet.fill(color.line, (to) => to.ellipse(x, y, 0.3 * radius, 0.2 * radius, 0.2, 0, 2 * Math.PI));
  pane.text("item", [0, 0], {});
  pane.text("▲ camera", [0, 1.14], { color: color.soft });
  for (const arrow of arrows) {
    pane.line([at(arrow.deg, 0.3), at(arrow.deg, 0.84)], arrow.color, 2.5, arrow.dash);
    pane.ring(at(arrow.deg, 0.84), 3, arrow.color, 3);
    pane.text(arrow.label, at(arrow.deg, 0.6), { ...NAME, color: arrow.color });
  }
}

/** @type {StageCode<PlanningLesson>} */
const rotation = {
  probe: "columns",
  start: ({ flat }) => [flat.origin_uv_m[0] + (flat.cols * flat.pixel_size_m) / 3, 0],
  draw(sheet, rect, lesson, { at: [pointed] }) {
    const { plan, array } = lesson;
    const { palette: color, em } = sheet;
    const taken = plan.sides.find((s) => s.side === plan.side) ?? plan.sides[0];
    const { a_0_deg: before, rotation_deg: turn, u_b_m: bound } = taken;
    const { u_m: u, column_count: h, column_mean_z_angle_deg: a } = taken.curves;
    const sign = taken.side === "right" ? 1 : -1;
    const columnOf = (/** @type {number} */ at) => Math.round((at - u[0]) / lesson.flat.pixel_size_m);
    const column = columnOf(pointed);
    const arrows = /** @type {Arrow[]} */ ([]);
    if (before !== null && turn !== null) {
      arrows.push({ deg: before - sign * turn, label: "", color: color.mark, dash: [4, 4] });
      arrows.push({ deg: before, label: "A_0", color: color.mark });
    }
    const here = a[column] ?? null;
    if (here !== null) arrows.push({ deg: here, label: degrees(here, 0), color: color.text });
    const [left, right] = columns(rect, [0.42, 0.58]);
    drawFromAbove(sheet, sheet.titled(left, "Seen from above"), lesson, arrows);

    const box = boxOf(lesson.flat);
    const [top, middle, bottom] = rows(right, [1, 1, 1.3], 4);
    const x = /** @type {UV} */ ([box.left, box.right]);
    const most = 1.08 * Math.max(1, ...h);
    const key = "columns";
    const counts = new Plot(sheet, top, x, [0, most], { key, yLabel: "h(u), pixels that count", color: color.count });
    const means = new Plot(sheet, middle, x, [-90, 90], { key, yLabel: "A_z(u) (°)", color: color.mean });
    counts.under(u, h, color.count, 0, u.length - 1, 0.18);
    counts.curve(u, h, color.count);
    means.curve(u, a, color.mean, 2.5);
    const strip = { ...bottom, x: counts.rect.x, w: counts.rect.w, h: bottom.h - 1.6 * em };
    const foot = strip.y + strip.h;
    sheet.show(key, box, strip, { margin: 0, stretch: true }, (pane) => {
      const angles = array.z_angle_deg;
      const colorAt = (/** @type {number} */ i) => angleColor(sheet, lesson, angles[i]);
      pane.painted(lesson.flat, box, (i) => (angles[i] === UNKNOWN_ANGLE ? null : colorAt(i)));
      for (const { side } of plan.sides) pane.dots(array[`edge_${side}`], 1.6, color.band);
    });
    sheet.text("u: the flattened view, drawn wide", strip.x, foot + 1.2 * em, { color: color.soft });

    counts.vertical(pointed, color.text, 1.5, foot);
    if (bound !== null) {
      const ends = [columnOf(bound), sign > 0 ? u.length - 1 : 0].sort((p, q) => p - q);
      counts.under(u, h, color.accent, ends[0], ends[1], 0.35);
      counts.vertical(bound, color.accent, 1.5, foot);
      counts.text("S_0", [(u[ends[0]] + u[ends[1]]) / 2, 0], { ...NAME, color: color.accent }, -0.9);
      counts.text("u_b", [bound, most], { ...NAME, color: color.accent }, 0.9);
      if (before !== null) means.ring([bound, before], 6, color.mark, 3);
    }
    const free = before === null ? null : lesson.parameters.z_angle_limit_deg + sign * before;
    return [
      ["Edges, left and right", `${plan.sides.map((s) => number(1000 * s.occluding_edge_m, 0)).join(", ")} mm`],
      ["h, A_z at the pointer", `${h[column] ?? "–"}, ${degrees(here)}`],
      ["u_b, A_0", bound === null ? "–" : `${mm(1000 * bound, 0)}, ${degrees(before)}`],
      ["A, held to 10–50°", `${degrees(free, 0)} → ${degrees(turn, 0)}`],
      ["Next view", plan.view_index === null ? plan.reason : viewName(lesson, plan.view_index)],
    ];
  },
};

// --- the new view ----------------------------------------------------------------------------------

/** A view with its line, below its curve. @param {Sheet} sheet @param {Rect} rect @param {AlignmentLesson} lesson */
function drawLine(sheet, rect, lesson, /** @type {"current" | "new"} */ name) {
  const { lines: found, picture } = lesson;
  const { palette: color } = sheet;
  const [top, bottom] = rows(rect, [1, 1.8], 10);
  const box = boxOf(lesson[name]);
  const turn = (name === "new" && found?.rotation_deg) || 0;
  const x = /** @type {UV} */ ([box.left, box.right]);
  const title = name === "new" ? "New view" : `From ${viewName(lesson, lesson.start_view)}`;
  const yLabel = turn ? "A_z, A_z − A over u (°)" : "A_z over u (°)";
  const plot = new Plot(sheet, sheet.titled(top, title), x, [-120, 120], { yLabel });
  sheet.show(name, box, bottom, { margin: 8, bar: true }, (pane) => {
    pane.picture(picture[`${name}_color`], box, 0.55);
    if (!found) return;
    const line = found[name];
    const ends = endsOf(line);
    pane.dots(line.pixels_uv_m.flat(), Math.max(1.2, 0.001 * pane.scaling[0]), color.band);
    pane.line(ends, color.panel, 5);
    pane.line(ends, color.text, 2.5);
    pane.ring(line.point_uv_m, 7, color.mark, 3);
  });
  if (!found) return;
  const { u_m: u, column_mean_z_angle_deg: a } = found[`${name}_curves`];
  plot.block(x, found.common_range_deg, color.soft, 0.24);
  if (turn) plot.curve(u, a, color.before, 1.8, [5, 4]);
  const before = a.map((deg) => (deg === null ? null : deg - turn));
  plot.curve(u, before, color.mean, 2.5);
  plot.horizontal(found.a_m_deg, color.band, 1.5, [5, 4]);
}

/** @type {StageCode<AlignmentLesson>} */
const lines = {
  draw(sheet, rect, lesson) {
    const { lines: found, planned_view: planned, view_index: added } = lesson;
    const { image } = lesson.picture;
    const share = shareOf(imageBox(image), rect, 0.2, 0.3);
    const [first, left, right] = columns(rect, [share, (1 - share) / 2, (1 - share) / 2]);
    sheet.image("image", image, imageBox(image), sheet.titled(first, "After the turn"));
    drawLine(sheet, left, lesson, "current");
    drawLine(sheet, right, lesson, "new");
    const range = found?.common_range_deg.map((x) => degrees(x, 0)).join(" to ");
    return [
      ["New view", `${viewName(lesson, added)}${planned === added ? "" : `; view ${planned} could not be aligned`}`],
      ["Turned by A", degrees(found?.rotation_deg, 0)],
      ["Shared range", range ?? "none"],
      ["A_m", degrees(found?.a_m_deg)],
    ];
  },
};

// --- search and renewal ----------------------------------------------------------------------------

/** Both views, the new one moved. @param {Sheet} sheet @param {Rect} rect @param {AlignmentLesson} lesson */
function drawOverlay(sheet, rect, lesson, /** @type {Motion} */ motion) {
  const [currentBox, newBox] = [boxOf(lesson.current), boxOf(lesson.new)];
  const box = lesson.motions.map((m) => movedBox(newBox, m)).reduce(union, currentBox);
  const { current_color, new_color } = lesson.picture;
  sheet.show("overlay", box, rect, { margin: 10, bar: true }, (pane) => {
    pane.picture(current_color, currentBox, 0.75);
    pane.picture(new_color, newBox, 0.6, motion);
    pane.picture(outlineOf(current_color, sheet.palette.kept), currentBox);
    pane.picture(outlineOf(new_color, sheet.palette.new), newBox, 1, motion);
  });
}

/**
 * The costs of shifts at the turn that is found, and the way to it.
 * @param {Sheet} sheet @param {Rect} rect @param {AlignmentLesson} lesson @param {number} time
 */
function drawCosts(sheet, rect, { search: { turns_rad: turns, shifts_m, cost, starts, path } }, time) {
  const shifts = shifts_m.map((m) => 1000 * m);
  const off = turns.map((turn) => Math.abs(turn - lastOf(path)[0]));
  const slice = cost[off.indexOf(Math.min(...off))];
  const least = cost.map((costs) => Math.min(...costs.flat()));
  const [low, high] = [Math.min(...least), Math.max(...cost.flat(2))];
  const [good, bad] = [rgbOf(sheet.palette.accent), rgbOf(sheet.palette.raised)];
  const n = shifts.length;
  const [top, bottom] = rows(rect, [1.2, 1]);
  const step = (shifts[1] - shifts[0]) / 2;
  const [first, last] = [shifts[0] - step, lastOf(shifts) + step];
  const labels = { xLabel: "u (mm)", yLabel: "v (mm)" };
  const plot = new Plot(sheet, top, [first, last], [last, first], labels);
  const placeOf = (/** @type {XYZ} */ [, u, v]) => [1000 * u, 1000 * v];
  sheet.clipped(plot.rect, () => {
    const box = { left: first, right: last, top: first, bottom: last };
    plot.painted({ rows: n, cols: n }, box, (i) => {
      const share = (slice[i % n][Math.floor(i / n)] - low) / (high - low || 1);
      return [...good.map((g, k) => Math.round(g + share * (bad[k] - g))), 255];
    });
    for (const each of starts) plot.ring(placeOf(each), 3, sheet.palette.text, 1.5);
    plot.line(path.map(placeOf), sheet.palette.mark, 2);
    plot.ring(between(path.map(placeOf), time), 6, sheet.palette.mark, 3);
  });
  const about = { xLabel: "turn (°)", yLabel: "lowest cost" };
  const inDegrees = turns.map(degreesOf);
  const turned = new Plot(sheet, bottom, [inDegrees[0], lastOf(inDegrees)], [low, Math.max(...least)], about);
  turned.curve(inDegrees, least, sheet.palette.accent);
  turned.vertical(degreesOf(lastOf(path)[0]), sheet.palette.mark);
}

/** @type {StageCode<AlignmentLesson>} */
const search = {
  plays: ({ motions }) => motions.length - 1,
  draw(sheet, rect, lesson, { time }) {
    const { array, search: found, renewed, motions } = lesson;
    const [left, middle, right] = columns(rect, [1, 1.2, 1]);
    const [step, last] = [Math.round(time), motions.length - 1];
    const name = ["initial estimate", "best of the grid"][step] ?? `finer, step ${step - 1}`;
    const plane = sheet.titled(left, "The plane", step === last ? "end of the search" : name);
    drawOverlay(sheet, plane, lesson, between(motions, time));
    const [turn, u, v] = lastOf(found.path);
    const by = degrees(degreesOf(turn));
    drawCosts(sheet, sheet.titled(middle, "Cost of a shift", `turned by ${by}`), lesson, time);
    const [kept, fresh] = [rgbOf(sheet.palette.kept), rgbOf(sheet.palette.new)];
    const colors = [null, [...kept, 200], [...fresh, 200], [...kept, 90], [...fresh, 90]]; // by KEPT, NEW, ... of Python
    const box = boxOf(renewed);
    const inner = sheet.titled(right, "Renewed view", "who shows each pixel");
    sheet.show("renewed", box, inner, { margin: 10, bar: true }, (pane) => {
      pane.picture(lesson.picture.renewed_color, box);
      pane.painted(renewed, box, (i) => colors[array.origin[i]]);
    });
    return [
      ["Places tried", number(found.tried, 0)],
      ["Shifted by", mm(1000 * Math.hypot(u, v))],
      ["Turned by", by],
      ["Score", `${number(lesson.initial_score?.total, 2)} → ${number(found.end_score, 2)}`],
      ["Proposed", lesson.start_stands ? "the initial estimate" : "where the search ends"],
      ["Area", `${number(lesson.current_cm2, 0)} → ${cm2(lesson.renewed_cm2)}`],
    ];
  },
};

/** By the names of stages.html. */
export const ADDING_STAGES = { rotation, lines, search };
