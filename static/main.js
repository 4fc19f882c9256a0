// The page: takes the server's states, gives them to its parts, and turns what the operator does into messages.

import { FlatCanvas } from "./canvas/canvas.js";
import { boxOf } from "./canvas/geometry.js";
import { Handles } from "./canvas/handles.js";
import { Comparison } from "./canvas/compare.js";
import { KeyPointer } from "./canvas/key_pointer.js";
import { isMove, KeyNudges } from "./canvas/nudges.js";
import { Looking } from "./canvas/look.js";
import { Ruler } from "./canvas/ruler.js";
import { Column } from "./layout/column.js";
import { Layout } from "./layout/layout.js";
import { GESTURES, showCommands } from "./page/commands.js";
import { Connection } from "./page/connection.js";
import { Dial, SceneMarks } from "./page/scene_marks.js";
import { byId, showWords } from "./page/dom.js";
import { showExports, startExports } from "./page/exports.js";
import { number } from "./page/format.js";
import { Hover } from "./page/hover.js";
import { startKeys } from "./page/keys.js";
import { forgetServerLog, notify, showLog, startTips, takeServerLog } from "./page/notices.js";
import { Page } from "./page/page.js";
import { Toolbar } from "./page/toolbar.js";
import { Roving } from "./page/roving.js";
import { loadScene, openScene, startScene } from "./page/scene.js";
import { StatusLines } from "./page/status.js";
import { seen } from "./both/seen.js";
import { applyTheme, onTheme, toggleTheme } from "./page/theme.js";
import { PANELS } from "./panels/index.js";
import { showLegend } from "./panels/readout.js";
import { Repair } from "./panels/repair.js";
import { ReviewList } from "./review/list.js";
import { ResultPanel } from "./review/result.js";
import { Timeline } from "./review/timeline.js";
import { loadFrame } from "./teaching/frame.js";
import { Teaching } from "./teaching/teaching.js";

byId("unloaded").remove();

const PATIENCE_MS = 8000; // with the first picture: without compiled kernels it takes a minute
const AGAIN_MS = 400; // a second press so soon after a verdict is the same one: nobody has looked at the next view
const LEAST_MOVE_M = 0.00005; // what is shown as 0.0 mm and 0.0° is no move
const LEAST_TURN_RAD = (0.05 * Math.PI) / 180;

const page = new Page({ send, notify, run, show, decide, pick, move });
const canvas = (page.canvas = new FlatCanvas(page));
let acceptsOnceDrawn = false; // Accept was pressed before the proposal was drawn
let decidedMs = -Infinity; // when the last verdict was given
const nudges = page.add(new KeyNudges(page));
page.add(new Hover(page));
const comparison = (page.comparison = page.add(new Comparison(page)));
page.looking = page.add(new Looking(page));
page.add(new Ruler(page));
page.add(new Toolbar(page));
const layout = page.add(new Layout(page));
page.sceneMarks = page.add(new SceneMarks(page));
page.add(new Dial(page));
page.add(new StatusLines(page));
for (const Panel of PANELS) page.add(new Panel(page));
const repair = page.add(new Repair(page));
page.add(new Handles(page, () => repair.picking));
page.timeline = page.add(new Timeline(page));
page.add(new ReviewList(page));
page.add(new ResultPanel(page));
const column = (page.column = page.add(new Column(page))); // after all that have a part of it
page.add(new Roving(page));
page.add({ placed: acceptOnceDrawn, pictured });
const keyPointer = new KeyPointer();
/** The lessons, once they are wanted. @type {Teaching | null} */
let teaching = null;

const connection = new Connection({
  message(message) {
    if (message.type === "switched") return location.replace("./");
    if (message.type === "state") show({ ...page.thisSide, ...message });
    else if (message.type === "note") takeNote(message);
    page.take(message);
  },
  opened(again) {
    byId("banner").hidden = true;
    if (!again) return;
    forgetServerLog();
    page.each("reconnected");
    loadScene();
  },
  lost(seconds, refusal) {
    const again = `Trying again in ${number(seconds, 1)} s.`;
    const ended = `No connection to flatcloth. ${again} If the program has ended, start it again: nothing is lost.`;
    showWords(byId("banner"), refusal === null ? ended : `No connection to flatcloth. ${refusal} ${again}`);
    if (refusal === null) page.each("disconnected");
  },
});

