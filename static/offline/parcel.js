// A parcel: JSON with arrays and pictures, as flatcloth/core/parcel.py packs it.

const ARRAYS = {
  int8: Int8Array,
  uint8: Uint8Array,
  int16: Int16Array,
  uint16: Uint16Array,
  int32: Int32Array,
  float32: Float32Array,
};

const PICTURES = ["png", "webp"];

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
 * The parts of a body by name: typed arrays, and pictures.
 *
 * @param {Record<string, { kind: string; at: number; bytes: number }>} parts @param {Uint8Array<ArrayBuffer>} body
 */
export function partsOf(parts, body) {
  /** @type {Parts} */
  const made = { arrays: {}, pictures: {} };
  for (const [name, { kind, at, bytes }] of Object.entries(parts)) {
    const data = body.slice(at, at + bytes);
    if (PICTURES.includes(kind)) made.pictures[name] = new Blob([data], { type: `image/${kind}` });
    else made.arrays[name] = new ARRAYS[/** @type {keyof typeof ARRAYS} */ (kind)](data.buffer);
  }
  return made;
}

/** The JSON of a whole parcel, and its parts. */
export function opened(/** @type {Uint8Array<ArrayBuffer>} */ bytes) {
  const end = 8 + lengthsOf(bytes)[0];
  const values = valuesOf(bytes.subarray(8, end));
  return { values, ...partsOf(values.parts, bytes.subarray(end)) };
}
