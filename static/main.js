// The page: takes the server's states, gives them to its parts, and turns what the operator does into messages.

import { FlatCanvas } from "/static/canvas/canvas.js";
import { CapturePanel } from "/static/panels/capture.js";
import { Comparison, MODES, showBoth } from "/static/canvas/compare.js";
import { Connection } from "/static/page/connection.js";
import { byId, make, rebuild, setText } from "/static/page/dom.js";
import { showExports } from "/static/page/exports.js";
import { count, number } from "/static/page/format.js";
import { hint } from "/static/page/hints.js";
import { KeyPointer } from "/static/canvas/key_pointer.js";
import { startKeys } from "/static/page/keys.js";
import { LiveBar } from "/static/panels/live.js";
import { Looking } from "/static/canvas/look.js";
import { forgetServerLog, notify, showLog, startTips, takeServerLog } from "/static/page/notices.js";
import { isMove, KeyNudges } from "/static/canvas/nudges.js";
import { pickText, showPick, showPicks } from "/static/panels/picks.js";
import { showProposal } from "/static/panels/proposal.js";
import { showLegend, showReadout } from "/static/panels/readout.js";
import { markPresent, showTimeline } from "/static/panels/timeline.js";
import { showPalette } from "/static/page/palette.js";
import { Repair } from "/static/panels/repair.js";
import { Ruler } from "/static/canvas/ruler.js";
import { loadScene, startScene } from "/static/page/scene.js";
import { SettingsSheet } from "/static/panels/settings.js";
import { SourcePanel } from "/static/panels/sources.js";
import { Teaching } from "/static/teaching/teaching.js";
import { applyTheme, chosenTheme, setTheme, toggleTheme } from "/static/page/theme.js";
import { Diagnostics } from "/static/panels/diagnostics.js";
import { LAYERS, RejectMenu, showHelp, Toolbar } from "/static/page/toolbar.js";
import { Verdicts } from "/static/panels/verdicts.js";

let state = null;
let hoverId = 0;
let hoverWanted = null;
let hoverBusy = false;
let askedLayer = null; // in live mode: what the next frame was asked for with

const page = {
  layer: "color",
  setOpacity(value) {
    comparison.opacity = value;
    canvas.redraw();
  },
  setStep(mm, deg) {
    send({ type: "set", step_mm: mm, step_deg: deg });
  },
};

const canvas = new FlatCanvas({
  // In live mode the frame that was clicked is the one that is meant, not the one that is on its way.
  pick: (u, v) =>
    repair.takesClick(u, v) ||
    send({ type: "pick", u_m: u, v_m: v, ...(isLive() ? { revision: canvas.layerRevision } : {}) }),
  hover: (u, v) => hover(u === null ? null : { u_m: u, v_m: v }),
  nudge: (by) => sendMove(by),
  mayDrag: () => Boolean(state?.pending),
  moving: (by) => repair.ask(by),
  placed: () => repair.moved(),
});
const nudges = new KeyNudges(canvas, () => state, sendMove);
const comparison = (page.comparison = new Comparison(canvas, () => show(state)));
const looking = (page.looking = new Looking(canvas, () => state && show(state)));
const ruler = (page.ruler = new Ruler(canvas, send, () => show(state)));
const keyPointer = new KeyPointer();
const diagnostics = (page.diagnostics = new Diagnostics(canvas, send, () => show(state)));
const toolbar = new Toolbar(run, page);
const repair = new Repair(canvas, {
  send,
  notify,
  button: (name, title) => {
    const button = toolbar.button(name, title);
    button.dataset.tip = toolbar.tip(state.actions.find((a) => a.name === name));
    return button;
  },
});
const sources = new SourcePanel({
  button: (name, title) => toolbar.button(name, title),
  tip: (name) => toolbar.tip(state.actions.find((a) => a.name === name)),
});
const liveBar = new LiveBar({ send, drawn: drawFrame });
const teaching = new Teaching({
  actions: () => state.actions,
  tip: (action) => toolbar.tip(action),
  name: () => state.recording.name,
  startView: () => state.start_view,
  notify,
  run,
});
const capturePanel = new CapturePanel({
  send,
  button: (name) => toolbar.button(name),
  tip: (action) => toolbar.tip(action),
});
const verdicts = new Verdicts({
  notify,
  propose: proposeView,
  reopen: (view) => decide("reopen", { view_index: view.index }),
  action: (name) => state.actions.find((a) => a.name === name),
});
const settings = new SettingsSheet({ send, theme: chosenTheme, setTheme });
const rejectMenu = new RejectMenu((reason) => decide("reject", { reason }));

