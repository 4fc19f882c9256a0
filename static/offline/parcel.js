// A parcel: JSON with arrays and pictures, as flatcloth/core/parcel.py packs it.

/** @type {Record<string, new (data: ArrayBuffer) => any>} */
const ARRAYS = {
  int8: Int8Array,
  uint8: Uint8Array,
  int16: Int16Array,
  uint16: Uint16Array,
  int32: Int32Array,
  float32: Float32Array,
};

/** The lengths of the JSON and of the body, which a parcel begins with (8 bytes). */
export function lengthsOf(/** @type {Uint8Array} */ bytes) {
  const head = new DataView(bytes.buffer, bytes.byteOffset, 8);
  return [head.getUint32(0, true), head.getUint32(4, true)];
}

/** The JSON of a parcel. */
export function valuesOf(/** @type {Uint8Array} */ bytes) {
  return JSON.parse(new TextDecoder().decode(bytes));
}

/**
 * The parts of a body by name: typed arrays, and pictures as Blobs.
 *
 * @param {Record<string, { kind: string; at: number; bytes: number }>} parts @param {Uint8Array<ArrayBuffer>} body
 * @returns {Record<string, any>}
 */
export function partsOf(parts, body) {
  return Object.fromEntries(
    Object.entries(parts).map(([name, { kind, at, bytes }]) => {
      const data = body.slice(at, at + bytes);
      return [name, kind === "png" ? new Blob([data], { type: "image/png" }) : new ARRAYS[kind](data.buffer)];
    }),
  );
}
