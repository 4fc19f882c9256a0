// In the corners of the 3D scene: the object frame's axes, and the turn from above, with the camera's place on it.

import { PagePart } from "./page.js";
import { drawDot, drawLabel, drawRing, strokeLine } from "../canvas/marks.js";
import { number } from "./format.js";

const RADIUS = 36;
const MARGIN = 22;
const AXIS_PX = 26;
const AXES = { x: "--bad", y: "--good", z: "--accent" };

export class Dial extends PagePart {
  /** @param {Context} context @param {Style} style @param {PlaceInScene} place */
  drawInScene(context, style, place) {
    const { state, sceneMarks } = this.page;
    if (this.page.hasCamera || sceneMarks.width < 200) return;
    context.font = "14px system-ui, sans-serif";
    context.textBaseline = "middle";
    const from = { x: sceneMarks.width - RADIUS - MARGIN, y: RADIUS + MARGIN };
    const color = (/** @type {string} */ name) => style.getPropertyValue(name);
    drawRing(context, from, color("--line"), RADIUS);
    const at = (/** @type {number} */ deg, far = RADIUS) => {
      const turn = (deg * Math.PI) / 180;
      return { x: from.x - far * Math.sin(turn), y: from.y + far * Math.cos(turn) };
    };
    for (const { angle_deg, state: was } of state.views) {
      if (was === "unused") drawRing(context, at(angle_deg), color("--soft"), 1);
      else drawDot(context, at(angle_deg), color(was === "rejected" ? "--bad" : "--good"), 3);
    }
    const present = state.views[state.present_view ?? -1]?.angle_deg;
    if (present === undefined) return;
    strokeLine(context, [at(present, 24), at(present, RADIUS + 12)], color("--text"), 3);
    drawLabel(context, style, `${number(present, 0)}°`, [from.x - 14, from.y], [from.x - 16, from.y - 9, 34, 18]);
    const next = state.active?.angle_deg ?? present;
    strokeLine(context, [at(present, 26), at(next, 26)], color("--accent"), 2, [4, 3]);
    this.drawAxes(context, color, place);
  }

  /** @param {Context} context @param {(name: string) => string} color @param {PlaceInScene} place */
  drawAxes(context, color, place) {
    const { right_m = 0, away_m = 1 } = this.page.state.axis ?? {};
    const ends = [-1, 0, 1, 2].map((i) =>
      place([right_m + 0.1 * +(i === 0), 0.1 * +(i === 1), away_m + 0.1 * +(i === 2)]),
    );
    const ways = ends.map((end) => ({ x: (end?.x ?? 0) - (ends[0]?.x ?? 0), y: (end?.y ?? 0) - (ends[0]?.y ?? 0) }));
    const scale = AXIS_PX / Math.max(1, ...ways.map(({ x, y }) => Math.hypot(x, y)));
    const at = (/** @type {number} */ i, far = scale) => ({ x: 48 + far * ways[i].x, y: 48 + far * ways[i].y });
    Object.entries(AXES).forEach(([name, shade], i) => {
      strokeLine(context, [at(0), at(i + 1)], color(shade), 2);
      context.fillStyle = color(shade);
      context.fillText(name, at(i + 1, 1.35 * scale).x - 4, at(i + 1, 1.35 * scale).y);
    });
  }
}