const connection = new Connection({
  message: (message) => HANDLERS[message.type]?.(message),
  frame: (buffer) => liveBar.take(buffer, askFrame),
  opened: (again) => {
    byId("banner").hidden = true;
    askedLayer = null;
    if (!again) return;
    forgetServerLog();
    repair.forget();
    loadScene(true);
  },
  lost: (seconds) => {
    byId("banner").hidden = false;
    setText(
      byId("banner"),
      `No connection to flatcloth. Trying again in ${number(seconds, 1)} s. If the program has ended, start it again: nothing is lost.`,
    );
    hoverBusy = false;
    ruler.forget();
  },
});

const HANDLERS = {
  state: (message) => show(message),
  progress: (message) => showProgress(message),
  capture: (message) => state?.capture && capturePanel.take(message),
  note: (message) => {
    ruler.forget();
    notify(message.level, message.text, message.time_s);
    if (!nudges.gesture) canvas.resetPreview(); // what was just refused may have been a move
  },
  preview: (message) => repair.takePreview(message),
  pairs: (message) => repair.takePairs(message),
  hover: (message) => {
    hoverBusy = false;
    if (message.id === hoverId) {
      showValues(message);
      sources.mark(message.source);
    }
    askHover();
  },
  measured: (message) => ruler.take(message),
};

function send(message) {
  const sent = connection.send(message);
  if (!sent && !["hover", "measure"].includes(message.type))
    notify("warning", "There is no connection; this was not done.");
  return sent;
}

// --- show --------------------------------------------------------------------------------------

function show(next) {
  state = next;
  byId("recording").textContent =
    `${state.recording.name} · ${count(state.recording.n_views, "view")} · method ${state.method}`;
  byId("recording").dataset.tip = state.recording.description || state.recording.name;
  document.title = `${state.recording.name} · flatcloth`;
  byId("live").hidden = !isLive();
  byId("hint").hidden = isLive();
  setText(byId("hint"), hint(state));
  toolbar.update(state);
  capturePanel.update(state);
  showProgress(state.progress);
  showNotes();
  showProposal(state, send);
  repair.update(state);
  showPick(state, copyPick, send);
  showPicks(state, send);
  showTimeline(state, chooseView);
  settings.update(state);
  sources.update(state);
  if (isLive()) showLive();
  else showLayer();
  takeServerLog(state.log);
}

const isLive = () => state?.mode === "live";

function showLive() {
  liveBar.update(state);
  // While playing, each frame brings the place of the current pick; the others would lag behind.
  if (!state.live.playing) canvas.pick = state.pick?.in_shape ? state.pick : null;
  canvas.showMarks(state.live.playing ? [] : state.picks);
  if (liveBar.frame) markPresent(liveBar.frame.view_index);
  looking.show(page.layer, null, (name, sign) => toolbar.button(name, sign), true);
  if (askedLayer !== page.layer) askFrame();
}

/** Tell the server that the last frame is drawn: it sends the next one when there is one. */
function askFrame() {
  askedLayer = page.layer;
  connection.send({ type: "ready", layer: page.layer });
}

function drawFrame(frame, shown) {
  canvas.showFrame(shown, frame.view_index, frame.pick_uv_m);
  canvas.draw(); // at once: this is an animation frame, and what is acknowledged has been drawn
  showLegend(frame.legend);
  markPresent(frame.view_index);
  byId("empty").hidden = shown !== null;
  setText(byId("empty"), frame.reason);
}

