// What is marked on the flattened view: the current pick with its gripper.

import { traceCross } from "./pen.js";

/** @param {FlatCanvas} canvas @param {{ uv_m: UV; grip?: CurrentPick["grip"] }} pick */
export function drawPick({ pen, transform }, { uv_m, grip }) {
  const middle = pen.at(uv_m);
  const { x, y } = middle;
  pen.rimmed("--pick", 2, (to) => {
    to.arc(x, y, 9, 0, 2 * Math.PI);
    traceCross(to, middle, 5, 14);
  });
  if (!grip?.axis_uv) return;
  // The gripper's axis is a line through the pick, its fingers are bars on both sides of it.
  const along = transform.toPaneVector(...grip.axis_uv);
  const [du, dv] = [along.x / transform.scale, along.y / transform.scale];
  const half = (grip.opening_m / 2) * transform.scale;
  pen.rimmed("--pick", 2.5, (to) => {
    for (const side of [-1, 1]) {
      to.moveTo(x + 15 * side * du, y + 15 * side * dv);
      to.lineTo(x + 30 * side * du, y + 30 * side * dv);
      const [fx, fy] = [x - side * half * dv, y + side * half * du];
      to.moveTo(fx - 8 * du, fy - 8 * dv);
      to.lineTo(fx + 8 * du, fy + 8 * dv);
    }
  });
}
