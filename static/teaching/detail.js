// A pane with all of a picture, and one with a part of it larger.

import { number } from "../page/format.js";
import { columns } from "./draw.js";

const DETAIL = 3.2; // how much larger the detail is drawn, at least

/** @param {Drawable} image */
export const imageBox = (image) => ({ left: -0.5, top: -0.5, right: image.width - 0.5, bottom: image.height - 0.5 });

/** Width share of a pane that shows a box at the full height of the sheet. */
export function shareOf(/** @type {Box} */ box, /** @type {Rect} */ rect, least = 0.22, most = 0.5) {
  const wide = (rect.h * (box.right - box.left)) / (box.bottom - box.top);
  return Math.min(most, Math.max(least, (1.08 * wide) / rect.w));
}

/**
 * A pane with all of it, and one with a part of it larger; `draw(map, size)` draws either.
 * @param {Sheet} sheet @param {Rect} rect @param {string} key @param {string} title @param {Box} box
 * @param {Ui} ui @param {(map: PaneMap, size: number) => void} draw
 */
export function withDetail(sheet, rect, key, title, box, ui, draw) {
  const share = shareOf(box, rect);
  const [left, right] = columns(rect, [share, 1 - share]);
  const whole = sheet.pane(key, box, sheet.titled(left, title));
  const scale = Math.max(DETAIL, right.w / (whole.scaleX * (box.right - box.left)));
  const inner = sheet.titled(right, "Detail", `${number(scale, 1)} times as large; move the pointer over the left`);
  const half = [inner.w / (2 * scale * whole.scaleX), inner.h / (2 * scale * whole.scaleY)];
  const at = [held(box.left, box.right, half[0], ui.at[0]), held(box.top, box.bottom, half[1], ui.at[1])];
  const part = { left: at[0] - half[0], right: at[0] + half[0], top: at[1] - half[1], bottom: at[1] + half[1] };
  const detail = sheet.pane("detail", part, inner, { margin: 0 });
  const show = (/** @type {PaneMap} */ map, /** @type {number} */ size) => {
    sheet.within(map.rect, () => draw(map, size));
    sheet.frame(map.rect);
  };
  show(whole, 1);
  show(detail, scale);
  const [x0, y0] = whole.at(part.left, part.top);
  const [x1, y1] = whole.at(part.right, part.bottom);
  sheet.within(whole.rect, () => sheet.frame({ x: x0, y: y0, w: x1 - x0, h: y1 - y0 }, sheet.color.text));
}

/**
 * The known pixel of a grid that is nearest to its middle: its place, where a probe begins.
 * @param {Grid} parts @param {(i: number) => boolean} known
 * @returns {UV}
 */
export function middleOf({ rows: down, cols, origin_uv_m: origin, pixel_size_m: size }, known) {
  let best = { far: Infinity, row: 0, col: 0 };
  for (let i = 0; i < down * cols; i++) {
    if (!known(i)) continue;
    const [row, col] = [Math.floor(i / cols), i % cols];
    const far = Math.hypot(row - down / 2, col - cols / 2);
    if (far < best.far) best = { far, row, col };
  }
  return [origin[0] + size * best.col, origin[1] + size * best.row];
}

/**
 * The middle of a part that stays within the whole.
 * @param {number} low @param {number} high @param {number} half @param {number} at
 */
const held = (low, high, half, at) =>
  2 * half >= high - low ? (low + high) / 2 : Math.max(low + half, Math.min(high - half, at));

/**
 * @param {Sheet} sheet @param {Rect} rect @param {Lesson} lesson @param {Ui} ui
 * @param {(map: PaneMap, size: number) => void} draw
 */
export function onImage(sheet, rect, lesson, ui, draw) {
  const image = lesson.picture.image;
  const box = imageBox(image);
  withDetail(sheet, rect, "image", `Image of view ${lesson.view_index}`, box, ui, (map, size) => {
    sheet.picture(map, image, box, 0.5);
    draw(map, size);
  });
}
