// The teaching mode: the stages of the method on the current recording. It only asks; it decides nothing.

import {
  byId,
  find,
  findAll,
  make,
  rebuild,
  setAllowed,
  setCurrent,
  setText,
  isPlain,
  taken,
  targetOf,
  WAYS,
  within,
} from "../page/dom.js";
import { number, tipOf } from "../page/format.js";
import { Sheet, inset } from "./draw.js";
import { action, connectFrame, fitMath, FRAME, showLayers, STAGES, symbols } from "./frame.js";
import { fetchLesson, LessonError } from "./lesson.js";
import { onTheme } from "../page/theme.js";

const AHEAD = /** @type {PartName[]} */ (["flattening", "planning", "alignment"]); // asked for before they are wanted
const PARTS = /** @type {PartName[]} */ ([...AHEAD, "start", "sides", "garment", "seams", "check", "shape"]);
const PARAMETERS = /** @type {ParameterName[]} */ (["sampling_interval_px", "z_angle_limit_deg", "overlap_cm2"]);
const STATE_MS = 650; // how long the way from one recorded state to the next takes
const QUIET_MS = 120; // progress is shown only for what takes longer
const OURS = ["teach", "teach_next", "teach_back", "teach_play", "cancel"];
const PASSED_ON = ["theme", "help", "log", "settings", "palette"];

/** @type {Entry} */
const NOTHING = { key: null, lesson: null, error: null, abort: null };

export class Teaching {
  constructor(/** @type {Session} */ session) {
    this.session = session;
    this.at = 0;
    this.changed = /** @type {Partial<Record<ParameterName, number>>} */ ({}); // the learner's parameters
    this.lessons = /** @type {Partial<Record<PartName, Entry>>} */ ({});
    /** @type {Ui} */
    this.ui = { at: [0, 0], layer: "color", time: 0, parameters: /** @type {Ui["parameters"]} */ ({}) };
    this.probe = /** @type {{ at: UV; moved: boolean; lesson?: Lesson } | null} */ (null); // where the learner points
    this.drawn = 0;
    this.canvas = /** @type {HTMLCanvasElement} */ (find("canvas", FRAME));
    this.sheet = new Sheet(this.canvas, {
      redraw: () => this.redraw(),
      probe: (key, at) => {
        if (key !== STAGES[this.at].probe) return;
        this.probe = { at, moved: true };
        this.update();
      },
    });
    this.playing = /** @type {number | null} */ (null); // the animation frame of the player, and of the next drawing
    this.waiting = /** @type {number | null} */ (null);
    this.round = 0;
    this.autoplay = false;
    this.shown = /** @type {{ stage: number; key: string | null; parameters: object } | null} */ (null); // for tests
    this.behind = /** @type {HTMLElement[]} */ ([]); // what lies behind it
    this.opener = /** @type {HTMLElement | null} */ (null); // what had the focus
  }

  get open() {
    return FRAME.isConnected && !FRAME.hidden;
  }

  /** What tests want to know. */
  get status() {
    return {
      open: this.open,
      stage: this.at + 1,
      name: STAGES[this.at].name,
      drawn: this.drawn,
      time: this.ui.time,
      playing: Boolean(this.playing),
      busy: PARTS.some((p) => this.lessons[p]?.abort),
      parameters: this.parameters(),
      shown: this.shown,
      error: this.lessons[STAGES[this.at].part]?.error ?? null,
    };
  }

  /** Take an action of the page's table; returns whether it was meant for the teaching mode. */
  takes(/** @type {string} */ name) {
    if (!this.open) {
      if (name !== "teach" || action(this, name).why_not !== null) return false; // the page says why
      this.enter();
      return true;
    }
    if (PASSED_ON.includes(name)) return false;
    if (!OURS.includes(name)) return true; // nothing is decided from in here
    if (name === "teach") this.leave();
    else if (name === "teach_next") this.go(this.at + 1);
    else if (name === "teach_back") this.go(this.at - 1);
    else if (name === "teach_play") this.play(!this.playing);
    else this.cancelOrLeave();
    return true;
  }

