import assert from "node:assert/strict";
import test from "node:test";

import { readAddress, writeAddress } from "../../static/page/address.js";

test("an address names place, view and pick, and is read as it was written", () => {
  const address = { place: { kind: "folder", name: "deep/a b?#é" }, view: 3, pick: 12 };
  assert.deepEqual(readAddress(writeAddress(address)), address);
  const alone = { place: { kind: "session", name: "shirt-1" }, view: null, pick: null };
  assert.equal(writeAddress(alone), "#session/shirt-1");
  assert.deepEqual(readAddress("#session/shirt-1"), alone);
});

test("what is no address opens nothing", () => {
  assert.deepEqual(readAddress(""), { place: null, view: null, pick: null });
  assert.deepEqual(readAddress("#session/a?view=-1&pick=x"), {
    place: { kind: "session", name: "a" },
    view: null,
    pick: null,
  });
  assert.equal(readAddress("#session/%E0%A4%A").place?.name, "%E0%A4%A");
});
