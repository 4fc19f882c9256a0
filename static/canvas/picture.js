// The pictures of the flattened view: fetched by revision, the last one kept until the next is there.

import { boxOf, pixelAt, rimOf } from "./geometry.js";
import { askPicture } from "../page/connection.js";
import { contextOf, WAYS } from "../page/dom.js";
import { Pyramid } from "./pyramid.js";

const OUTLINE = "#2f8cff"; // of proposals: the accent, bright enough for any cloth

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
    const shape = !withOutline ? {} : { outline: anew ? new Pyramid(outlineOf(image)) : this.shown?.outline };
    this.shown = { address, revision, grid, box: boxOf(grid), image: new Pyramid(image), ...shape };
    this.onReady(anew);
  }

  /** Whether the picture is opaque at a place of the plane. */
  covers(/** @type {number} */ u, /** @type {number} */ v) {
    return this.colorAt(u, v)[3] > 0;
  }

  /** Places that the opaque part of the picture lies between. @returns {UV[]} */
  get rim() {
    const { shown } = this;
    return shown ? (shown.rim ??= rimOf(shown.grid, this.pixels)) : [];
  }

  get pixels() {
    const { shown } = this;
    if (!shown) return [];
    return (shown.pixels ??= pixelsOf(shown.image instanceof Pyramid ? shown.image.at(1) : shown.image));
  }

  /** Red, green, blue and opacity at a place of the plane; nothing beyond the picture. */
  colorAt = (/** @type {number} */ u, /** @type {number} */ v) => {
    const at = this.shown ? 4 * pixelAt(this.shown.grid, u, v) : -1;
    return at < 0 ? [] : this.pixels.slice(at, at + 4);
  };
}

/** The outermost pixels of a picture's opaque part, in a colour. */
export function outlineOf(/** @type {Drawable} */ image, color = OUTLINE) {
  const { width, height } = image;
  const [inner, outline] = [0, 1].map(() => contextOf(new OffscreenCanvas(width, height)));
  inner.drawImage(image, 0, 0);
  inner.globalCompositeOperation = "destination-in";
  for (const way of Object.values(WAYS)) inner.drawImage(image, ...way);
  outline.drawImage(image, 0, 0);
  outline.globalCompositeOperation = "source-in";
  outline.fillStyle = color;
  outline.fillRect(0, 0, width, height);
  outline.globalCompositeOperation = "destination-out";
  outline.drawImage(inner.canvas, 0, 0);
  return outline.canvas;
}

function pixelsOf(/** @type {Drawable} */ image) {
  const { width, height } = image;
  const context = contextOf(new OffscreenCanvas(width, height), { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, width, height).data;
}