  // --- in and out ------------------------------------------------------------------------------

  enter() {
    if (!FRAME.isConnected) this.begin();
    this.opener = /** @type {HTMLElement | null} */ (document.activeElement);
    this.behind = /** @type {HTMLElement[]} */ ([...document.body.children]).filter(
      (e) => e !== FRAME && !e.inert && e.id !== "notes" && e.tagName !== "DIALOG",
    );
    for (const element of this.behind) element.inert = true;
    FRAME.hidden = false;
    setText(byId("teaching-recording"), this.session.name());
    this.go(this.at);
    byId("teaching-next").focus();
  }

  leave() {
    this.play(false);
    for (const part of PARTS) this.abort(part);
    FRAME.hidden = true;
    for (const element of this.behind) element.inert = false;
    this.opener?.focus?.();
  }

  cancelOrLeave() {
    if (!PARTS.some((p) => this.lessons[p]?.abort && p === STAGES[this.at].part)) return this.leave();
    this.giveUp();
  }

  /** Stop computing, and go back to the values of what is shown. */
  giveUp() {
    for (const part of PARTS) this.abort(part);
    this.round += 1;
    const part = STAGES[this.at].part;
    const entry = this.lessons[part];
    const shown = entry?.lesson;
    if (entry && shown) {
      const other = PARAMETERS.filter((name) => shown.parameters[name] !== shown.defaults[name]);
      this.changed = Object.fromEntries(other.map((name) => [name, shown.parameters[name]]));
      entry.key = this.key(part);
    } else {
      this.lessons[part] = { ...NOTHING, error: "Cancelled: this stage has not been computed." };
    }
    this.update();
  }

  // --- the stages ------------------------------------------------------------------------------

  go(/** @type {number} */ index) {
    if (index < 0 || index >= STAGES.length) return;
    const stage = STAGES[index];
    const moved = index !== this.at;
    if (moved || !this.shown) {
      this.play(false);
      this.at = index;
      this.ui = { ...this.ui, time: 0, layer: "color" };
      this.probe = null;
      this.autoplay = Boolean(stage.plays) && !matchMedia("(prefers-reduced-motion: reduce)").matches;
    }
    if (stage.part === "seams" && !this.session.other()) this.session.findOther();
    this.showTexts();
    this.load();
    this.update();
  }

  /** Take a new state of the session: its other side may be known by now. */
  follow() {
    const { part } = STAGES[this.at];
    this.showProgress();
    if (this.open && ["seams", "shape"].includes(part) && this.lessons[part]?.key !== this.key(part)) this.load();
  }

  parameters() {
    const known = PARTS.map((p) => this.lessons[p]?.lesson?.defaults).find(Boolean) ?? {};
    return { ...known, ...this.changed };
  }

  query(/** @type {PartName} */ part) {
    if (part === "sides") return {}; // the same whatever is changed
    if (part === "garment") return { revision: this.session.garment() };
    if (part === "seams") return { revision: this.session.other() };
    if (part === "shape") return { known: Number(this.session.shape() !== null) };
    const start = this.session.startView();
    /** @type {Record<string, number>} */
    const query = start === null ? {} : { start_view: start };
    for (const [name, value] of Object.entries(this.changed))
      if (part !== "flattening" || name === "sampling_interval_px") query[name] = value;
    return query;
  }

  /** What a lesson depends on: also the number of views, which grows while a cell turns. */
  key(/** @type {PartName} */ part) {
    return JSON.stringify([this.query(part), this.session.views()]);
  }

  /** Ask for what this stage needs, then for the rest, so that the next stages are there at once. */
  async load() {
    const first = STAGES[this.at].part;
    const round = (this.round += 1);
    for (const part of [first, ...AHEAD.filter((p) => p !== first)]) {
      if (round !== this.round || !this.open) return;
      await this.fetch(part, part === first);
    }
  }

