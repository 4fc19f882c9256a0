// The lines above the canvas: the shown view, the next step, the progress, and notes about the session.

import { PagePart } from "./page.js";
import { task } from "../active/panel.js";
import { byId, closeButton, hasKeys, make, rebuild, setText } from "./dom.js";
import { cm2, count, endOf, floatingOf, number } from "./format.js";

export class StatusLines extends PagePart {
  update(/** @type {State} */ state) {
    const { name, description, n_views } = state.recording;
    setText(byId("recording"), [...shapeOf(this.page.thisSide), name].join(" · "));
    byId("recording").dataset.tip = `${name}, ${count(n_views, "view")}, method ${state.method}\n${description}`;
    document.title = `${name} · flatcloth`;
    byId("live").hidden = state.mode !== "camera";
    byId("hint").hidden = state.mode === "camera";
    setText(byId("hint"), hint(this.page)); // of this side, also while the garment is turned over
    this.showProgress(state.progress);
    byId("cancel").hidden = state.phase !== "computing"; // nothing else can be cancelled
    this.showNotes(state);
    const isBehind = state.drawing && state.layers !== null; // without a picture, its place says so
    byId("busy").hidden = !isBehind;
    byId("stage").setAttribute("aria-busy", String(isBehind));
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

/** What to do next, in a line; without the keys where there are none. */
function hint(/** @type {Page} */ { thisSide, doubts }) {
  const text = doubts.asks ? doubts.question : nextOf(thisSide, doubts.told ?? "");
  return hasKeys() ? text : text.replace(/ \((Shift\+)?[A-Z.]\)/g, "");
}

/** @param {State} state @param {string} doubt about the shape */
function nextOf(state, doubt) {
  const angle = (/** @type {number | null} */ i) => `view ${i} (${number(state.views[i ?? 0].angle_deg, 0)}°)`;
  const { request, pending } = state;
  const { running, waits_for, ended } = state.auto;
  if (state.trouble || waits_for) return state.trouble || waits_for;
  if (state.drawing && !state.layers && state.phase !== "computing") return "The views of the session are flattened.";
  const { auto_until, auto_views } = state.settings;
  const until = auto_until === "views" ? `the shape has ${auto_views} views` : "no view adds cloth";
  const auto = running ? `Auto goes on until ${until}. ` : "";
  const at = running ? "Auto is on. " : "";
  if (state.active && ["ready", "finished"].includes(state.phase)) return auto + task(state.active);
  if (auto && state.phase !== "computing") return auto;
  if (ended && state.phase === "ready") return `Auto has ended: ${ended} Step (S) goes on.`;
  if (state.mode === "camera") return "";
  switch (state.phase) {
    case "computing":
      if (!request || request.kind === "start") return "Choosing and flattening the start view.";
      if (request.view_index === null) return `${at}Looking for the next view.`;
      return `${at}Placing ${angle(request.view_index)} on the shape.`;
    case "deciding":
      if (!pending) return "";
      return `Is ${angle(pending.view_index)} in its place? Accept (A), Reject (R), Skip (K), or drag it.`;
    case "finished":
      if (doubt) return `${endOf(state)}. ${doubt}: look at the doubts (Shift+Y).`;
      return (
        `${endOf(state)}. ` +
        (state.sides ? "Without masks, some may be of the wrong side (see Result). " : "") +
        "Click the cloth for a grasp point."
      );
    default:
      if (state.start_view === null) return "Press Step (S): the start view is chosen and flattened.";
      return "Press Step (S): the next view is chosen, flattened and placed on the shape.";
  }
}

/** How large the shape is, and what floats beside it. */
function shapeOf(/** @type {State} */ { step, layers, mode }) {
  if (!layers || mode === "camera") return [];
  const { pieces, area_cm2: floating } = floatingOf(layers);
  const floats = floating ? [`${cm2(floating)} float in ${count(pieces.length, "piece")}`] : [];
  return [`${cm2(layers.area_cm2)} from ${count(step, "view")}`, ...floats];
}
