// The lines above the canvas: the shown view, the next step, the progress, and notes about the session.

import { byId, make, rebuild, setText } from "/static/page/dom.js";
import { count } from "/static/page/format.js";
import { hint } from "/static/page/hints.js";

export class StatusLines {
  constructor() {
    this.messages = { progress: (message) => this.showProgress(message) };
  }

  update(state) {
    const { name, description, n_views } = state.recording;
    setText(byId("recording"), `${name} · ${count(n_views, "view")} · method ${state.method}`);
    byId("recording").dataset.tip = description || name;
    document.title = `${name} · flatcloth`;
    byId("live").hidden = state.mode !== "live";
    byId("hint").hidden = state.mode === "live";
    setText(byId("hint"), hint(state));
    this.showProgress(state.progress);
    this.showNotes(state);
  }

  showProgress(progress) {
    byId("progress").hidden = !progress;
    if (!progress) return;
    setText(byId("progress-text"), `${progress.text} · ${Math.round(100 * progress.share)} %`);
    byId("progress-bar").value = progress.share;
  }

  showNotes({ recording, notes }) {
    const strip = byId("session-notes");
    const key = JSON.stringify([recording.name, notes]);
    strip.hidden = !notes.length || sessionStorage.getItem("flatcloth-notes") === key;
    const dismiss = () => {
      sessionStorage.setItem("flatcloth-notes", key);
      strip.hidden = true;
    };
    rebuild(strip, key, () => [
      make("ul", {}, ...notes.map((text) => make("li", {}, text))),
      make(
        "button",
        { type: "button", class: "close", "aria-label": "Dismiss the notes", on: { click: dismiss } },
        "×",
      ),
    ]);
  }
}
