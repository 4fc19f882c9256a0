// A pick in words and numbers, on the page and on the exported one.

import { make } from "../page/dom.js";
import { mm, number } from "../page/format.js";

/** @type {Record<string, string>} */
export const AXIS_FROM = { outline: "along the outline", hand: "by hand", level: "level: no outline nearby" };

/** Where a pick was measured. @returns {ValueRow} */
export const sourceRow = (/** @type {{ view_index: number; source_rc: (number | null)[] }} */ pick) => [
  "Source",
  `view ${pick.view_index} @ ${pick.source_rc.map((x) => number(x)).join(", ")}`,
  "View and image pixel (row, column) it was measured in",
];

export const stdMm = (/** @type {number | null} */ metres) =>
  metres !== null && metres < 1e-4 ? "< 0.1 mm" : mm(metres === null ? null : 1000 * metres);

/** Copy a text; whether the browser allowed it. */
export async function copyText(/** @type {string} */ text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    // Without https or permission there is only the old way.
    const area = make("textarea.unseen", { readonly: true }, text);
    document.body.append(area);
    area.select();
    const done = document.execCommand("copy");
    area.remove();
    return done;
  }
}

const fixed = (/** @type {(number | null)[]} */ numbers, digits = 5) =>
  numbers.map((x) => (x === null ? "nan" : x.toFixed(digits))).join(" ");

/** The numbers of a pick to copy; an offline page has fewer. @param {TextPick} pick */
export function pickText(pick) {
  const { position_camera_m: camera, normal_camera, miss_m, grip } = pick;
  return [
    `name\t${pick.name}`,
    `position_held_m\t${fixed(pick.position_held_m)}`,
    camera && `position_camera_m\t${fixed(camera)}\t(rotation ${pick.angle_deg} deg)`,
    `normal_held\t${fixed(pick.normal_held)}`,
    normal_camera && `normal_camera\t${fixed(normal_camera)}`,
    `view\t${pick.view_index}`,
    `source_row_col\t${fixed(pick.source_rc, 2)}`,
    miss_m !== undefined && `miss_m\t${miss_m.toFixed(5)}`,
    grip && `approach_held\t${fixed(grip.approach_held)}`,
    grip && `axis_held\t${fixed(grip.axis_held)}\t(${AXIS_FROM[grip.axis_from]})`,
    grip && `opening_m\t${grip.opening_m.toFixed(4)}`,
  ]
    .filter(Boolean)
    .join("\n");
}
