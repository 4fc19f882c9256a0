// The garment beside the pictures of the exported page: kinds, named points, dimensions.

import { dimensions, pointButton, shares } from "../garment/lists.js";
import { percent } from "../page/format.js";
import { words } from "../garment/marks.js";
import { byId, make, rebuild } from "../page/dom.js";

export function showGarment(/** @type {OfflinePage} */ page) {
  const { text, found } = page.garment;
  rebuild(byId("garment"), ["garment", page.canvas.side], () => {
    const title = make("h2", "Garment");
    if (!found) return [title, make("p.nothing", text)];
    const [name, share] = found.probabilities[0];
    const { kind, by_hand, points, probabilities } = found;
    const kindText = by_hand && kind ? `${words(kind)}, set by hand.` : `${words(name)}, ${percent(share)}.`;
    return [
      title,
      make("p", kindText),
      shares(probabilities),
      kind && make("ul.named", { label: "Named points" }, ...points.map((p) => row(page, p))),
      kind && dimensions(found),
    ];
  });
}

function row(/** @type {OfflinePage} */ page, /** @type {GarmentPoint} */ point) {
  const pointAt = (/** @type {string | null} */ name) => {
    page.pointed = name;
    page.canvas.redraw();
  };
  const click = () => point.seen && page.canvas.side === "this" && page.pickAt(...point.uv_m);
  const button = pointButton(point, "", pointAt, { click });
  return make("li", { class: point.seen ? "seen" : "predicted" }, button);
}
