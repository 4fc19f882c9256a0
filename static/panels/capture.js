// A camera's page: what it sees wrong, and the guided capture: turn, hold still, keep or repeat.

import { byId, make, rebuild, setAllowed, setText } from "/static/page/dom.js";
import { count, number } from "/static/page/format.js";

const ACTIONS = { capture_keep: "keep", capture_repeat: "repeat", capture_turned: "turned" };
const BUTTONS = { turn: ["capture_turned"], review: ["capture_keep", "capture_repeat"] };

export class CapturePanel {
  name = "capture";

  constructor(page) {
    this.page = page;
    this.actions = Object.fromEntries(Object.keys(ACTIONS).map((name) => [name, () => this.do(name)]));
    this.messages = { capture: (message) => page.state?.capture && this.take(message) };
    this.table = []; // its actions as the server tells them
    this.status = null;
  }

  /** Take a state of the page; without a camera there is nothing to show. */
  update(state) {
    const there = Boolean(state.capture);
    document.body.classList.toggle("has-camera", there);
    byId("capture").hidden = !there;
    if (!there) return;
    this.table = state.actions.filter((action) => action.name in ACTIONS);
    document.querySelector(".on-air").setAttribute("data-tip", "What the camera sees now.");
    this.take(state.capture);
  }

  /** Take how the capture stands; this comes several times a second. */
  take(status) {
    this.status = status;
    // These overtake the states, in which the table of actions comes.
    for (const action of this.table) action.why_not = status.why_not[action.name];
    rebuild(byId("capture"), [status.camera], () => this.parts(status));
    setText(byId("capture-rate"), status.ended ? "has ended" : `${number(status.camera_fps, 0)} frames/s`);
    this.showWarnings(status);
    this.showTask(status);
    this.showView(status.view);
    this.showButtons(status);
    setText(byId("capture-kept"), kept(status));
  }

  /** Do what a key or a button of the table says. */
  do(name) {
    this.page.send({ type: "capture", action: ACTIONS[name] });
  }

  parts(status) {
    return [
      make(
        "div",
        { class: "heading" },
        make("h2", {}, "Capture"),
        make("span", { id: "capture-rate", class: "quiet-text", data: { tip: status.camera } }),
      ),
      make("ul", { id: "capture-warnings", class: "capture-warnings", role: "status" }),
      make("p", { id: "capture-task", class: "capture-task", role: "status" }),
      make("p", { id: "capture-way", class: "quiet-text" }),
      make(
        "label",
        { class: "capture-still" },
        make("span", {}, "Still"),
        make("meter", {
          id: "capture-still",
          min: 0,
          max: 1,
          value: 0,
          "aria-label": "How long the item has hung still",
        }),
        make("output", { id: "capture-speed" }),
      ),
      make("div", { id: "capture-view" }),
      make("div", { id: "capture-buttons", class: "capture-buttons", role: "group", "aria-label": "Capture" }),
      make("p", { id: "capture-kept", class: "quiet-text capture-kept" }),
    ];
  }

  showWarnings(status) {
    const texts = [...(status.ended ? [status.ended] : []), ...status.warnings];
    rebuild(byId("capture-warnings"), texts, () => texts.map((text) => make("li", {}, text)));
  }

  showTask(status) {
    setText(byId("capture-task"), task(status));
    setText(byId("capture-way"), way(status));
    const meter = byId("capture-still");
    const taking = status.phase === "take";
    meter.value = taking ? status.taken / status.frames : Math.min(1, status.still_s / status.hold_s);
    setText(byId("capture-speed"), speed(status));
    byId("capture").dataset.phase = status.phase;
  }

