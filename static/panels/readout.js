// The values under the pointer, and the legend of the layer that is shown.

import { byId, make, rebuild, setText, swatch } from "../page/dom.js";
import { degrees, number, vector } from "../page/format.js";

/** @type {[string, string, (values: PixelValues) => string][]} */
const READOUT = [
  ["Pixel", "row, column", (a) => `${a.rc[0]}, ${a.rc[1]}`],
  ["u, v", "mm on the plane", (a) => `${vector(a.uv_mm)} mm`],
  ["Color", "red, green, blue", (a) => `${a.rgb.join(" ")}`],
  [
    "Source",
    "view @ its pixel (row, column)",
    (a) => `${a.view_index} @ ${a.source_rc.map((x) => number(x)).join(", ")}`,
  ],
  ["x y z", "mm, object frame", (a) => `${vector(a.xyz_mm)} mm`],
  ["Height z", "mm along the axis", (a) => `${number(a.height_mm)} mm`],
  ["Normal", "outward, object frame", (a) => vector(a.normal, 3)],
  ["Z-angle", "deg", (a) => degrees(a.z_angle_deg)],
  [
    "Place ±",
    "mm on the plane: one standard deviation of where this pixel lies, relative to the start view's main piece",
    (a) =>
      `${number(a.placement_std_mm)} mm${a.error_mm === null ? "" : `; ${number(a.error_mm)} mm off, by the kit`}`,
  ],
  [
    "Quality",
    "image pixels per cm² of cloth, angle between line of sight and normal, change of length by the flattening",
    (a) =>
      `${number(a.density_px_cm2, 0)} px/cm² · ${degrees(a.incidence_deg, 0)} incidence · ` +
      `${number(a.stretch === null ? null : 100 * a.stretch)} % stretch`,
  ],
];

export class Readout {
  hovered(/** @type {HoverAnswer | null} */ answer) {
    const list = byId("readout");
    const values = answer?.shape ?? answer?.proposal ?? null;
    list.classList.toggle("of-proposal", Boolean(!answer?.shape && answer?.proposal));
    showReadout(READOUT.map(([name, about, text]) => [name, about, values ? text(values) : "–"]));
    list.style.setProperty("--swatch", values ? `rgb(${values.rgb.join(" ")})` : "transparent");
  }
}

/** Show values under the pointer: name, what it is, text. */
export function showReadout(/** @type {[string, string, string][]} */ rows) {
  const list = byId("readout");
  if (!list.childElementCount)
    list.append(
      ...rows.map(([name, about]) => make("div", make("dt", { tip: `${name}: ${about}` }, name), make("dd"))),
    );
  list.classList.toggle(
    "idle",
    rows.every(([, , text]) => text === "–"),
  );
  rows.forEach(([, , text], i) => setText(list.children[i].children[1], text));
}

export function showLegend(/** @type {Legend | null | undefined} */ legend) {
  const box = byId("legend");
  box.hidden = !legend || legend.kind === "none";
  if (!legend || box.hidden) return;
  rebuild(box, legend, () => {
    if (legend.kind === "classes") {
      return [make("h3", legend.title), ...legend.classes.map((c) => make("p", swatch(c.color), c.label))];
    }
    const ramp = make("i.ramp", { style: { background: `linear-gradient(to top, ${legend.colors.join(", ")})` } });
    const middle = (legend.low + legend.high) / 2;
    return [
      make("h3", legend.title),
      make(
        "div.scale",
        ramp,
        make("div", ...[legend.high, middle, legend.low].map((x) => make("span", number(x, 0)))),
      ),
    ];
  });
}
