// The layers as a list: which are shown, how opaque, and their colour bars. The chosen layer lies at the
// bottom and colours the 3D scene as well; others that are shown lie over it, in the order of the list.

import { make, slider, tickBox } from "../page/dom.js";
import { number } from "../page/format.js";
import { Picture } from "./picture.js";

/** All of them; the table of actions has their titles, keys and descriptions. */
export const LAYERS = ["color", "height", "z_angle", "source", "stretch", "incidence", "density", "place", "truth"];

/** The action that chooses a layer. */
export const layerAction = (/** @type {string} */ layer) => `layer_${layer}`;

export class LayerList {
  /** `looking` keeps how each layer is looked at. */
  constructor(/** @type {Page} */ page, /** @type {Looking} */ looking) {
    this.page = page;
    this.looking = looking;
    this.pictures = /** @type {Map<string, Picture>} */ (new Map()); // of the layers that lie over the chosen one
    this.sentLook = ""; // what the 3D scene last got
  }

  /** The layers that lie over the chosen one, from the bottom. */
  get above() {
    return LAYERS.filter((name) => name !== this.page.layer && this.looking.of(name).shown);
  }

  update(/** @type {State} */ state) {
    this.tellScene(state);
    const above = state.layers && !state.capture ? this.above : [];
    for (const [name, picture] of this.pictures) {
      if (above.includes(name)) continue;
      picture.clear();
      this.pictures.delete(name);
    }
    const { layers } = state;
    if (!layers) return;
    for (const name of above) {
      const picture = this.pictures.get(name) ?? new Picture(() => this.page.canvas.redraw());
      this.pictures.set(name, picture);
      const query = this.looking.query(name);
      const address = `${this.page.canvas.folder}/${layers.revision}/${name}.png?${query}`;
      picture.show(address, layers.revision, layers, false);
    }
  }

  /** The 3D scene is one for all tabs, so each tells only what its operator has changed. */
  tellScene(/** @type {State} */ state) {
    if (state.mode !== "session") return;
    const { map, low, high } = this.looking.of(this.page.layer);
    const layer = /** @type {import("../page/messages").Look["layer"]} */ (this.page.layer);
    /** @type {import("../page/messages").Look} */
    const message = { type: "look", layer, map: map || null, low, high };
    const text = JSON.stringify(message);
    if (this.sentLook === text) return;
    const first = this.sentLook === "";
    this.sentLook = text;
    if (!first || this.page.layer !== "color") this.page.send(message);
  }

  paint(/** @type {FlatCanvas} */ canvas) {
    const { context } = canvas;
    const pale = context.globalAlpha;
    for (const name of this.above) {
      const shown = this.pictures.get(name)?.shown;
      if (!shown) continue;
      context.globalAlpha = pale * this.looking.of(name).opacity;
      canvas.drawPicture(shown, shown.image);
    }
    context.globalAlpha = pale;
  }

  // --- the list --------------------------------------------------------------------------------

  /** The rows; `legends` by layer. */
  build(/** @type {Record<string, Legend> | undefined} */ legends) {
    const known = LAYERS.filter((name) => name !== "truth" || legends?.truth.kind === "ramp");
    const rows = known.map((name) => this.row(name, legends?.[name]));
    return make("ul.layer-list", { label: "Layers" }, ...rows);
  }

  /** @param {string} name @param {Legend | undefined} legend */
  row(name, legend) {
    const chosen = name === this.page.layer;
    const { shown, opacity } = this.looking.of(name);
    const { title } = this.page.action(layerAction(name));
    const visible = chosen || shown;
    const set = (/** @type {Partial<LayerLook>} */ change) => this.looking.set(name, change);
    const why = chosen ? "The chosen layer is always shown" : null;
    const choose = {
      pressed: chosen,
      key: `layer-row-${name}`,
      tip: "Show this layer here, and color the 3D scene by it",
      click: () => this.page.run(layerAction(name)),
    };
    return make(
      "li",
      { class: chosen ? "chosen" : "" },
      tickBox(visible, (on) => set({ shown: on }), {
        label: `${title}: show it over the others`,
        disabled: why !== null,
        key: `layer-shown-${name}`,
        tip: why ?? "Show it over the others",
      }),
      make("button", choose, title),
      this.bar(name, legend, visible),
      visible &&
        slider([0, 1, 0.05], opacity, {
          label: `${title}: opacity`,
          key: `layer-opacity-${name}`,
          tip: "Opacity",
          input: (event) => this.looking.setQuietly(name, { opacity: event.target.valueAsNumber }),
          change: (event) => set({ opacity: event.target.valueAsNumber }),
        }),
    );
  }

  /**
   * The colours with the values at both ends, as the layer is looked at.
   * @param {string} name @param {Legend | undefined} legend @param {boolean} visible
   */
  bar(name, legend, visible) {
    const looked = visible ? this.looking.legend(name, legend) : null;
    if (looked?.kind !== "ramp") return make("span.bar-place");
    const background = `linear-gradient(to right, ${looked.colors.join(", ")})`;
    const digits = looked.high - looked.low < 10 ? 1 : 0;
    return make(
      "span.bar-place",
      { tip: looked.title },
      make("span", number(looked.low, digits)),
      make("i.color-bar", { style: { background } }),
      make("span", number(looked.high, digits)),
    );
  }
}
