// The lines above the canvas: the shown view, the next step, the progress, and notes about the session.

import { byId, make, rebuild, setText } from "/static/page/dom.js";
import { count } from "/static/page/format.js";
import { hint } from "/static/page/hints.js";

const BUSY_AFTER_MS = 250;

export class StatusLines {
  constructor() {
    /** @type {number | null} */
    this.busyTimer = null;
    this.busy = make("p.busy", { role: "status", hidden: true }, "Drawing the shape …");
    byId("stage").append(this.busy);
    /** @type {Panel["messages"]} */
    this.messages = { progress: (message) => this.showProgress(message) };
  }

  update(/** @type {State} */ state) {
    const { name, description, n_views } = state.recording;
    setText(byId("recording"), `${name} · ${count(n_views, "view")} · method ${state.method}`);
    byId("recording").dataset.tip = description || name;
    document.title = `${name} · flatcloth`;
    byId("live").hidden = state.mode !== "live";
    byId("hint").hidden = state.mode === "live";
    setText(byId("hint"), hint(state));
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
      make("button.close", { label: "Dismiss the notes", click: dismiss }, "×"),
    ]);
  }
}