function showLayer() {
  canvas.update(state, page.layer, looking.query(page.layer));
  ruler.update(state.layers?.revision);
  diagnostics.update(state);
  comparison.update(state, looking.query(comparison.looked));
  const [looked, legend] = comparison.legend
    ? [comparison.looked, comparison.legend]
    : [page.layer, state.layers?.legends[page.layer]];
  showLegend(looking.legend(looked, legend));
  looking.show(looked, legend, (name, sign) => toolbar.button(name, sign), false);
  byId("empty").hidden = Boolean(state.layers);
  setText(
    byId("empty"),
    state.phase === "computing"
      ? "The start view is being flattened."
      : "Nothing is flattened yet. Press Step (S): the start view is chosen and flattened.",
  );
}

function showProgress(progress) {
  byId("progress").hidden = !progress;
  if (!progress) return;
  setText(byId("progress-text"), `${progress.text} · ${Math.round(100 * progress.share)} %`);
  byId("progress-bar").value = progress.share;
}

function showNotes() {
  const strip = byId("session-notes");
  const key = JSON.stringify([state.recording.name, state.notes]);
  strip.hidden = !state.notes.length || sessionStorage.getItem("flatcloth-notes") === key;
  rebuild(strip, key, () => [
    make("ul", {}, ...state.notes.map((text) => make("li", {}, text))),
    make(
      "button",
      {
        type: "button",
        class: "close",
        "aria-label": "Dismiss the notes",
        on: {
          click: () => {
            sessionStorage.setItem("flatcloth-notes", key);
            strip.hidden = true;
          },
        },
      },
      "×",
    ),
  ]);
}

// --- do ----------------------------------------------------------------------------------------

function decide(action, more = {}) {
  nudges.flush();
  // The view that this user sees is the view that is meant, whatever has changed meanwhile.
  const view =
    ["accept", "reject", "skip"].includes(action) && state.pending ? { view_index: state.pending.view_index } : {};
  send({ type: "do", action, ...view, ...more });
}

function chooseView(view) {
  if (state.capture) return notify("info", view.why_not);
  if (isLive()) return send({ type: "play", frame: view.index });
  verdicts.press(view);
}

function proposeView(view) {
  if (view.why_not !== null) return notify("info", view.why_not);
  decide("view", { view_index: view.index });
}

function run(name, large = false) {
  if (!state || teaching.takes(name) || (name === "cancel" && ruler.escape())) return;
  const action = state.actions.find((a) => a.name === name);
  if (action.why_not !== null) {
    // Escape closes things all the time; it needs no lecture.
    if (name !== "cancel") notify("warning", action.why_not);
    else if (repair.picking) PAGE_ACTIONS.pairs();
    return;
  }
  if (name in LAYERS) {
    page.layer = LAYERS[name];
    show(state);
  } else if (name in MODES) {
    comparison.choose(name);
  } else if (isMove(name)) {
    nudges.move(name, large ? 10 : 1);
  } else if (name in PAGE_ACTIONS) {
    PAGE_ACTIONS[name]();
  } else {
    decide(name);
  }
}

