// How windows are shared among panes.

import assert from "node:assert/strict";
import test from "node:test";

globalThis.matchMedia = () => new EventTarget();
const { layoutOf } = await import("../../static/layout/layout.js");

test("all panes are beside one another in a wide window only", () => {
  assert.equal(layoutOf(1200, 700).kind, "wide");
  assert.equal(layoutOf(1199, 700).kind, "beside");
  assert.equal(layoutOf(799, 700).kind, "below");
  assert.equal(layoutOf(799, 500).kind, "tabs");
});

test("the details have a tab only where they have no place of their own", () => {
  for (const [width, height] of [
    [1024, 768],
    [1024, 500],
    [600, 900],
  ])
    assert.ok(!layoutOf(width, height).panes.includes("details"));
  assert.ok(layoutOf(640, 360).panes.includes("details"));
});
