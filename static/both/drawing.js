// Over the flattened view: the outline of the side behind, and the seams of both sides; in 3D the chosen seam.

import { nearest } from "/static/canvas/geometry.js";
import { drawDot, strokeLoop } from "/static/canvas/marks.js";
import { mirrored } from "/static/both/seen.js";

const HIT_PX = 8;
/** @type {SideName[]} */
const SHEETS = ["this", "other"];

/** @typedef {import("/static/page/messages").SidePlaces} SidePlaces */

export class SidesDrawing {
  /** `panel` knows the places, what is shown and what is chosen. */
  constructor(/** @type {Page} */ page, /** @type {import("/static/both/panel.js").BothSides} */ panel) {
    this.page = page;
    this.panel = panel;
    page.draws(this);
  }

  /** The places of a seam on a sheet, in the pane; none where that is not shown. */
  inPane(/** @type {number} */ seam, /** @type {SideName} */ sheet) {
    const { canvas } = this.page;
    const { this_uv_m, other_uv_m } = /** @type {SidePlaces} */ (this.panel.places).seams[seam];
    return (sheet === "this" ? this_uv_m : other_uv_m).flatMap((uv) => {
      const at = canvas.shownAt(sheet, uv);
      return at ? [canvas.transform.toPane(...at)] : [];
    });
  }

  /** The seam at a place of the pane; null: none is near. */
  seamAt(/** @type {Point} */ at) {
    const seams = this.panel.places?.seams.keys() ?? [];
    return nearest(seams, (seam) => this.everywhere(seam), at, HIT_PX);
  }

  drawOver(/** @type {Context} */ context, /** @type {Style} */ style) {
    const { places, other, showsSeams, chosen } = this.panel;
    if (!places || !other || this.page.isLive) return;
    if (other.is_related) this.drawBehind(style, places);
    if (!showsSeams) return;
    other.seams.forEach((seam, n) => {
      if (n === chosen) return;
      context.fillStyle = style.getPropertyValue(seam.why ? "--warn" : "--seam");
      for (const { x, y } of this.everywhere(n)) context.fillRect(x - 2, y - 2, 4, 4);
    });
    if (chosen === null) return;
    for (const at of this.everywhere(chosen)) drawDot(context, at, style.getPropertyValue("--accent"), 3.5);
  }

  /** The places of a seam on both sheets, in the pane. */
  everywhere(/** @type {number} */ seam) {
    return SHEETS.flatMap((sheet) => this.inPane(seam, sheet));
  }

  /**
   * The outline of each side, through the other one.
   * @param {Style} style @param {SidePlaces} places
   */
  drawBehind(style, places) {
    const { canvas } = this.page;
    const color = style.getPropertyValue("--seam");
    for (const sheet of SHEETS) {
      const behind = sheet === "this" ? places.other_outline_uv_m : places.this_outline_uv_m;
      for (const loop of behind) {
        const seen = loop.map((uv) => canvas.shownAt(sheet, mirrored(uv))).filter((at) => at !== null);
        strokeLoop(canvas, seen, color, 1.5, { rim: 1, dash: [6, 5] });
      }
    }
  }

  /** @param {Context} context @param {Style} style @param {PlaceInScene} place */
  drawInScene(context, style, place) {
    const { places, chosen, showsSeams } = this.panel;
    if (!places || chosen === null || !showsSeams) return;
    for (const point of places.seams[chosen].xyz_m) {
      const at = place(point);
      if (at) drawDot(context, at, style.getPropertyValue("--accent"), 3);
    }
  }
}
