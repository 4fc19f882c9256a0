// The data of the exported page, unpacked from the page itself; nothing is loaded.

import { boxOf, dot, pixelAt, unit } from "../canvas/geometry.js";
import { contextOf } from "../page/dom.js";
import { opened } from "./parcel.js";

const OTHER = "other "; // before the names of the other side's data

/**
 * Unpack the page's own data: `history` (texts and numbers), its arrays and its pictures.
 * @returns {Promise<OfflineData>}
 */
export async function unpack(/** @type {string} */ historyText, /** @type {string} */ packedText) {
  /** @type {OfflineHistory} */
  const history = JSON.parse(historyText);
  const packed = Uint8Array.from(atob(packedText.trim()), (c) => c.charCodeAt(0));
  const unzipped = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const arrays = opened(new Uint8Array(await new Response(unzipped).arrayBuffer()));
  const steps = history.steps.map((step) => step.view_index);
  const own = { layers: await layersOf(history, arrays), cloth: new Cloth(history, history, arrays, steps) };
  const { other } = history;
  const behind = other && {
    layers: await layersOf(other, arrays, OTHER),
    // All of it is there from the first step on, and its sources are views.
    cloth: new Cloth(other, history, arrays, [...history.recording.angles_deg.keys()], OTHER),
  };
  return { history, ...own, other: behind, around: aroundOf(history, arrays) };
}

/** @param {{ layers: OfflineLayer[] }} side @param {Parts} parts */
async function layersOf({ layers }, { pictures }, prefix = "") {
  const made = /** @type {OfflineData["layers"]} */ ({});
  for (const layer of layers)
    made[layer.name] = { ...layer, pixels: await pixelsOf(pictures[`${prefix}layer ${layer.name}`]) };
  return made;
}

async function pixelsOf(/** @type {Blob} */ png) {
  // Colors are data here: alpha must not change them.
  const image = await createImageBitmap(png, { premultiplyAlpha: "none", colorSpaceConversion: "none" });
  const context = contextOf(new OffscreenCanvas(image.width, image.height), { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, image.width, image.height).data;
}

/**
 * The pixels of the flattened cloth, each with its point in space. Pixel n of the cloth is pixel `at[n]` of
 * the grid.
 */
export class Cloth {
  /**
   * @param {OfflineSide} side @param {OfflineHistory} history @param {Parts} parts
   * @param {number[]} views that the sources of the pixels number
   */
  constructor(side, { bounds, axis, recording }, { arrays }, views, prefix = "") {
    const [first, source] = [arrays[`${prefix}first`], arrays[`${prefix}source`]];
    this.grid = side.grid;
    this.box = boxOf(side.grid);
    this.at = new Uint32Array(side.count);
    let n = 0;
    for (let i = 0; i < first.length; i++) if (first[i] >= 0) this.at[n++] = i;
    this.numberOfGrid = new Int32Array(first.length).fill(-1);
    this.at.forEach((i, k) => (this.numberOfGrid[i] = k));
    this.first = Float32Array.from(this.at, (i) => first[i]);
    this.source = Int16Array.from(this.at, (i) => source[i]);
    this.xyz = metres(summed(arrays[`${prefix}xyz`], 3), bounds);
    this.normals = summed(arrays[`${prefix}normal`], 3);
    this.sourceRc = summed(arrays[`${prefix}source_rc`], 2);
    this.views = views;
    this.anglesDeg = recording.angles_deg;
    this.across = axis.across;
  }

  get count() {
    return this.at.length;
  }

  /** @returns {{ rc: UV; uv: UV }} */
  place(/** @type {number} */ n) {
    const i = this.at[n];
    const d = this.grid.pixel_size_m;
    const [row, col] = [Math.floor(i / this.grid.cols), i % this.grid.cols];
    const [top, left] = this.grid.corner_rc; // the page holds the part of the grid that has cloth
    return {
      rc: [top + row, left + col],
      uv: [this.grid.origin_uv_m[0] + d * col, this.grid.origin_uv_m[1] + d * row],
    };
  }

  /** @type {(n: number) => XYZ} */
  point = (n) => [this.xyz[3 * n], this.xyz[3 * n + 1], this.xyz[3 * n + 2]];

  normal(/** @type {number} */ n) {
    return unit([...this.normals.subarray(3 * n, 3 * n + 3)]);
  }

  /** The Z-angle at which a pixel was seen, in degrees. */
  zAngle(/** @type {number} */ n) {
    const normal = this.normal(n);
    const [right, camera] = this.across.map((axis) => dot(axis, normal));
    const angle = (Math.atan2(right, camera) * 180) / Math.PI + this.anglesDeg[this.view(n)];
    return angle - 360 * Math.ceil((angle - 180) / 360);
  }

  /** The view that a pixel is from. */
  view = (/** @type {number} */ n) => this.views[this.source[n]];

  /**
   * The pixel of cloth at a place of the plane that is there after a step; -1 if there is none.
   * @param {number} u @param {number} v @param {number} step
   */
  pixelAt(u, v, step) {
    const at = pixelAt(this.grid, u, v);
    const n = at < 0 ? -1 : this.numberOfGrid[at];
    return n >= 0 && this.first[n] <= step ? n : -1;
  }

  /**
   * The nearest pixel of cloth after a step, and its distance in metres of the plane.
   * @param {number} u @param {number} v @param {number} step
   */
  nearest(u, v, step) {
    const here = this.pixelAt(u, v, step);
    if (here >= 0) return { n: here, miss: 0 };
    let best = { n: -1, miss: Infinity };
    for (let n = 0; n < this.count; n++) {
      if (this.first[n] > step) continue;
      const { uv } = this.place(n);
      const miss = Math.hypot(uv[0] - u, uv[1] - v);
      if (miss < best.miss) best = { n, miss };
    }
    return best;
  }
}

/** What each view saw of the whole item, thinned: [{xyz, rgb}] by step. */
function aroundOf(/** @type {OfflineHistory} */ history, /** @type {Parts} */ arrays) {
  const xyz = metres(summed(arrays.arrays.around_xyz, 3), history.bounds);
  const rgb = Uint8Array.from(summed(arrays.arrays.around_rgb, 3));
  return history.around.map(({ start, count }) => ({
    xyz: xyz.subarray(3 * start, 3 * (start + count)),
    rgb: rgb.subarray(3 * start, 3 * (start + count)),
  }));
}

/**
 * Restore rows of `channels` numbers from the differences between them, which come one channel after the other.
 * @template {NumberArray} T
 * @param {T} differences @param {number} channels
 * @returns {T}
 */
function summed(differences, channels) {
  const count = differences.length / channels;
  const out = differences.slice();
  for (let channel = 0; channel < channels; channel++) {
    let at = channel;
    for (let n = 0; n < count; n++, at += channels) {
      // An array of this type wraps around at its limits, as the differences did.
      out[at] = differences[channel * count + n] + (n ? out[at - channels] : 0);
    }
  }
  return /** @type {T} */ (out);
}

function metres(/** @type {Numbers} */ values, /** @type {{ low: Numbers; step: number }} */ { low, step }) {
  const out = new Float32Array(values.length);
  for (let i = 0; i < values.length; i++) out[i] = low[i % 3] + step * values[i];
  return out;
}
