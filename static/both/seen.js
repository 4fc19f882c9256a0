// What a tab sees: the state of the server, or, turned over, that of the other side of the item.

/** A place seen from the other side: the planes of both sides are mirrors of one another. @returns {UV} */
export const mirrored = (/** @type {UV} */ [u, v]) => [-u, v];

/**
 * The state with the layers of the shown side. No proposal lies on the other side; the garment is mirrored.
 * @param {State} state @param {SideName} side
 * @returns {State}
 */
export function seen(state, side) {
  const { other, garment } = state;
  if (side === "this" || !other?.layers) return state;
  return {
    ...state,
    layers: other.layers,
    pending: null,
    garment: garment && { ...garment, found: other.is_related ? turned(garment.found) : null },
  };
}

/** A garment as seen from the other side. What is decided about its parts is decided on this one. */
export function turned(/** @type {FoundGarment | null} */ found) {
  return (
    found && {
      ...found,
      outline_uv_m: found.outline_uv_m.map(mirrored),
      points: found.points.map((point) => ({ ...point, uv_m: mirrored(point.uv_m) })),
      upright_rad: -found.upright_rad,
    }
  );
}
