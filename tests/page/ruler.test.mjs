import assert from "node:assert/strict";
import test from "node:test";

const element = () => ({
  style: {},
  classList: { toggle: () => {} },
  dataset: {},
  append: () => {},
  setAttribute: () => {},
  replaceChildren: () => {},
});
globalThis.document = { createElement: element, getElementById: element };
const { Ruler } = await import("../../static/canvas/ruler.js");
const { Question } = await import("../../static/page/connection.js");

function rulerOn() {
  const sent = [];
  const located = (u_m, v_m) => ({ sheet: "this", u_m, v_m });
  const canvas = { side: "this", located, layer: { shown: {} }, redraw: () => {} };
  const send = (message) => sent.push(message) && true;
  const question = (type, ask, take) => new Question(ask, take);
  const page = { canvas, changed: () => {}, send, question };
  const ruler = new Ruler(page);
  ruler.toggle();
  return { ruler, sent };
}

const at = (x, y) => ({ x, y, u: x / 1000, v: y / 1000 });
const answer = (id, flat_mm) => ({ id, flat_mm, cloth_mm: null, air_mm: null, path_uv_m: [] });

test("a press that does not move measures nothing", () => {
  const { ruler, sent } = rulerOn();
  assert.equal(ruler.press(at(10, 10)), true);
  ruler.release(at(11, 11));
  assert.equal(ruler.line, null);
  assert.deepEqual(sent, []);
});

test("a drag asks once, and again for where it has got to when the answer comes", () => {
  const { ruler, sent } = rulerOn();
  ruler.press(at(0, 0));
  ruler.drag(at(30, 40));
  ruler.drag(at(60, 80));
  assert.equal(sent.length, 1);
  assert.deepEqual([sent[0].to_u_m, sent[0].to_v_m], [0.03, 0.04]);
  ruler.question.answered(answer(sent[0].id, 50));
  assert.equal(ruler.measured, null); // it is about an end that was left
  assert.deepEqual([sent[1].to_u_m, sent[1].to_v_m], [0.06, 0.08]);
  ruler.question.answered(answer(sent[1].id, 100));
  assert.equal(ruler.measured.flat_mm, 100);
});

test("another shape is measured anew, the same one is not", () => {
  const { ruler, sent } = rulerOn();
  const state = (revision) => ({ mode: "session", layers: { revision } });
  ruler.update(state(1));
  ruler.press(at(0, 0));
  ruler.drag(at(30, 0));
  ruler.question.answered(answer(sent[0].id, 30));
  ruler.update(state(1));
  assert.equal(sent.length, 1);
  ruler.update(state(2));
  assert.equal(sent.length, 2);
});

test("Escape clears the line, then puts the ruler away, then is not taken", () => {
  const { ruler } = rulerOn();
  ruler.press(at(0, 0));
  ruler.drag(at(30, 0));
  assert.equal(ruler.escape(), true);
  assert.equal(ruler.line, null);
  assert.equal(ruler.escape(), true);
  assert.equal(ruler.on, false);
  assert.equal(ruler.escape(), false);
  assert.equal(ruler.press(at(0, 0)), false);
});

test("after a lost connection it asks again", () => {
  const { ruler, sent } = rulerOn();
  ruler.press(at(0, 0));
  ruler.drag(at(30, 0));
  ruler.question.lost();
  ruler.drag(at(50, 0));
  assert.equal(sent.length, 2);
});
