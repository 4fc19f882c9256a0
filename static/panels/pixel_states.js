// Why pixels of a view are not in the shape: a layer over its source image, and the legend with their shares.

import { make, rebuild } from "/static/page/dom.js";
import { number } from "/static/page/format.js";

const SHOWN = "flatcloth-source-states";

export class PixelStates {
  /** @param {() => void} changed called when a legend has come */
  constructor(changed) {
    this.changed = changed;
    this.shown = localStorage.getItem(SHOWN) === "yes";
    this.asked = ""; // the address of the legend that was asked for
    this.legend = null; // what the server says, of that address
  }

  toggle() {
    this.shown = !this.shown;
    localStorage.setItem(SHOWN, this.shown ? "yes" : "no");
  }

  /** The address of the layer of a view for a revision of the shape; null if it is not shown. */
  addressOf(view, revision) {
    return this.shown && revision ? `/source/${view}/states-${revision}.png` : null;
  }

  /** Show the shares of a view below its image. */
  show(element, view, revision) {
    const address = this.addressOf(view, revision)?.replace(".png", ".json") ?? "";
    element.hidden = !address;
    if (!address) return;
    if (this.asked !== address) this.load(address);
    rebuild(element, [address, this.legend], () => (this.legend ?? []).map(row));
  }

  async load(address) {
    this.asked = address;
    this.legend = null;
    const answer = await fetch(address).catch(() => null);
    if (this.asked !== address) return;
    if (!answer) this.asked = ""; // the connection was lost; asked again when it is shown again
    if (!answer?.ok) return;
    this.legend = await answer.json();
    this.changed();
  }
}

function row({ state, text, color, share, missing }) {
  const tip =
    `${number(100 * share, 1)} % of the item's pixels; ` +
    `${number(100 * missing, 1)} % show cloth that is in the result from no view`;
  const swatch = make("i", { class: "swatch" });
  swatch.style.background = color ?? "transparent";
  return make("p", { data: { state, tip } }, swatch, `${number(100 * share, 0)} % ${text}`);
}