/** Whether there is something to move: the proposal, or cloth in doubt. */
function mayMove() {
  return Boolean(page.state?.pending || page.doubts.held);
}

/** @type {Send} */
function send(message) {
  const sent = connection.send(message);
  if (!sent && !["drawn", "hover", "measure"].includes(message.type))
    notify("warning", "There is no connection; this was not done.");
  return sent;
}

function takeNote(/** @type {Note} */ message) {
  notify(message.level, message.text, message.time_s);
  if (!nudges.gesture && page.state?.pending) canvas.resetPreview(); // what was just refused may have been a move
}

// --- show --------------------------------------------------------------------------------------

/** What is large, or takes the server a while, comes once the first picture is there, or where none is on its way. */
function settle() {
  if (page.isSettled) return;
  page.isSettled = true;
  openScene();
  page.changed();
}

function pictured() {
  settle();
  // An animation frame comes only where somebody looks.
  const { layerRevision: revision } = canvas;
  if (page.hasCamera) requestAnimationFrame(() => send({ type: "drawn", revision }));
}

function show(/** @type {State} */ state) {
  page.thisSide = state;
  page.state = seen(state, canvas.side);
  if (page.hasCamera || !(state.layers || state.drawing || state.phase === "computing")) settle();
  else if (state.sides) openScene(); // while they are being found, it shows a view
  page.each("update", page.state);
  showLayer(page.state);
  takeServerLog(state.log, state.auto.running);
  acceptOnceDrawn();
}

function showLayer(/** @type {State} */ state) {
  if (page.hasCamera && state.layers) canvas.hold(boxOf(state.layers));
  canvas.update(state, page.layer);
  showLegend(comparison.legend ?? state.layers?.legends[page.layer]);
  showWords(byId("empty"), state.layers ? "" : whyEmpty(state));
}

function whyEmpty(/** @type {State} */ { trouble, start_view, phase }) {
  if (trouble || page.hasCamera) return trouble;
  if (start_view !== null) return "The shape of the session is being drawn.";
  if (phase === "computing") return "The start view is being flattened.";
  return "Nothing is flattened yet. Press Step (S): the start view is chosen and flattened.";
}

// --- do ----------------------------------------------------------------------------------------

/** Whether the proposal is on its way: it is being computed, or drawn. */
function isProposalAwaited() {
  const { phase, request, pending, drawing, layers } = page.thisSide;
  if (phase === "computing") return request !== null && request.kind !== "start";
  return pending !== null && (drawing || canvas.overlay.shown?.revision !== layers?.overlay?.revision);
}

/** Accept was pressed too early: it is done when the proposal is seen, if nothing else was done meanwhile. */
function acceptOnceDrawn() {
  if (!acceptsOnceDrawn || isProposalAwaited()) return;
  acceptsOnceDrawn = false;
  if (page.thisSide.pending) run("accept");
}

function decide(/** @type {string} */ name, more = {}) {
  const action = /** @type {import("./page/messages").Do["action"]} */ (name);
  nudges.flush();
  const { pending } = page.thisSide;
  // The view that this user sees is the view that is meant, whatever has changed meanwhile.
  const isVerdict = ["accept", "reject", "skip"].includes(action) && pending !== null;
  if (isVerdict && performance.now() - decidedMs < AGAIN_MS) return;
  if (isVerdict) decidedMs = performance.now();
  send({ type: "do", action, ...(isVerdict ? { view_index: pending.view_index } : {}), ...more });
}

function run(/** @type {string} */ name, large = false) {
  if (!page.state || teaching?.takes(name)) return;
  if (name.startsWith("teach_")) return notify("info", "Open the teaching mode first (H).");
  const isKept = acceptsOnceDrawn; // what is done now takes its place
  acceptsOnceDrawn = name === "accept" && isProposalAwaited() && performance.now() - decidedMs >= AGAIN_MS;
  if (acceptsOnceDrawn) return notify("info", "The view is accepted once it is drawn; Esc takes this back.");
  if (name === "cancel" && (isKept || page.offer("escape"))) return;
  const action = page.action(name);
  if (action.why_not !== null && !(isMove(name) && page.doubts.held)) {
    // Escape closes things all the time; it needs no lecture.
    if (name !== "cancel") notify("warning", action.why_not);
    return;
  }
  if (name === "accept" && page.panels.some((panel) => panel.mayAccept?.(page.state) === false)) return;
  if (!isMove(name)) nudges.flush(); // what is done next is meant for where the keys have moved the proposal
  layout.reveal(name);
  if (column.brings(name)) return;
  const perform = PAGE_ACTIONS[name] ?? page.actionOf(name);
  if (perform) perform(large);
  else decide(name);
  column.reveal(name);
}

