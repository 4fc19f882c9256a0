// A picture with its halvings, so that drawing it small costs what is seen of it and not what it holds.

const SMALLEST_PX = 256;

export class Pyramid {
  /** `image` is drawn as it is until its halvings are made, which takes a moment beside. */
  constructor(/** @type {Drawable} */ image) {
    this.levels = [image];
    this.ready = this.halve();
  }

  async halve() {
    for (;;) {
      const last = this.levels[this.levels.length - 1];
      const [width, height] = [last.width >> 1, last.height >> 1];
      if (Math.min(width, height) < 1 || Math.max(width, height) < SMALLEST_PX) return;
      try {
        this.levels.push(
          await createImageBitmap(last, { resizeWidth: width, resizeHeight: height, resizeQuality: "medium" }),
        );
      } catch {
        return; // it was closed meanwhile; what is there can be drawn
      }
    }
  }

  /** The level of which one to two pixels fall on a pixel of the screen; `scale` is screen pixels to a pixel. */
  at(/** @type {number} */ scale) {
    const level = Math.floor(Math.log2(1 / Math.min(1, scale)) + 1e-9);
    return this.levels[Math.min(level, this.levels.length - 1)];
  }
}
