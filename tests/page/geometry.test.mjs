import assert from "node:assert/strict";
import test from "node:test";

import { boxOf, contains, cornersOf, grown, rimOf, Transform, union } from "../../static/canvas/geometry.js";

const near = (a, b, within = 1e-9) => assert.ok(Math.abs(a - b) < within, `${a} is not ${b}`);
const same = (a, b) => Object.keys(b).forEach((key) => near(a[key], b[key]));

function turned(angle) {
  const at = new Transform();
  at.zoom(0.7, 10, 20);
  at.pan(31, -12);
  at.turn(angle, 100, 50);
  return at;
}

test("from the plane to the pane and back is the same place, turned or not", () => {
  for (const angle of [0, 0.3, Math.PI / 2, 4]) {
    const at = turned(angle);
    const { x, y } = at.toPane(0.123, -0.45);
    same(at.toPlane(x, y), { u: 0.123, v: -0.45 });
  }
});

test("a quarter turn clockwise takes right to down", () => {
  const at = new Transform();
  at.turn(Math.PI / 2, 0, 0);
  same(at.toPaneVector(1, 0), { x: 0, y: 1000 });
});

test("zooming and turning keep what is under the pointer", () => {
  const at = turned(0.4);
  const before = at.toPlane(200, 90);
  at.zoom(3, 200, 90);
  same(at.toPlane(200, 90), before);
  at.turn(1.1, 200, 90);
  same(at.toPlane(200, 90), before);
});

test("the zoom ends at 50 px and at 200 000 px a metre", () => {
  const at = new Transform();
  at.zoom(1e-6, 0, 0);
  near(at.scale, 50);
  at.zoom(1e9, 0, 0);
  near(at.scale, 200000);
});

test("a box fits the pane with its margin, and its middle lies in the middle", () => {
  const box = { left: -0.2, right: 0.6, top: 0.1, bottom: 0.5 };
  for (const angle of [0, 0.5, Math.PI / 2]) {
    const at = new Transform();
    at.turn(angle, 0, 0);
    at.fit(cornersOf(box), 500, 400, 30);
    same(at.toPane(0.2, 0.3), { x: 250, y: 200 });
    const corners = [box.left, box.right].flatMap((u) => [box.top, box.bottom].map((v) => at.toPane(u, v)));
    const margins = corners.flatMap(({ x, y }) => [x, 500 - x, y, 400 - y]);
    near(Math.min(...margins), 30, 1e-6);
  }
});

test("a raster covers half a pixel more than the centres of its pixels", () => {
  const box = boxOf({ origin_uv_m: [1, 2], pixel_size_m: 0.5, cols: 4, rows: 2 });
  same(box, { left: 0.75, top: 1.75, right: 2.75, bottom: 2.75 });
});

test("the union of boxes holds both", () => {
  const a = { left: 0, top: 0, right: 1, bottom: 1 };
  const b = { left: -1, top: 0.5, right: 0.5, bottom: 3 };
  const both = union(a, b);
  assert.deepEqual(both, { left: -1, top: 0, right: 1, bottom: 3 });
  assert.ok(contains(both, a) && contains(both, b) && !contains(a, both));
  assert.ok(contains(grown(a, 0.1), a) && !contains(a, grown(a, 0.1)));
});

test("a turned raster fills the pane with its opaque pixels, not with its corners", () => {
  const grid = { rows: 41, cols: 41, origin_uv_m: [-0.2, -0.2], pixel_size_m: 0.01 };
  const pixels = new Uint8ClampedArray(4 * 41 * 41);
  for (let i = 0; i < 41; i++) pixels[4 * (20 * 41 + i) + 3] = pixels[4 * (41 * i + 20) + 3] = 255; // a cross
  const at = new Transform();
  at.turn(Math.PI / 4, 0, 0);
  at.fit(rimOf(grid, pixels), 500, 500, 50);
  const [right] = [[0.2, 0]].map(([u, v]) => at.toPane(u, v));
  same(right, { x: 450, y: 450 });
});