const PART = { description: "Show this part of the column.", keys: [], group: "column" };

async function openLessons() {
  await loadFrame();
  teaching ??= page.add(new Teaching(page));
  teaching.takes("teach");
}

/** @type {NonNullable<Panel["actions"]>} */
const PAGE_ACTIONS = {
  teach: openLessons,
  auto: () => send({ type: "auto", running: !page.state.auto.running }),
  reject_menu() {
    const about = { description: "Reject the proposed view for this reason.", group: "reasons" };
    const rows = page.state.reject_reasons.map((name, n) => ({ name, title: name, keys: [String(n + 1)], ...about }));
    showCommands(rows, (reason) => decide("reject", { reason }), "Why is the view rejected?");
  },
  pointer: () => keyPointer.toggle(),
  fit: () => canvas.fit(),
  zoom_in: () => canvas.zoomBy(1.4),
  zoom_out: () => canvas.zoomBy(1 / 1.4),
  follow() {
    const on = page.state.settings.follow;
    if (!send({ type: "set", values: { follow: !on } })) return;
    notify("info", on ? "The 3D camera stays where it is." : "The 3D camera follows the view.");
  },
  export: () => showExports(page.state),
  home: () => location.assign("start"),
  log: showLog,
  theme: toggleTheme,
  help() {
    const modes = ["", "doubt", ...modesNow()];
    const known = page.state.actions.filter((a) => a.name !== "help" && modes.includes(a.mode));
    const parts = column.parts.filter(([part]) => !page.action(part));
    const rows = parts.map(([name, title]) => ({ ...known[0], name, title, ...PART, why_not: null }));
    showCommands([...known, ...rows, ...GESTURES], (name) => (page.action(name) ? run(name) : column.choose(name)));
  },
};

/** The modes whose keys come first, the uppermost first. */
const modesNow = () => [
  ...(teaching?.open ? ["teaching"] : []),
  ...(page.doubts.asks || (page.doubts.shown && !page.state.pending) ? ["doubt"] : []),
  ...(page.state.capture || page.state.active ? ["capture"] : []),
  ...(page.hasCamera ? [] : ["session"]),
];

/** @param {number} u @param {number} v */
function pick(u, v) {
  if (page.offer("click", u, v)) return;
  // With a camera the frame that was clicked is the one that is meant, not the one that is on its way.
  send({ type: "pick", ...canvas.located(u, v), ...(page.hasCamera ? { revision: canvas.layerRevision } : {}) });
}

function move(/** @type {By} */ by) {
  if (!page.state.pending) return;
  const seen = Math.hypot(by.u, by.v) >= LEAST_MOVE_M || Math.abs(by.theta) >= LEAST_TURN_RAD;
  if (!seen) return canvas.resetPreview();
  const { view_index } = page.state.pending;
  send({ type: "move", view_index, theta_rad: by.theta, u_m: by.u, v_m: by.v });
}

byId("cancel").addEventListener("click", () => run("cancel"));
onTheme(() => page.redrawMarks()); // their colours are those of the theme
applyTheme();
startTips();
startExports(notify, () => page.state);
startScene(startKeys({ state: () => page.state, modes: modesNow, mayMove, run }));
setTimeout(openScene, PATIENCE_MS);
page.each("hovered", null);

// For tests: what is shown, and the parts of the page by their names.
const shown = {
  state: () => page.state,
  step: () => page.state?.step ?? 0,
  phase: () => page.state?.phase ?? null,
  pick: () => page.state?.pick ?? null,
  layerRevision: () => canvas.layerRevision,
  overlayRevision: () => canvas.overlay.shown?.revision ?? 0,
  teaching: () => teaching,
};
const flatcloth = { canvas, toScreen: canvas.toScreen.bind(canvas), toPlane: canvas.toPlane.bind(canvas), send };
for (const panel of page.panels) if (panel.name) Object.assign(flatcloth, { [panel.name]: panel });
for (const [name, get] of Object.entries(shown)) Object.defineProperty(flatcloth, name, { get });
Object.assign(window, { flatcloth });
