import assert from "node:assert/strict";
import test from "node:test";

import { count, degrees, keyName, length, niceLength, number, vector } from "../../static/page/format.js";

test("numbers have fixed decimals and a true minus sign, never minus zero", () => {
  assert.equal(number(-1.25, 2), "\u22121.25");
  assert.equal(number(-0.04), "0.0");
  assert.equal(number(3, 0), "3");
});

test("what is not known is a dash", () => {
  for (const value of [null, undefined, NaN, Infinity]) assert.equal(number(value), "–");
  assert.equal(degrees(null), "–");
  assert.equal(vector([1, null, -2], 1, 1000), "1000.0 – \u22122000.0");
});

test("one is one, everything else many", () => {
  assert.deepEqual([count(1, "view"), count(0, "view"), count(3, "view")], ["1 view", "0 views", "3 views"]);
});

test("keys are named as they are printed", () => {
  const names = {
    Escape: "Esc",
    " ": " ",
    a: "A",
    "Ctrl+Enter": "Ctrl+Enter",
    "Ctrl+z": "Ctrl+Z",
    "Shift+p": "⇧P",
    "+": "+",
  };
  for (const [key, name] of Object.entries(names)) assert.equal(keyName(key), name);
});

test("the scale's length is the longest of 1, 2, 5 times a power of ten that fits", () => {
  for (const [limit, nice] of [
    [1, 1],
    [4.99, 2],
    [5, 5],
    [99, 50],
    [1999, 1000],
    [0.3, 0.2],
  ]) {
    assert.ok(Math.abs(niceLength(limit) - nice) < 1e-12, `${limit}`);
  }
});

test("a length has the unit that suits it", () => {
  assert.deepEqual([length(2000), length(50), length(0.2)], ["2 m", "50 mm", "0.2 mm"]);
});
