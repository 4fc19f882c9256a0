// The pictures of the flattened view: fetched by revision, the last one kept until the next is there.

import { boxOf, pixelAt } from "/static/canvas/geometry.js";
import { askPicture } from "/static/page/connection.js";
import { contextOf } from "/static/page/dom.js";
import { Pyramid } from "/static/canvas/pyramid.js";

const OUTLINE = [230, 126, 0];

/** One picture with its position on the plane; `onReady(anew)`: it is shown, `anew` if its revision is new. */
export class Picture {
  constructor(/** @type {(anew: boolean) => void} */ onReady) {
    this.onReady = onReady;
    this.wanted = /** @type {string | null} */ (null);
    this.shown = /** @type {Shown | null} */ (null);
  }

  clear() {
    this.wanted = null;
    if (this.shown === null) return;
    this.shown = null;
    this.onReady(true);
  }

  /**
   * Ask for a picture; nothing happens if it is the one that is shown or on its way.
   * @param {string} address @param {number} revision @param {Grid} grid @param {boolean} withOutline
   */
  async show(address, revision, grid, withOutline) {
    if (this.wanted === address) return;
    this.wanted = address;
    const image = await askPicture(address);
    if (this.wanted !== address) return;
    if (!image) return void (this.wanted = null); // the next state asks again
    const anew = this.shown?.revision !== revision;
    const shape = !withOutline
      ? {}
      : anew
        ? outlineOf(image)
        : { alpha: this.shown?.alpha, outline: this.shown?.outline };
    this.shown = { address, revision, grid, box: boxOf(grid), image: new Pyramid(image), ...shape };
    this.onReady(anew);
  }

  /** Whether the picture is opaque at a place of the plane. */
  covers(/** @type {number} */ u, /** @type {number} */ v) {
    return Boolean(this.shown?.alpha && this.shown.alpha[pixelAt(this.shown.grid, u, v)] > 0);
  }
}

function outlineOf(/** @type {ImageBitmap} */ image) {
  const { width, height } = image;
  const canvas = new OffscreenCanvas(width, height);
  const context = contextOf(canvas, { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  const data = context.getImageData(0, 0, width, height);
  const alpha = new Uint8Array(width * height);
  for (let i = 0; i < alpha.length; i++) alpha[i] = data.data[4 * i + 3];
  const pixels = new Uint32Array(data.data.buffer);
  pixels.fill(0);
  const [red, green, blue] = OUTLINE;
  const edge = new Uint32Array(new Uint8ClampedArray([red, green, blue, 255]).buffer)[0];
  for (let row = 0, i = 0; row < height; row++) {
    for (let col = 0; col < width; col++, i++) {
      if (!alpha[i]) continue;
      const rim = row === 0 || col === 0 || row === height - 1 || col === width - 1;
      if (rim || !alpha[i - 1] || !alpha[i + 1] || !alpha[i - width] || !alpha[i + width]) pixels[i] = edge;
    }
  }
  context.putImageData(data, 0, 0);
  return { alpha, outline: new Pyramid(canvas) };
}
