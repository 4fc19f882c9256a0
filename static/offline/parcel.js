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

/**
 * The parts of a body by name: typed arrays, and pictures.
 *
 * @param {Record<string, { kind: string; at: number; bytes: number }>} parts @param {Uint8Array<ArrayBuffer>} body
 */
function partsOf(parts, body) {
  /** @type {Parts} */
  const made = { arrays: {}, pictures: {} };
  for (const [name, { kind, at, bytes }] of Object.entries(parts)) {
    const data = body.slice(at, at + bytes);
    if (PICTURES.includes(kind)) made.pictures[name] = new Blob([data], { type: `image/${kind}` });
    else made.arrays[name] = new ARRAYS[/** @type {keyof typeof ARRAYS} */ (kind)](data.buffer);
  }
  return made;
}

/** The JSON of a parcel, and its parts; it begins with the length of the JSON. */
export function opened(/** @type {Uint8Array<ArrayBuffer>} */ bytes) {
  const end = 8 + new DataView(bytes.buffer, bytes.byteOffset, 8).getUint32(0, true);
  const values = JSON.parse(new TextDecoder().decode(bytes.subarray(8, end)));
  return { values, ...partsOf(values.parts, bytes.subarray(end)) };
}