const PAGE_ACTIONS = {
  auto: () => {
    nudges.flush();
    send({ type: "auto", running: !state.auto.running });
  },
  reject_menu: () => rejectMenu.open(state.reject_reasons),
  pairs: () => {
    repair.toggle();
    show(state);
  },
  fit_pairs: () => {
    nudges.flush();
    repair.fitNow();
  },
  refine: () => {
    nudges.flush();
    send({ type: "refine", view_index: state.pending.view_index });
  },
  reopen: () => verdicts.reopen(state),
  next_undecided: () => verdicts.nextUndecided(state),
  lowest_score: () => verdicts.lowestScore(state),
  diagnostics: () => diagnostics.toggle(),
  look: () => looking.toggle(),
  turn_left_seen: () => looking.turnBy(-1),
  turn_right_seen: () => looking.turnBy(1),
  flip: () => looking.flip(),
  grid: () => {
    looking.grid = !looking.grid;
    canvas.redraw();
    show(state);
  },
  ruler: () => ruler.toggle(),
  pointer: () => keyPointer.toggle(),
  source_image: () => sources.fold(),
  source_mask: () => sources.toggleMask(),
  fit: () => canvas.fit(),
  zoom_in: () => canvas.zoomBy(1.4),
  zoom_out: () => canvas.zoomBy(1 / 1.4),
  follow: () => {
    const on = state.settings.follow.value;
    if (send({ type: "set", follow: !on }))
      notify("info", on ? "The 3D camera stays where it is." : "The 3D camera follows the view.");
  },
  copy: copyPick,
  export: () => showExports(notify, state.recording.name),
  settings: () => settings.open(),
  palette: () =>
    showPalette(
      state.actions.filter((a) => a.name !== "palette" && ["", modesNow()[0]].includes(a.mode)),
      run,
    ),
  log: showLog,
  theme: toggleTheme,
  help: () => showHelp(state.actions, state.mode),
  live_play: () => send({ type: "play", playing: !state.live.playing }),
  live_back: () => send({ type: "play", step: -1 }),
  live_forward: () => send({ type: "play", step: 1 }),
  capture_turned: () => capturePanel.do("capture_turned"),
  capture_keep: () => capturePanel.do("capture_keep"),
  capture_repeat: () => capturePanel.do("capture_repeat"),
  live_turn: () => send({ type: "play", forward: !state.live.forward }),
};

/** The modes whose keys come first, the uppermost first. */
const modesNow = () => [
  ...(teaching.status.open ? ["teaching"] : []),
  ...(state.capture ? ["capture"] : []),
  isLive() ? "live" : "session",
];

function sendMove(by) {
  send({ type: "move", view_index: state.pending.view_index, theta_rad: by.theta, u_m: by.u, v_m: by.v });
}

function hover(at) {
  diagnostics.hover(at);
  hoverWanted = at;
  if (at === null) {
    hoverId += 1;
    showValues(null);
    sources.mark(null);
  } else {
    askHover();
  }
}

function showValues(answer) {
  showReadout(answer);
  showBoth(answer);
}

function askHover() {
  // One question at a time, always about the latest place.
  if (hoverBusy || !hoverWanted || !state?.layers) return;
  hoverId += 1;
  hoverBusy = send({ type: "hover", id: hoverId, ...hoverWanted, ...sources.asked });
  hoverWanted = null;
}

async function copyPick() {
  if (!state.pick) return notify("info", "There is no pick to copy; click the cloth first.");
  const text = pickText(state.pick);
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    // Without https or permission there is only the old way.
    const area = make("textarea", { class: "unseen", readonly: true }, text);
    document.body.append(area);
    area.select();
    const done = document.execCommand("copy");
    area.remove();
    if (!done) return notify("warning", "The browser does not allow copying.");
  }
  notify("info", `Copied the numbers of ${state.pick.name}.`);
}

byId("cancel").addEventListener("click", () => run("cancel"));
applyTheme();
startTips();
startScene(startKeys({ state: () => state, modes: modesNow, run }));
showValues(null);

window.flatcloth = {
  get state() {
    return state;
  },
  get revision() {
    return state?.revision ?? 0;
  },
  get step() {
    return state?.step ?? 0;
  },
  get phase() {
    return state?.phase ?? null;
  },
  get pick() {
    return state?.pick ?? null;
  },
  get frame() {
    return liveBar.frame;
  },
  get teaching() {
    return teaching.status;
  },
  get capture() {
    return capturePanel.status;
  },
  get sources() {
    return sources.status;
  },
  get fps() {
    return liveBar.fps;
  },
  get layerRevision() {
    return canvas.layerRevision;
  },
  get diagnostics() {
    return diagnostics.status;
  },
  get differenceShown() {
    return comparison.shownKind;
  },
  get overlayRevision() {
    return canvas.overlay.shown?.revision ?? 0;
  },
  get pairEnds() {
    return repair.ends().map(({ x, y }) => [x, y]);
  },
  toScreen: (u, v) => canvas.toScreen(u, v),
  toPlane: (x, y) => canvas.toPlane(x, y),
  send,
};