  showView(view) {
    byId("capture-view").hidden = !view;
    // The angle is left alone while it is typed.
    if (!view) return;
    rebuild(byId("capture-view"), [view.number, view.angle_deg], () => [
      make("img", {
        class: "capture-picture",
        src: `/capture/view.png?number=${view.number}`,
        alt: `Color and depth of the view at ${number(view.angle_deg, 1)} degrees`,
      }),
      make("p", { class: "quiet-text" }, `${view.frames} frames, which agree to ${number(view.noise_mm, 1)} mm`),
      ...view.warnings.map((text) => make("p", { class: "capture-warning" }, text)),
      make(
        "label",
        { class: "field", data: { tip: "If the item was turned to another angle than it was asked for" } },
        make("span", {}, "Angle °"),
        make("input", {
          type: "number",
          step: 1,
          value: view.angle_deg,
          data: { id: "capture-angle" },
          on: { change: (event) => this.aim(event.target.valueAsNumber) },
        }),
      ),
    ]);
  }

  aim(angle) {
    if (Number.isFinite(angle)) this.page.send({ type: "capture", action: "aim", angle_deg: angle });
  }

  showButtons(status) {
    const names = status.announced && status.phase === "turn" ? [] : (BUTTONS[status.phase] ?? []);
    const idle = ["idle", "done"].includes(status.phase);
    byId("capture-buttons").hidden = status.ended !== null;
    rebuild(byId("capture-buttons"), [names, idle, status.phase === "done"], () => [
      ...names.map((name) => this.page.button(name)),
      idle
        ? plain(
            "capture-begin",
            status.phase === "done" ? "Go on" : "Begin capture",
            "primary",
            "Views are written to the folder below, each before the next.",
            () => this.send("begin"),
          )
        : plain("capture-finish", "Finish", "", "End the capture; a view that is not kept is dropped.", () =>
            this.send("finish"),
          ),
    ]);
    for (const button of byId("capture-buttons").querySelectorAll("[data-action]")) {
      const action = this.table.find((a) => a.name === button.dataset.action);
      if (action) setAllowed(button, action.why_not, this.page.tip(action.name));
      button.classList.toggle("primary", button.dataset.action === "capture_keep");
    }
  }

  send(action) {
    this.page.send({ type: "capture", action });
  }
}

function plain(id, title, more, tip, click) {
  return make("button", { type: "button", class: `button ${more}`, data: { id, tip }, on: { click } }, title);
}

/** What is to be done now, in one line. */
function task(status) {
  const view = `view ${status.kept_deg.length}`;
  if (status.ended) return `The camera has ended. ${count(status.kept_deg.length, "view")} on disk.`;
  switch (status.phase) {
    case "idle":
      return "Hang the item in sight, then begin.";
    case "turn":
      return status.announced
        ? `Waiting for the angle of ${view}.`
        : `Turn by ${signed(status.turn_by_deg)}, to ${number(status.target_deg, 0)}°.`;
    case "settle":
      return `At ${number(status.target_deg, 0)}°: let it hang still.`;
    case "take":
      return `Taking frame ${Math.min(status.taken + 1, status.frames)} of ${status.frames}.`;
    case "review":
      return `Keep ${view} at ${number(status.target_deg, 0)}°?`;
    default:
      return `Done: ${count(status.kept_deg.length, "view")}.`;
  }
}

/** Which way a turn goes, as seen in the picture. */
function way(status) {
  if (status.phase !== "turn" || status.announced) return "";
  return status.turn_by_deg > 0
    ? "What faces the camera moves to the right →"
    : "← What faces the camera moves to the left";
}

function signed(degrees) {
  return `${degrees < 0 ? "−" : ""}${number(Math.abs(degrees), 0)}°`;
}

function speed(status) {
  if (status.speed_px_s === null) return "–";
  return status.still_s > 0 ? `${number(status.still_s, 1)} s` : `${number(status.speed_px_s, 0)} px/s`;
}

function kept(status) {
  if (!status.kept_deg.length) return `Folder: ${status.folder}`;
  return `${count(status.kept_deg.length, "view")} on disk in ${status.folder}`;
}
