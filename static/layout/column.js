// The right column: the part that the moment needs, the others one press away, the selection always in sight.

import { PagePart } from "../page/page.js";
import { byId, make, rebuild, smallButton, values } from "../page/dom.js";
import { degrees, mm, vector } from "../page/format.js";

const STROKES = ["brush_this", "brush_other", "where_to_stroke", "where_before", "show_sides", "show_certainty"];
/** @type {[name: string, title: string, sections: string[], actions: string[]][]} parts, the first come first */
const PARTS = [
  ["capture", "Capture", ["capture"], []],
  ["check", "Check", ["check"], []],
  ["active", "Loop", ["active"], []],
  ["proposal", "Proposal", ["proposal"], ["pairs", "fit_pairs", "refine"]],
  ["result", "Result", ["result"], ["result"]],
  ["pick", "Pick", ["pick", "picks"], []],
  ["doubts", "Doubts", ["doubts"], ["doubt_next"]],
  ["garment", "Garment", ["garment"], ["garment"]],
  ["both-sides", "Sides", ["both-sides"], ["turn_over", "beside"]],
  ["sides", "Strokes", ["sides"], STROKES],
  ["look", "Look", ["look"], ["look"]],
];

export class Column extends PagePart {
  name = "column";
  part = "pick";
  usual = "pick"; // of the moment
  moment = "";
  tabs = byId("column-tabs");
  body = byId("column-part");
  selection = byId("selection");

  /** The parts that there are now. */
  get parts() {
    return PARTS.filter(([, , sections]) => sections.some((id) => document.getElementById(id)?.hidden === false));
  }

  update(/** @type {State} */ state) {
    const names = this.parts.map(([name]) => name);
    const [moment, part] = momentOf(state, names, this.page.recordingIsWrong);
    const before = this.part;
    this.usual = part;
    if (moment !== this.moment) {
      this.moment = moment;
      this.part = part;
    }
    if (!names.includes(this.part)) this.part = names.includes(part) ? part : (names[0] ?? "pick");
    this.show();
    if (this.part !== before) queueMicrotask(() => this.page.changed()); // what is marked is that of the part in sight
    this.showSelection(state);
  }

  show() {
    const parts = this.parts;
    for (const [name, , sections] of PARTS)
      for (const id of sections) document.getElementById(id)?.classList.toggle("off", name !== this.part);
    this.tabs.hidden = parts.length < 2;
    rebuild(this.tabs, [parts.map(([name]) => name), this.part], () =>
      parts.map(([name, title]) =>
        smallButton(title, () => this.choose(name), { pressed: name === this.part, key: `part-${name}` }),
      ),
    );
  }

  choose(/** @type {string} */ part) {
    this.part = part;
    this.body.scrollTop = 0;
    this.show();
    this.page.changed();
    this.page.redrawMarks();
  }

  /** Before an action: whether it only brings a part that is there already, but not in sight. */
  brings(/** @type {string} */ action) {
    const part = this.partOf(action);
    if (!part || part === this.part || !ONLY_SHOWN.includes(action)) return false;
    if (!this.parts.some(([name]) => name === part)) return false;
    this.choose(part);
    return true;
  }

  /** After an action: bring the part in which its effect is seen. */
  reveal(/** @type {string} */ action) {
    const part = this.partOf(action);
    if (part && part !== this.part && this.parts.some(([name]) => name === part)) this.choose(part);
  }

  partOf(/** @type {string} */ action) {
    return PARTS.find(([, , , actions]) => actions.includes(action))?.[0] ?? null;
  }

  /** The current pick in a few lines, whatever part is shown. */
  showSelection(/** @type {State} */ { pick, pending }) {
    this.selection.hidden = !pick || this.part === "pick";
    if (!pick) return;
    const held = `${vector(pick.position_held_m, 1, 1000)} mm`;
    const isLine = Boolean(pending) || this.page.doubts.asks || innerWidth < NARROW_PX; // what else is there needs the room
    rebuild(this.selection, [pick, isLine], () =>
      isLine
        ? make("div.heading", make("h2", pick.name), make("span", { tip: HELD }, held))
        : [
            make("div.heading", make("h2", pick.name), this.page.smallButton("copy")),
            values(
              ["Place", held, HELD],
              ["Normal", vector(pick.normal_held, 3), "Outward normal in the object frame"],
              pick.grip && ["Grip", gripText(pick.grip), "Axis on the flattened view, and opening"],
            ),
          ],
    );
  }
}

const NARROW_PX = 600; // a phone
const HELD = "Position x y z in the object frame";
const ONLY_SHOWN = ["result", "look", "garment"]; // actions that do nothing else

/** What the page is at, and the part that it needs. @returns {[moment: string, part: string]} */
function momentOf(/** @type {State} */ state, /** @type {string[]} */ parts, /** @type {boolean} */ isWrong) {
  const { pending, auto } = state;
  if (state.capture) return ["capture", "capture"];
  if (pending) return [`proposal ${pending.view_index}`, "proposal"];
  if (parts.includes("check") && isWrong) return ["check", "check"];
  if (parts.includes("active")) return ["active", "active"];
  if (parts.includes("result") && (state.finished || auto.ended))
    return [`end ${state.finished ?? auto.ended}`, "result"];
  return ["picking", "pick"]; // a pick is always in sight below, and leads away from nothing
}

const gripText = (/** @type {NonNullable<CurrentPick["grip"]>} */ { axis_deg, opening_m }) =>
  `${degrees(axis_deg, 0)}, open ${mm(1000 * opening_m, 0)}`;
