// Why pixels of a view are not in the shape: a layer over its source image, and the legend with their shares.

import { askJson, Fetched } from "../page/connection.js";
import { make, rebuild, swatch } from "../page/dom.js";
import { number, percent } from "../page/format.js";
import { KeptSwitch } from "../page/theme.js";

/** @typedef {{ state: string; text: string; color: string | null; share: number; missing: number }} Share */

export class PixelStates {
  /** @param {() => void} changed called when a legend has come */
  constructor(changed) {
    this.shown = new KeptSwitch("source-states");
    /** @type {Fetched<Share[]>} */
    this.legend = new Fetched(askJson, changed);
  }

  /** The address of the layer of a view for a revision of the shape; null if it is not shown. */
  addressOf(/** @type {number} */ view, /** @type {number} */ revision) {
    return this.shown.on && revision ? `source/${view}/states-${revision}.png` : null;
  }

  /**
   * Show the shares of a view below its image.
   * @param {HTMLElement} element @param {number} view @param {number} revision
   */
  show(element, view, revision) {
    const address = this.addressOf(view, revision)?.replace(".png", ".json") ?? null;
    element.hidden = !address;
    this.legend.want(address);
    const { value } = this.legend;
    rebuild(element, [address, value], () => (value ?? []).map(row));
  }
}

function row(/** @type {Share} */ { state, text, color, share, missing }) {
  const tip =
    `${number(100 * share, 1)} % of the item's pixels; ` +
    `${number(100 * missing, 1)} % show cloth that is in the result from no view`;
  return make("p", { tip, data: { state } }, swatch(color ?? "transparent"), `${percent(share)} ${text}`);
}
