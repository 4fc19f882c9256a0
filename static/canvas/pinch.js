// Two fingers on an element: their distance zooms, their middle moves.

/** @typedef {{ x: number; y: number; gap: number }} Spread */

/**
 * While two fingers are down, the element hears nothing else of them.
 * @param {HTMLElement} element
 * @param {() => void} cancel end what the first finger began
 * @param {(factor: number, from: Spread, to: Spread) => void} pinch in CSS pixels of the window
 */
export function onPinch(element, cancel, pinch) {
  const fingers = /** @type {Map<number, PointerEvent>} */ (new Map());
  let pinching = false;

  /** @returns {Spread} */
  const spread = () => {
    const [a, b] = [...fingers.values()];
    const gap = Math.max(1, Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY));
    return { x: (a.clientX + b.clientX) / 2, y: (a.clientY + b.clientY) / 2, gap };
  };
  /** @param {string} type @param {(event: PointerEvent) => void} take */
  const listen = (type, take) =>
    element.addEventListener(
      type,
      (event) => {
        const pointer = /** @type {PointerEvent} */ (event);
        if (pointer.pointerType !== "touch") return;
        take(pointer);
        if (pinching) event.stopImmediatePropagation();
        if (!fingers.size) pinching = false; // the finger that stays longer draws nothing either
      },
      { capture: true },
    );
  const leave = (/** @type {PointerEvent} */ event) => fingers.delete(event.pointerId);

  listen("pointerdown", (event) => {
    fingers.set(event.pointerId, event);
    if (fingers.size !== 2) return;
    pinching = true;
    cancel();
  });
  listen("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    const from = fingers.size === 2 ? spread() : null;
    fingers.set(event.pointerId, event);
    if (!from) return;
    const to = spread();
    pinch(to.gap / from.gap, from, to);
  });
  listen("pointerup", leave);
  listen("pointercancel", leave);
}