  async fetch(/** @type {PartName} */ part, /** @type {boolean} */ wanted) {
    const query = this.query(part);
    const key = this.key(part);
    const before = this.lessons[part];
    if (part === "shape") {
      const lesson = this.session.shape();
      const error = lesson ? null : "The shape of this session is not known yet: it is being drawn, or asked for.";
      this.lessons[part] = { ...NOTHING, key, lesson, error };
      return this.update();
    }
    if (before?.key === key && (before.abort || before.lesson || !wanted)) return before.promise;
    this.abort(part);
    const abort = new AbortController();
    /** @type {Entry} */
    const entry = (this.lessons[part] = { ...NOTHING, key, lesson: before?.lesson ?? null, abort });
    entry.promise = (async () => {
      try {
        const lesson = await fetchLesson(part, query, abort.signal);
        Object.assign(entry, { lesson, stale: false });
      } catch (error) {
        if (abort.signal.aborted) return;
        const expected = error instanceof LessonError;
        Object.assign(entry, { lesson: null, error: expected ? error.message : `Unexpected error: ${error}` });
        if (!expected) console.error(error);
      }
      entry.abort = null;
      if (this.lessons[part] === entry) this.update();
    })();
    setTimeout(() => this.showProgress(), QUIET_MS);
    entry.since = performance.now();
    return entry.promise;
  }

  abort(/** @type {PartName} */ part) {
    const entry = this.lessons[part];
    if (!entry?.abort) return;
    entry.abort.abort();
    // What was shown before stays, and is asked for anew when it is wanted.
    this.lessons[part] = { ...entry, abort: null, key: null };
  }

  change(/** @type {string} */ name, /** @type {number} */ value) {
    this.changed = { ...this.changed, [name]: value };
    this.load();
    this.update();
  }

  reset() {
    this.changed = {};
    this.load();
    this.update();
  }

  // --- playing ---------------------------------------------------------------------------------

  play(/** @type {boolean} */ on) {
    cancelAnimationFrame(this.playing ?? 0);
    this.playing = null;
    const last = this.lastTime();
    if (on && last > 0) {
      if (this.ui.time >= last) this.ui.time = 0;
      let before = performance.now();
      const tick = (/** @type {number} */ now) => {
        this.ui.time = Math.min(last, this.ui.time + Math.max(0, now - before) / STATE_MS);
        before = now;
        this.playing = this.ui.time < last ? requestAnimationFrame(tick) : null;
        this.update();
      };
      this.playing = requestAnimationFrame(tick);
    }
    if (this.open) this.showPlayer();
  }

  lastTime() {
    const stage = STAGES[this.at];
    const lesson = this.lessons[stage.part]?.lesson;
    return stage.plays && lesson ? Math.max(0, stage.plays(this.all())) : 0;
  }

  all() {
    const made = Object.fromEntries(PARTS.map((p) => [p, this.lessons[p]?.lesson ?? null]));
    return /** @type {Lessons} */ (/** @type {unknown} */ (made)); // a stage is drawn when its own is there
  }

  // --- the page --------------------------------------------------------------------------------

  begin() {
    connectFrame(this);
    FRAME.addEventListener("keydown", (event) => onKey(this, event));
    new ResizeObserver(() => this.open && this.draw()).observe(find(".teaching-sheet", FRAME));
    onTheme(() => this.open && this.redraw());
  }

