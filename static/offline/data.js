// The data of the exported page, unpacked from the page itself; nothing is loaded.

import { boxOf } from "/static/canvas/geometry.js";
import { lengthsOf, partsOf, valuesOf } from "/static/offline/parcel.js";

/**
 * Unpack the page's own data: `history` (texts and numbers), its arrays and its pictures.
 * @returns {Promise<OfflineData>}
 */
export async function unpack(/** @type {string} */ historyText, /** @type {string} */ packedText) {
  /** @type {OfflineHistory} */
  const history = JSON.parse(historyText);
  const packed = Uint8Array.from(atob(packedText.trim()), (c) => c.charCodeAt(0));
  const unzipped = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = new Uint8Array(await new Response(unzipped).arrayBuffer());
  const end = 8 + lengthsOf(bytes)[0];
  /** @type {Record<string, any>} */
  const arrays = partsOf(valuesOf(bytes.subarray(8, end)).parts, bytes.subarray(end));
  /** @type {OfflineData["layers"]} */
  const layers = {};
  for (const layer of history.layers) {
    layers[layer.name] = { ...layer, pixels: await pixelsOf(arrays[`layer ${layer.name}`]) };
  }
  return { history, layers, cloth: new Cloth(history, arrays), around: aroundOf(history, arrays) };
}

async function pixelsOf(/** @type {Blob} */ png) {
  // Colors are data here: alpha must not change them.
  const image = await createImageBitmap(png, { premultiplyAlpha: "none", colorSpaceConversion: "none" });
  const context = new OffscreenCanvas(image.width, image.height).getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, image.width, image.height).data;
}

/**
 * The pixels of the flattened cloth, each with its point in space. Pixel n of the cloth is pixel `at[n]` of
 * the grid.
 */
export class Cloth {
  constructor(/** @type {OfflineHistory} */ history, /** @type {Record<string, any>} */ arrays) {
    this.grid = history.grid;
    this.box = boxOf(history.grid);
    this.firstOfGrid = arrays.first;
    this.at = new Uint32Array(history.count);
    let n = 0;
    for (let i = 0; i < arrays.first.length; i++) if (arrays.first[i] >= 0) this.at[n++] = i;
    this.numberOfGrid = new Int32Array(arrays.first.length).fill(-1);
    this.at.forEach((i, k) => (this.numberOfGrid[i] = k));
    this.first = Float32Array.from(this.at, (i) => arrays.first[i]);
    this.source = Int16Array.from(this.at, (i) => arrays.source[i]);
    this.xyz = metres(arrays.xyz, history.bounds);
    this.normals = Float32Array.from(arrays.normal, (x) => x / 127);
    this.zAngles = arrays.z_angle;
    this.sourceRc = arrays.source_rc;
    this.views = history.steps.map((s) => s.view_index);
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
  normal = (/** @type {number} */ n) => unit([...this.normals.subarray(3 * n, 3 * n + 3)]);

  /**
   * The pixel of cloth at a place of the plane that is there after a step; -1 if there is none.
   * @param {number} u @param {number} v @param {number} step
   */
  pixelAt(u, v, step) {
    const {
      rows,
      cols,
      pixel_size_m: d,
      origin_uv_m: [u0, v0],
    } = this.grid;
    const col = Math.round((u - u0) / d);
    const row = Math.round((v - v0) / d);
    if (row < 0 || col < 0 || row >= rows || col >= cols) return -1;
    const n = this.numberOfGrid[row * cols + col];
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
function aroundOf(/** @type {OfflineHistory} */ history, /** @type {Record<string, any>} */ arrays) {
  const xyz = metres(arrays.around_xyz, history.bounds);
  return history.around.map(({ start, count }) => ({
    xyz: xyz.subarray(3 * start, 3 * (start + count)),
    rgb: arrays.around_rgb.subarray(3 * start, 3 * (start + count)),
  }));
}

function metres(/** @type {Numbers} */ values, /** @type {{ low: Numbers; step: number }} */ { low, step }) {
  const out = new Float32Array(values.length);
  for (let i = 0; i < values.length; i++) out[i] = low[i % 3] + step * values[i];
  return out;
}

const unit = (/** @type {number[]} */ v) => v.map((x) => x / (Math.hypot(...v) || 1));
