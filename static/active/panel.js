// The active loop: what is to be known, the next angle with what is expected of it, and what the last turns brought.

import { PagePart } from "../page/page.js";
import { choice, field, make, section } from "../page/dom.js";
import { count, degrees } from "../page/format.js";

export class ActivePanel extends PagePart {
  /** Take a state of the page; other modes have no loop. */
  update(/** @type {State} */ state) {
    const { active: status, garment } = state;
    section("active", status && [status, garment?.found?.points], () => status && this.parts(status));
  }

  parts(/** @type {ActiveStatus} */ status) {
    return [
      make("h2", { tip: status.folder }, "Active loop"),
      field("Goal", this.goals(status)),
      make("p.quiet-text", `${count(status.views, "view")}; budget ${status.budget}.`),
      make("p.quiet-text", status.why && `Expected: ${status.why}.`),
      make("p#active-knows.active-knows", `Known: ${status.knows.replaceAll("_", " ")}`),
      make(
        "ol.active-steps",
        { label: "What the last views brought" },
        ...status.steps.map((step) =>
          make(
            "li",
            make("strong", `View ${step.number}, ${degrees(step.angle_deg, 0)}`),
            step.why && make("span", `expected: ${step.why}`),
            make("span", `got: ${step.got}`),
          ),
        ),
      ),
    ];
  }

  /** What can be wanted: the shape, the kind, and where each point of the recognised garment is. */
  goals(/** @type {ActiveStatus} */ status) {
    const now = status.goal.replace(/ within .*/, "");
    const points = this.page.state.garment?.found?.points ?? [];
    const goals = new Map([
      ["shape", "the whole shape"],
      ["kind", "the kind of garment"],
      ...points.map(({ name }) => /** @type {[string, string]} */ ([`points:${name}`, name.replaceAll("_", " ")])),
    ]);
    if (!goals.has(now)) goals.set(now, status.goal);
    return choice([...goals], now, {
      id: "active-goal",
      tip: "What the loop is to find out. It turns to where a view helps most, and ends when this is known.",
      change: ({ target }) => this.page.send({ type: "aim", goal: target.value }),
    });
  }
}

/** What Step does, where a loop asks for views. */
export const stepOf = (/** @type {ActiveStatus | null | undefined} */ status) =>
  !status ? "Step" : status.is_simulated ? "Turn and look" : "It is there: look";

/** What is to be done now, in one line. */
export function task(/** @type {ActiveStatus} */ status) {
  const { end, turning, angle_deg: angle, turn_deg: turn, is_simulated } = status;
  if (end !== null) return end;
  if (turning && is_simulated) return "The item is turned, and a view is taken.";
  if (turning) return "A view is taken once the item hangs still.";
  if (angle === null) return status.waiting;
  const by = `${degrees(turn ?? 0, 0)}, to ${degrees(angle, 0)}`;
  const press = `${stepOf(status)} (S)`;
  return is_simulated
    ? `Press ${press}: the cell turns the item by ${by}.`
    : `Turn the item by ${by}; then press ${press}.`;
}
