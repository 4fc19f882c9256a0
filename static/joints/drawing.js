// Where parts of the shape are joined: on the flattened view, in 3D, and in the source image.

import { nearest } from "/static/canvas/geometry.js";
import { drawDot, strokeLoop } from "/static/canvas/marks.js";

const HIT_PX = 10;

/** @typedef {import("/static/page/messages").JointInfo} JointInfo */

export class JointsDrawing {
  /** `panel` knows the joints, and which is chosen. */
  constructor(/** @type {Page} */ page, /** @type {import("/static/joints/panel.js").JointsPanel} */ panel) {
    this.page = page;
    this.panel = panel;
    page.draws(this);
  }

  /** The joint at a place: one whose seam is near, else the smallest part that has it; null: none. */
  at(/** @type {number} */ u, /** @type {number} */ v) {
    const { joints } = this.panel;
    const { transform } = this.page.canvas;
    const seamOf = (/** @type {JointInfo} */ joint) => joint.seam_uv_m.map((uv) => transform.toPane(...uv));
    const [holding] = joints.filter((joint) => holds(joint, u, v)).sort((a, b) => a.area_cm2 - b.area_cm2);
    const found = nearest(joints, seamOf, transform.toPane(u, v), HIT_PX) ?? holding;
    return found ? joints.indexOf(found) : null;
  }

  drawOver(/** @type {Context} */ context, /** @type {Style} */ style) {
    const { joints, chosen, shown } = this.panel;
    if (!shown || this.page.isLive || this.page.canvas.side === "other") return;
    const { transform } = this.page.canvas;
    joints.forEach((joint, n) => {
      if (n === chosen) return;
      context.fillStyle = style.getPropertyValue(joint.weak ? "--warn" : "--seam");
      for (const uv of joint.seam_uv_m) {
        const { x, y } = transform.toPane(...uv);
        context.fillRect(x - 2, y - 2, 4, 4);
      }
    });
    if (chosen === null) return;
    for (const loop of joints[chosen].outline_uv_m)
      strokeLoop(this.page.canvas, loop, style.getPropertyValue("--accent"), 2, { rim: 1.5, dash: [6, 4] });
    for (const uv of joints[chosen].seam_uv_m)
      drawDot(context, transform.toPane(...uv), style.getPropertyValue("--accent"), 3.5);
  }

  /** @param {Context} context @param {Style} style @param {PlaceInScene} place */
  drawInScene(context, style, place) {
    const { joints, chosen, shown } = this.panel;
    if (!shown || chosen === null) return;
    for (const point of joints[chosen].seam_xyz_m) {
      const at = place(point);
      if (at) drawDot(context, at, style.getPropertyValue("--accent"), 3);
    }
  }
}

/** Whether the outlines of a part hold a place: an odd number of their edges is crossed on the way out. */
function holds(/** @type {JointInfo} */ { outline_uv_m }, /** @type {number} */ u, /** @type {number} */ v) {
  let inside = false;
  for (const loop of outline_uv_m)
    loop.forEach(([u1, v1], n) => {
      const [u0, v0] = loop[(n + loop.length - 1) % loop.length];
      if (v0 > v !== v1 > v && u < u0 + ((v - v0) / (v1 - v0)) * (u1 - u0)) inside = !inside;
    });
  return inside;
}