  /** What changes only with the stage. */
  showTexts() {
    const stage = STAGES[this.at];
    findAll(".teaching-stage").forEach((button, index) => {
      const here = index === this.at;
      button.tabIndex = here ? 0 : -1; // one stop for Tab; the arrow keys go on from there
      setCurrent(button, here, "step");
      if (here) button.scrollIntoView({ block: "nearest", inline: "nearest" });
    });
    for (const { about } of STAGES) about.hidden = about !== stage.about;
    setText(byId("teaching-place"), `Stage ${this.at + 1} of ${STAGES.length}: ${stage.name}`);
    fitMath();
    find(".teaching-text").scrollTop = 0;
    const ends = {
      "teaching-back": this.at === 0 ? "This is the first stage." : null,
      "teaching-next": this.at === STAGES.length - 1 ? "This is the last stage." : null,
    };
    for (const [id, why] of Object.entries(ends)) {
      const name = id === "teaching-back" ? "teach_back" : "teach_next";
      setAllowed(byId(id), why, tipOf(action(this, name)));
    }
    byId("teaching-next").classList.toggle("primary", this.at < STAGES.length - 1);
    this.canvas.tabIndex = stage.probe ? 0 : -1;
    byId("teaching-layers").hidden = true;
  }

  /** What changes with the lessons, the parameters, the time and the probe. */
  update() {
    if (!this.open) return;
    const stage = STAGES[this.at];
    const entry = this.lessons[stage.part];
    const lessons = this.all();
    const lesson = entry?.lesson;
    this.showSliders(stage);
    this.showProgress();
    const trouble = entry?.error ?? null;
    byId("teaching-trouble").hidden = trouble === null;
    setText(byId("teaching-trouble-text"), trouble ?? "");
    byId("teaching-defaults").hidden = !Object.keys(this.changed).length;
    this.canvas.style.visibility = lesson && trouble === null ? "visible" : "hidden";
    byId("teaching-facts").hidden = !lesson;
    FRAME.classList.toggle("unknown", !lesson);
    if (lesson) {
      showLayers(this, stage, lesson);
      this.ui.parameters = /** @type {Ui["parameters"]} */ (this.parameters());
      this.ui.time = Math.min(this.ui.time, this.lastTime());
      for (const [name, text] of Object.entries(stage.values?.(lessons) ?? {}))
        for (const place of findAll(`[data-value="${name}"]`, stage.about)) setText(place, text);
      if (this.autoplay) {
        this.autoplay = false;
        return this.play(true);
      }
    }
    this.showPlayer();
    this.redraw();
  }

  redraw() {
    if (this.waiting || !this.open) return;
    this.waiting = requestAnimationFrame(() => {
      this.waiting = null;
      this.draw();
    });
  }

  draw() {
    const stage = STAGES[this.at];
    const lessons = this.all();
    if (!this.open || !lessons[stage.part]) return;
    const lesson = lessons[stage.part];
    if (stage.probe && !this.probe?.moved && this.probe?.lesson !== lesson)
      this.probe = { at: stage.start?.(lessons) ?? [0, 0], moved: false, lesson };
    if (this.probe) this.ui.at = this.probe.at;
    const rect = this.sheet.begin();
    stage.draw(this.sheet, inset(rect, 14, 10, 14, 14), lessons, this.ui);
    this.showFacts(stage.facts(lessons, this.ui).filter((fact) => fact !== null));
    const key = this.lessons[stage.part]?.key ?? null;
    this.shown = { stage: this.at + 1, key, parameters: lesson.parameters };
    this.drawn += 1;
  }

  showFacts(/** @type {Fact[]} */ facts) {
    const list = byId("teaching-facts");
    const names = facts.map(([name]) => name);
    rebuild(list, names, () => names.map((name) => [make("dt", { data: { name } }, symbols(name)), make("dd")]));
    facts.forEach(([, value], i) => setText(list.children[2 * i + 1], value));
    const { name: title, probe } = STAGES[this.at];
    const text = facts.map(([name, value]) => `${name}: ${value}`).join("; ");
    this.canvas.setAttribute("aria-label", `${title}. ${text}.${probe ? " The arrow keys move the pointer." : ""}`);
  }

