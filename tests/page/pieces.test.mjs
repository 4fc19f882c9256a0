import assert from "node:assert/strict";
import test from "node:test";
import { drawPieces } from "../../static/canvas/pieces.js";

function drawn(pieces) {
  const plates = [];
  const pen = {
    at: ([u, v]) => ({ x: 1000 * u, y: 1000 * v }),
    line: () => {},
    fill: () => {},
    widthOf: () => 70,
    label: (_, { x, y }, { width, height }) => plates.push({ x, y: y - height / 2, w: width, h: height }),
  };
  drawPieces({ width: 400, height: 600, pen }, pieces, null);
  return plates;
}

const piece = (label, u, v) => ({
  label,
  area_cm2: 12,
  color: "#123456",
  placed: false,
  grid: { rows: 10, cols: 10, pixel_size_m: 0.001, origin_uv_m: [u, v] },
});

const overlap = (a, b) => a.x < b.x + b.w && b.x < a.x + a.w && a.y < b.y + b.h && b.y < a.y + a.h;

test("the names of pieces that lie close together do not cover one another", () => {
  const plates = drawn([piece("B", 0.1, 0.1), piece("C", 0.105, 0.102), piece("D", 0.11, 0.108)]);
  assert.equal(plates.length, 3);
  for (const [i, a] of plates.entries())
    for (const b of plates.slice(i + 1)) assert.ok(!overlap(a, b), JSON.stringify([a, b]));
});

test("a name that covers no other stays above its piece", () => {
  const [plate] = drawn([piece("B", 0.1, 0.2)]);
  assert.ok(plate.y + plate.h <= 200 && plate.y > 170);
});
