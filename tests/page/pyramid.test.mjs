import assert from "node:assert/strict";
import test from "node:test";

import { Pyramid } from "../../static/canvas/pyramid.js";

globalThis.createImageBitmap = async (_, { resizeWidth, resizeHeight }) => ({
  width: resizeWidth,
  height: resizeHeight,
});

async function pyramid(width, height) {
  const made = new Pyramid({ width, height });
  await made.ready;
  return made;
}

test("a picture is halved until its longer side would be below 256 px", async () => {
  const { levels } = await pyramid(2048, 1000);
  assert.deepEqual(
    levels.map((l) => l.width),
    [2048, 1024, 512, 256],
  );
  assert.deepEqual((await pyramid(300, 200)).levels.length, 1);
  assert.deepEqual((await pyramid(4096, 3)).levels.at(-1), { width: 2048, height: 1 });
});

test("of the level that is drawn, one to two pixels fall on a pixel of the screen", async () => {
  const made = await pyramid(4096, 4096);
  for (const scale of [4, 1, 0.9, 0.5, 0.3, 0.25, 0.13]) {
    const perPixel = made.at(scale).width / 4096 / Math.min(1, scale);
    assert.ok(perPixel >= 1 - 1e-9 && perPixel < 2, `${scale}: ${perPixel}`);
  }
  assert.equal(made.at(1e-6).width, 256);
});

test("until the halvings are made, and where they cannot be, the picture itself is drawn", async () => {
  const image = { width: 2048, height: 2048 };
  const made = new Pyramid(image);
  assert.equal(made.at(0.1), image);
  await made.ready;
  globalThis.createImageBitmap = async () => {
    throw new Error("closed");
  };
  assert.equal((await pyramid(2048, 2048)).levels.length, 1);
});