  showSliders(/** @type {Stage} */ stage) {
    const lesson = PARTS.map((p) => this.lessons[p]?.lesson).find(Boolean);
    byId("teaching-sliders").hidden = !lesson || !stage.parameters.length;
    if (!lesson) return;
    const values = this.parameters();
    for (const label of findAll(".teaching-slider")) {
      const name = /** @type {ParameterName} */ (label.dataset.slider);
      const value = values[name] ?? lesson.defaults[name];
      const { low: min, high: max, step } = lesson.sliders[name];
      const input = /** @type {HTMLInputElement} */ (find("input", label));
      label.hidden = !stage.parameters.includes(name);
      if (Number(input.min) !== min || Number(input.max) !== max || Number(input.step) !== step)
        Object.assign(input, { min, max, step });
      if (Number(input.value) !== value) input.value = String(value);
      const output = find("output", label);
      const text = `${number(value, 0)}${output.dataset.unit}`;
      setText(output, text);
      input.setAttribute("aria-valuetext", text);
    }
    const same = PARAMETERS.every((name) => (this.changed[name] ?? lesson.defaults[name]) === lesson.defaults[name]);
    setAllowed(
      byId("teaching-reset"),
      same ? "These are the session's values." : null,
      "Back to the session's values.",
    );
  }

  showPlayer() {
    const last = this.lastTime();
    byId("teaching-player").hidden = last <= 0;
    if (last <= 0) return;
    const bar = byId("teaching-time");
    bar.max = String(last);
    bar.value = String(this.ui.time);
    bar.setAttribute("aria-valuetext", `${Math.round((100 * this.ui.time) / last)} %`);
    setText(byId("teaching-play").children[0], this.playing ? "Pause" : "Play");
  }

  scrub(/** @type {number} */ time) {
    this.play(false);
    this.ui.time = time;
    this.update();
  }

  showProgress() {
    if (!this.open) return;
    const entry = this.lessons[STAGES[this.at].part];
    const busy = Boolean(entry?.abort) && performance.now() - (entry?.since ?? 0) >= QUIET_MS - 5;
    byId("teaching-progress").hidden = !busy;
    FRAME.classList.toggle("busy", busy);
    if (!busy) return;
    const { share, text } = this.session.progress() ?? { share: 0, text: "Waiting" };
    setText(byId("teaching-progress-text"), `${text} · ${Math.round(100 * share)} %`);
    byId("teaching-progress-bar").value = share;
  }

  again() {
    const part = STAGES[this.at].part;
    this.lessons[part] = { ...NOTHING, ...this.lessons[part], key: null, error: null };
    this.load();
    this.update();
  }
}

// --- The arrow keys of the teaching mode -------------------------------------------------------

const PROBE_STEP = 0.02; // of the shorter side of a pane, per arrow key

export function onKey(/** @type {Teaching} */ teaching, /** @type {KeyboardEvent} */ event) {
  const target = targetOf(event);
  if (!isPlain(event) || target.matches("input")) return;
  const side = WAYS[event.key];
  if (!side) return;
  const stage = STAGES[teaching.at];
  if (target === teaching.canvas && stage.probe) moveProbe(teaching, side, event.shiftKey ? 5 : 1);
  else if (target.matches(".teaching-text") && side[1])
    return; // it scrolls
  else if (side[0]) teaching.takes(side[0] > 0 ? "teach_next" : "teach_back");
  else if (target.matches(".teaching-stage")) moveInList(target, side[1]);
  else return;
  taken(event);
}

/** @param {Teaching} teaching @param {number[]} parts @param {number} times */
function moveProbe(teaching, [right, down], times) {
  const map = teaching.sheet.panes.find(({ key }) => key === STAGES[teaching.at].probe);
  if (!map) return;
  const { rect, scaleX, scaleY } = map;
  const step = times * PROBE_STEP * Math.min(rect.w, rect.h);
  const [u, v] = teaching.ui.at;
  teaching.probe = { at: [u + (right * step) / scaleX, v + (down * step) / scaleY], moved: true };
  teaching.update();
}

function moveInList(/** @type {HTMLElement} */ button, /** @type {number} */ by) {
  const all = findAll(".teaching-stage");
  all[within(all.indexOf(button) + by, 0, all.length - 1)].focus();
}
