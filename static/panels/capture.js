// A camera's page: what it sees wrong, and the guided capture: turn, hold still, keep or repeat.

import { PagePart } from "../page/page.js";
import { buttonOf, byId, field, make, numberBox, rebuild, setText } from "../page/dom.js";
import { count, degrees, number } from "../page/format.js";

/** @type {Record<string, "keep" | "repeat" | "turned">} */
const ACTIONS = { capture_keep: "keep", capture_repeat: "repeat", capture_turned: "turned" };
/** @type {Record<string, string[]>} */
const BUTTONS = { turn: ["capture_turned"], review: ["capture_keep", "capture_repeat"] };

export class CapturePanel extends PagePart {
  /** @type {NonNullable<Panel["actions"]>} */
  actions = {
    ...Object.fromEntries(Object.keys(ACTIONS).map((name) => [name, () => this.send(ACTIONS[name])])),
    capture_pause: () => this.page.send({ type: "play", playing: !this.page.state.capture?.playing }),
  };

  constructor(/** @type {Page} */ page) {
    super(page);
    byId("capture-begin").addEventListener("click", () => this.send("begin"));
    byId("capture-finish").addEventListener("click", () => this.send("finish"));
  }

  /** Take a state of the page; without a camera there is nothing to show. */
  update(/** @type {State} */ state) {
    const there = Boolean(state.capture);
    document.body.classList.toggle("has-camera", there);
    byId("capture").hidden = !there;
    if (!state.capture) return;
    const status = state.capture;
    setText(byId("on-air"), status.playing ? "Live" : "Held");
    setText(byId("camera-name"), status.camera);
    byId("capture-rate").dataset.tip = status.camera;
    setText(byId("capture-rate"), status.ended ? "has ended" : `${number(status.camera_fps, 0)} frames/s`);
    this.showWarnings(status);
    this.showTask(status);
    this.showView(status.view);
    this.showButtons(status);
    setText(byId("capture-kept"), kept(status));
  }

  showWarnings(/** @type {CaptureStatus} */ status) {
    const texts = [...(status.ended ? [status.ended] : []), ...status.warnings];
    rebuild(byId("capture-warnings"), texts, () => texts.map((text) => make("li", text)));
  }

  showTask(/** @type {CaptureStatus} */ status) {
    setText(byId("capture-task"), task(status));
    setText(byId("capture-way"), way(status));
    const meter = byId("capture-still");
    const taking = status.phase === "take";
    meter.value = taking ? status.taken / status.frames : Math.min(1, status.still_s / status.hold_s);
    setText(byId("capture-speed"), speed(status));
    byId("capture").dataset.phase = status.phase;
  }

  showView(/** @type {CaptureStatus["view"]} */ view) {
    byId("capture-view").hidden = !view;
    // The angle is left alone while it is typed.
    if (!view) return;
    rebuild(byId("capture-view"), [view.number, view.angle_deg], () => [
      make("img.capture-picture", {
        src: `capture/view.png?number=${view.number}`,
        alt: `Color and depth of the view at ${number(view.angle_deg, 1)} degrees`,
      }),
      make("p.quiet-text", `${view.frames} frames, which agree to ${number(view.noise_mm, 1)} mm`),
      ...view.warnings.map((text) => make("p.capture-warning", text)),
      field(
        "Angle °",
        numberBox({ step: 1 }, view.angle_deg, {
          key: "capture-angle",
          change: ({ target: { valueAsNumber: angle } }) => Number.isFinite(angle) && this.send("aim", angle),
        }),
        "If the item was turned to another angle than it was asked for",
      ),
    ]);
  }

  showButtons(/** @type {CaptureStatus} */ status) {
    const names = status.announced && status.phase === "turn" ? [] : (BUTTONS[status.phase] ?? []);
    const idle = ["idle", "done"].includes(status.phase);
    byId("capture-buttons").hidden = status.ended !== null;
    for (const name of Object.keys(ACTIONS)) buttonOf(name).hidden = !names.includes(name);
    buttonOf("capture_keep").classList.add("primary");
    setText(byId("capture-begin"), status.phase === "done" ? "Go on" : "Begin capture");
    byId("capture-begin").hidden = !idle;
    byId("capture-finish").hidden = idle;
  }

  /** @param {import("../page/messages").Capture["action"]} action @param {number} [angle_deg] */
  send(action, angle_deg) {
    this.page.send({ type: "capture", action, angle_deg });
  }
}

/** What is to be done now, in one line. */
function task(/** @type {CaptureStatus} */ status) {
  const view = `view ${status.kept_deg.length}`;
  if (status.ended) return `The camera has ended. ${count(status.kept_deg.length, "view")} on disk.`;
  switch (status.phase) {
    case "idle":
      return "Hang the item in sight, then begin.";
    case "turn":
      return status.announced
        ? `Waiting for the angle of ${view}.`
        : `Turn by ${degrees(status.turn_by_deg, 0)}, to ${degrees(status.target_deg, 0)}.`;
    case "settle":
      return `At ${degrees(status.target_deg, 0)}: let it hang still.`;
    case "take":
      return `Taking frame ${Math.min(status.taken + 1, status.frames)} of ${status.frames}.`;
    case "review":
      return `Keep ${view} at ${degrees(status.target_deg, 0)}?`;
    default:
      return `Done: ${count(status.kept_deg.length, "view")}.`;
  }
}

/** Which way a turn goes, as seen in the picture. */
function way(/** @type {CaptureStatus} */ status) {
  if (status.phase !== "turn" || status.announced) return "";
  return status.turn_by_deg > 0
    ? "What faces the camera moves to the right →"
    : "← What faces the camera moves to the left";
}

function speed(/** @type {CaptureStatus} */ status) {
  if (status.speed_px_s === null) return "–";
  return status.still_s > 0 ? `${number(status.still_s, 1)} s` : `${number(status.speed_px_s, 0)} px/s`;
}

function kept(/** @type {CaptureStatus} */ status) {
  if (!status.kept_deg.length) return `Folder: ${status.folder}`;
  return `${count(status.kept_deg.length, "view")} on disk in ${status.folder}`;
}
