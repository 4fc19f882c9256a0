// The active loop: what is to be known, the next angle with what is expected of it, and what the last turns brought.

import { PagePart } from "../page/page.js";
import { button, byId, heading, make, rebuild, setAllowed } from "../page/dom.js";
import { count, degrees } from "../page/format.js";

export class ActivePanel extends PagePart {
  name = "active";

  /** Take a state of the page; other modes have no loop. */
  update(/** @type {State} */ state) {
    const status = state.active;
    const section = byId("active");
    section.hidden = !status;
    if (!status) return;
    section.dataset.state = stateOf(status);
    rebuild(section, [JSON.stringify(status)], () => this.parts(status));
  }

  parts(/** @type {ActiveStatus} */ status) {
    return [
      heading("Active loop", make("span.quiet-text", { tip: status.folder }, status.source)),
      make("p.active-goal", `Goal: ${status.goal}. ${count(status.views, "view")}; budget ${status.budget}.`),
      make("p#active-task.active-task", { role: "status" }, task(status)),
      make("p.quiet-text", status.why && `Expected: ${status.why}.`),
      make("p#active-knows.active-knows", `Known: ${status.knows}`),
      status.turns_itself && this.turnButton(status),
      make(
        "ol.active-steps",
        { label: "What the last views brought" },
        ...status.steps.map((step) =>
          make(
            "li",
            make("strong", `View ${step.number}, ${degrees(step.angle_deg, 0)}`),
            step.expected && make("span", `expected: ${step.expected}`),
            make("span", `got: ${step.got}`),
          ),
        ),
      ),
    ];
  }

  turnButton(/** @type {ActiveStatus} */ status) {
    const look = button(
      status.is_simulated ? "Turn and look" : "It is there: look",
      () => this.page.send({ type: "capture", action: "turned" }),
      {
        class: "primary",
        key: "active-turn",
        tip: status.is_simulated
          ? "Turn the item to the next angle and take a view. Auto does it by itself."
          : "The item stands at this angle: take a view once it hangs still.",
      },
    );
    look.id = "active-turn";
    setAllowed(look, status.angle_deg === null || status.turning ? task(status) : null, look.title);
    return look;
  }
}

function stateOf(/** @type {ActiveStatus} */ status) {
  if (status.end !== null) return status.reached ? "reached" : "ended";
  return status.turning || status.waiting ? "waiting" : "asking";
}

/** What is to be done now, in one line. */
function task(/** @type {ActiveStatus} */ status) {
  if (status.end !== null) return status.end;
  if (status.turning)
    return status.is_simulated
      ? "The item is turned, and a view is taken."
      : "A view is taken once the item hangs still.";
  if (status.angle_deg === null) return status.waiting;
  return `Turn by ${degrees(status.turn_deg ?? 0, 0)}, to ${degrees(status.angle_deg, 0)}.`;
}
