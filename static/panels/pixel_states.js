// Why pixels of a view are not in the shape: a layer over its source image, and the legend with their shares.

import { askJson } from "/static/page/connection.js";
import { make, rebuild, swatch } from "/static/page/dom.js";
import { number, percent } from "/static/page/format.js";
import { KeptSwitch } from "/static/page/theme.js";

/** @typedef {{ state: string; text: string; color: string | null; share: number; missing: number }} Share */

export class PixelStates {
  /** @param {() => void} changed called when a legend has come */
  constructor(changed) {
    this.changed = changed;
    this.shown = new KeptSwitch("source-states");
    this.asked = ""; // the address of the legend that was asked for
    this.legend = /** @type {Share[] | null} */ (null); // what the server says, of that address
  }

  /** The address of the layer of a view for a revision of the shape; null if it is not shown. */
  addressOf(/** @type {number} */ view, /** @type {number} */ revision) {
    return this.shown.on && revision ? `/source/${view}/states-${revision}.png` : null;
  }

  /**
   * Show the shares of a view below its image.
   * @param {HTMLElement} element @param {number} view @param {number} revision
   */
  show(element, view, revision) {
    const address = this.addressOf(view, revision)?.replace(".png", ".json") ?? "";
    element.hidden = !address;
    if (!address) return;
    if (this.asked !== address) this.load(address);
    rebuild(element, [address, this.legend], () => (this.legend ?? []).map(row));
  }

  async load(/** @type {string} */ address) {
    this.asked = address;
    this.legend = null;
    const legend = await askJson(address);
    if (this.asked !== address) return;
    this.legend = legend;
    if (legend) this.changed();
    else this.asked = ""; // the connection was lost; asked again when it is shown again
  }
}

function row(/** @type {Share} */ { state, text, color, share, missing }) {
  const tip =
    `${number(100 * share, 1)} % of the item's pixels; ` +
    `${number(100 * missing, 1)} % show cloth that is in the result from no view`;
  return make("p", { tip, data: { state } }, swatch(color ?? "transparent"), `${percent(share)} ${text}`);
}
