// The lines above the canvas: the shown view, the next step, the progress, and notes about the session.

import { PagePart } from "./page.js";
import { byId, closeButton, make, rebuild, setText } from "./dom.js";
import { count, endOf, floatingOf, number } from "./format.js";

const BUSY_AFTER_MS = 250;

export class StatusLines extends PagePart {
  busyTimer = /** @type {number | null} */ (null);
  busy = byId("busy");
  /** @type {Panel["messages"]} */
  messages = { progress: (message) => this.showProgress(message) };

  update(/** @type {State} */ state) {
    const { name, description, n_views } = state.recording;
    setText(byId("recording"), `${name} · ${count(n_views, "view")} · method ${state.method}`);
    byId("recording").dataset.tip = description || name;
    document.title = `${name} · flatcloth`;
    byId("live").hidden = state.mode !== "camera";
    byId("hint").hidden = state.mode === "camera";
    setText(byId("hint"), hint(this.page.thisSide)); // of this side, also while the garment is turned over
    this.showProgress(state.progress);
    this.showNotes(state);
    this.showBusy(Boolean(state.drawing));
  }

  /** While the session is ahead of the shape that is shown, and not for the blink of an eye. */
  showBusy(/** @type {boolean} */ drawing) {
    if (drawing === (this.busyTimer !== null)) return;
    clearTimeout(this.busyTimer ?? 0);
    const show = (/** @type {boolean} */ on) => {
      this.busy.hidden = !on;
      byId("stage").setAttribute("aria-busy", String(on));
    };
    this.busyTimer = drawing ? setTimeout(() => show(true), BUSY_AFTER_MS) : null;
    if (!drawing) show(false);
  }

  showProgress(/** @type {State["progress"]} */ progress) {
    byId("progress").hidden = !progress;
    if (!progress) return;
    setText(byId("progress-text"), `${progress.text} · ${Math.round(100 * progress.share)} %`);
    byId("progress-bar").value = progress.share;
  }

  showNotes(/** @type {State} */ { recording, notes }) {
    const strip = byId("session-notes");
    const key = JSON.stringify([recording.name, notes]);
    strip.hidden = !notes.length || sessionStorage.getItem("flatcloth-notes") === key;
    const dismiss = () => {
      sessionStorage.setItem("flatcloth-notes", key);
      strip.hidden = true;
    };
    rebuild(strip, key, () => [
      make("ul", ...notes.map((text) => make("li", text))),
      closeButton("Dismiss the notes", dismiss),
    ]);
  }
}

/** How large the shape is, and what floats beside it. */
function shapeOf(/** @type {number} */ step, /** @type {NonNullable<State["layers"]>} */ layers) {
  const { pieces, area_cm2: floating } = floatingOf(layers);
  const beside = floating ? ` ${number(floating, 0)} cm² float in ${count(pieces.length, "piece")}.` : "";
  return ` Shape: ${count(step, "view")}, ${number(layers.area_cm2, 0)} cm².${beside}`;
}

/** What to do next, in a line. */
function hint(/** @type {State} */ state) {
  const angle = (/** @type {number | null} */ i, word = "view") =>
    `${word} ${i} (${number(state.views[i ?? 0].angle_deg, 0)}°)`;
  const { request, pending } = state;
  if (state.trouble) return state.trouble;
  const area = state.layers ? shapeOf(state.step, state.layers) : "";
  const waiting = state.n_later
    ? ` Then ${count(state.n_later, "later view")} follow${state.n_later === 1 ? "s" : ""}.`
    : "";
  const { running, waits_for, ended, until } = state.auto;
  if (waits_for) return `${waits_for}${area}`;
  const auto = running ? `Auto (G stops it) goes on ${until}. ` : "";
  if (auto && state.phase !== "computing") return `${auto}${area}`;
  if (ended && state.phase === "ready") return `Auto has ended: ${ended} Step (S) goes on.${area}`;
  if (state.mode === "camera") return "";
  switch (state.phase) {
    case "computing":
      if (!request || request.kind === "start") return "Choosing and flattening the start view.";
      if (request.kind === "follow") return `Laying ${angle(request.view_index)} on the changed shape.${area}`;
      return request.view_index === null
        ? `${auto}Looking for the next view.${area}`
        : `${auto}Laying ${angle(request.view_index)} on the shape.${area}`;
    case "deciding":
      if (!pending) return "";
      if (pending.again && !pending.why)
        return (
          `${angle(pending.view_index, "View")} is decided again: Accept (A), Reject (R), Skip (K) or move it;` +
          ` Undo (U) leaves it as it was.${waiting}${area}`
        );
      return (
        `Is ${angle(pending.view_index)} in its place? Accept (A), Reject (R), Skip (K),` +
        ` or move it with the arrow keys.${waiting}${area}`
      );
    case "finished":
      return (
        `${endOf(state)}: ${state.finished ?? ""}` +
        (state.sides ? " Without masks, some may be of the wrong side (see Result)." : "") +
        ` Click the cloth for a grasp point.${area}`
      );
    default:
      return state.start_view === null
        ? "Press Step (S): the start view is chosen and flattened."
        : state.n_later
          ? `${count(state.n_later, "later view")} wait${state.n_later === 1 ? "s" : ""} to follow.` +
            ` Press Step (S) to go on.${area}`
          : `Press Step (S): the next view is chosen, flattened and placed on the shape.${area}`;
  }
}
