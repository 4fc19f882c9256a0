// The teaching mode: the stages of the method on the current recording. It only asks; it decides nothing.

import { byId, find, findAll, make, rebuild, setAllowed, setCurrent, setText } from "../page/dom.js";
import { isPlain, taken, targetOf, WAYS, within } from "../page/dom.js";
import { number } from "../page/format.js";
import { onTheme } from "../page/theme.js";
import { Sheet } from "./draw.js";
import { connectFrame, FRAME, STAGES, symbols } from "./frame.js";
import { fetchLesson } from "./lesson.js";

const AHEAD = /** @type {PartName[]} */ (["flattening", "planning", "alignment"]); // asked for before they are wanted
const STATE_MS = 650; // how long the way from one recorded state to the next takes
const QUIET_MS = 120; // progress is shown only for what takes longer
const PROBE_STEP = 0.02; // of the shorter side of a pane, per arrow key
const PASSED_ON = ["theme", "help", "log", "settings"];

export class Teaching {
  constructor(/** @type {Page} */ page) {
    this.page = page;
    this.at = 0;
    this.changed = /** @type {Partial<LessonParameters>} */ ({}); // the learner's
    this.known = /** @type {Partial<Record<PartName, KnownPart>>} */ ({});
    this.running = /** @type {Running | null} */ (null); // one lesson is made at a time
    this.time = 0; // of the animation
    this.probe = /** @type {UV | null} */ (null); // where the learner points
    this.canvas = /** @type {HTMLCanvasElement} */ (find("canvas", FRAME));
    this.sheet = new Sheet(this.canvas, (key, at) => {
      if (key === this.stage.probe) this.point(at);
    });
    this.playing = /** @type {number | null} */ (null); // the animation frame of the player, and of the next drawing
    this.waiting = /** @type {number | null} */ (null);
    this.shown = /** @type {{ stage: number; parameters: object } | null} */ (null); // for tests
    this.behind = /** @type {HTMLElement[]} */ ([]); // what lies behind it
    this.opener = /** @type {HTMLElement | null} */ (null); // what had the focus
  }

  /** @type {Record<string, () => void>} what it does for an action while it is open */
  does = {
    teach: () => this.leave(),
    teach_next: () => this.go(this.at + 1),
    teach_back: () => this.go(this.at - 1),
    teach_play: () => this.play(!this.playing),
    cancel: () => (this.running?.part === this.stage.part ? this.giveUp() : this.leave()),
  };

  get open() {
    return FRAME.isConnected && !FRAME.hidden;
  }

  get stage() {
    return STAGES[this.at];
  }

  /** What is known of the stage's part. */
  get here() {
    return this.known[this.stage.part];
  }

  /** Take an action of the page's table; returns whether it was meant for the teaching mode. */
  takes(/** @type {string} */ name) {
    if (!this.open) {
      if (name !== "teach" || this.page.action(name).why_not !== null) return false; // the page says why
      this.enter();
      return true;
    }
    if (PASSED_ON.includes(name)) return false;
    this.does[name]?.(); // nothing else: nothing is decided from in here
    return true;
  }

  // --- in and out ------------------------------------------------------------------------------

  enter() {
    if (!FRAME.isConnected) {
      connectFrame(this);
      FRAME.addEventListener("keydown", (event) => this.onKey(event));
      new ResizeObserver(() => this.open && this.draw()).observe(find(".teaching-sheet", FRAME));
      onTheme(() => this.redraw());
    }
    this.opener = /** @type {HTMLElement | null} */ (document.activeElement);
    this.behind = /** @type {HTMLElement[]} */ ([...document.body.children]).filter(
      (e) => e !== FRAME && !e.inert && e.id !== "notes" && e.tagName !== "DIALOG",
    );
    for (const element of this.behind) element.inert = true;
    FRAME.hidden = false;
    setText(byId("teaching-recording"), this.page.state.recording.name);
    this.go(this.at);
    byId("teaching-next").focus();
  }

  leave() {
    this.play(false);
    this.stop();
    FRAME.hidden = true;
    for (const element of this.behind) element.inert = false;
    this.opener?.focus?.();
  }

  go(/** @type {number} */ index) {
    if (index < 0 || index >= STAGES.length) return;
    if (index !== this.at || !this.shown) {
      this.play(false);
      this.at = index;
      this.time = 0;
      this.probe = null;
    }
    const knowsOther = this.page.thisSide.other?.layers;
    if (this.stage.about.dataset.stage === "seams" && !knowsOther) this.page.send({ type: "other_side" });
    this.showStage();
    this.load();
    this.show();
  }

  // --- the lessons -----------------------------------------------------------------------------

  /** Take a new state of the session: what a lesson depends on may have changed. */
  update() {
    if (!this.open) return;
    this.showProgress();
    if (this.here?.key !== this.key(this.stage.part)) this.load();
  }

  /** The parameters that are set: the session's but for those that the learner has changed. */
  get parameters() {
    const known = Object.values(this.known).find(({ lesson }) => lesson?.defaults);
    return known ? { ...known.lesson.defaults, ...this.changed } : null;
  }

  /** @returns {Record<string, any>} */
  query(/** @type {PartName} */ part) {
    const { state, doubts } = this.page;
    if (part === "garment") return { revision: state.garment?.revision ?? 0 };
    if (part === "shape") return { revision: doubts.lesson && doubts.found?.revision };
    if (!AHEAD.includes(part)) return {}; // the same whatever is changed
    const { start_view } = state;
    return { ...(start_view === null ? {} : { start_view }), ...this.changed };
  }

  /** What a lesson depends on: also the number of views, which grows while a cell turns. */
  key(/** @type {PartName} */ part) {
    return JSON.stringify([part, this.query(part), this.page.state.views.length]);
  }

  /** Ask for what this stage needs, then for the rest, so that the next stages are there at once; one by one. */
  async load() {
    const part = [this.stage.part, ...AHEAD].find((p) => this.known[p]?.key !== this.key(p));
    if (!part || !this.open || this.running?.key === this.key(part)) return;
    this.stop();
    const running = { part, key: this.key(part), abort: new AbortController(), since: performance.now() };
    this.running = running;
    setTimeout(() => this.showProgress(), QUIET_MS);
    const unexpected = (/** @type {Error} */ error) => ({ lesson: null, error: `Unexpected error: ${error}` });
    const made = await this.ask(part, running.abort.signal).catch(unexpected);
    if (this.running !== running) return; // given up
    this.running = null;
    this.known[part] = { key: running.key, ...made };
    this.show();
    this.load();
  }

  async ask(/** @type {PartName} */ part, /** @type {AbortSignal} */ signal) {
    if (part !== "shape") return fetchLesson(part, this.query(part), signal);
    const { lesson } = this.page.doubts;
    return { lesson, error: lesson ? null : "The shape of this session is not known yet: it is being drawn." };
  }

  /** Stop computing; closing the connection does it. */
  stop() {
    this.running?.abort.abort();
    this.running = null;
  }

  /** Stop computing, and say so. */
  giveUp() {
    this.stop();
    const { part } = this.stage;
    this.known[part] = { key: this.key(part), lesson: null, error: "Cancelled: this stage has not been computed." };
    this.show();
    byId("teaching-again").focus(); // Cancel, which had it, is gone
  }

  /** Set parameters; null: all as they are in the session. */
  change(/** @type {Partial<LessonParameters> | null} */ by) {
    this.changed = by ? { ...this.changed, ...by } : {};
    this.load();
    this.show();
  }

  again() {
    delete this.known[this.stage.part];
    this.change({});
  }

  // --- playing and pointing --------------------------------------------------------------------

  play(/** @type {boolean} */ on) {
    cancelAnimationFrame(this.playing ?? 0);
    this.playing = null;
    const last = this.lastTime;
    if (on && last > 0) {
      const began = performance.now() - STATE_MS * (this.time < last ? this.time : 0);
      const tick = (/** @type {number} */ now) => {
        this.time = within((now - began) / STATE_MS, 0, last);
        this.playing = this.time < last ? requestAnimationFrame(tick) : null;
        this.show();
      };
      this.playing = requestAnimationFrame(tick);
    }
    this.show();
  }

  get lastTime() {
    return (this.here?.lesson && this.stage.plays?.(this.here.lesson)) || 0;
  }

  scrub(/** @type {number} */ time) {
    this.time = time;
    this.play(false);
  }

  point(/** @type {UV} */ at) {
    this.probe = at;
    this.redraw();
  }

  onKey(/** @type {KeyboardEvent} */ event) {
    const target = targetOf(event);
    const way = WAYS[event.key];
    if (!way || !isPlain(event) || target.matches("input")) return;
    const pane = this.sheet.panes.find(({ key }) => key === this.stage.probe);
    if (target === this.canvas && pane && this.probe) {
      const step = (event.shiftKey ? 5 : 1) * PROBE_STEP * Math.min(pane.rect.w, pane.rect.h);
      const { x, y } = pane.at(...this.probe);
      this.point(pane.from(x + step * way[0], y + step * way[1]));
    } else if (way[0] || target.matches(".teaching-stage")) {
      this.go(this.at + way[0] + way[1]);
      if (target.matches(".teaching-stage")) findAll(".teaching-stage")[this.at].focus();
    } else return; // the text scrolls
    taken(event);
  }

  // --- the page --------------------------------------------------------------------------------

  /** What changes only with the stage. */
  showStage() {
    findAll(".teaching-stage").forEach((button, index) => {
      const here = index === this.at;
      button.tabIndex = here ? 0 : -1; // one stop for Tab; the arrow keys go on from there
      setCurrent(button, here, "step");
      if (here) button.scrollIntoView({ block: "nearest", inline: "nearest" });
    });
    for (const { about } of STAGES) about.hidden = about !== this.stage.about;
    setText(byId("teaching-place"), `Stage ${this.at + 1} of ${STAGES.length}: ${this.stage.name}`);
    find(".teaching-text").scrollTop = 0;
    const [isFirst, isLast] = [this.at === 0, this.at === STAGES.length - 1];
    const tip = (/** @type {string} */ name) => this.page.tip(name);
    setAllowed(byId("teaching-back"), isFirst ? "This is the first stage." : null, tip("teach_back"));
    setAllowed(byId("teaching-next"), isLast ? "This is the last stage." : null, tip("teach_next"));
    byId("teaching-next").classList.toggle("primary", !isLast);
    this.canvas.tabIndex = this.stage.probe ? 0 : -1;
  }

  /** What changes with the lessons, the parameters and the time. */
  show() {
    if (!this.open) return;
    const { lesson, error } = this.here ?? {};
    this.showSliders();
    this.showProgress();
    byId("teaching-trouble").hidden = !error;
    setText(byId("teaching-trouble-text"), error ?? "");
    this.canvas.style.visibility = lesson ? "visible" : "hidden";
    byId("teaching-facts").hidden = !lesson;
    this.time = Math.min(this.time, this.lastTime);
    this.showPlayer();
    this.redraw();
  }

  redraw() {
    this.waiting ??= requestAnimationFrame(() => {
      this.waiting = null;
      this.draw();
    });
  }

  draw() {
    const lesson = this.here?.lesson;
    if (!this.open || !lesson) return;
    const { draw, start } = this.stage;
    const at = (this.probe ??= start?.(lesson) ?? null) ?? [0, 0];
    this.showFacts(draw(this.sheet, this.sheet.begin(), lesson, { at, time: this.time }));
    this.shown = { stage: this.at + 1, parameters: lesson.parameters };
  }

  showFacts(/** @type {Fact[]} */ facts) {
    const list = byId("teaching-facts");
    const names = facts.map(([name]) => name);
    rebuild(list, names, () => names.map((name) => [make("dt", { data: { name } }, symbols(name)), make("dd")]));
    facts.forEach(([, value], i) => setText(list.children[2 * i + 1], value));
    const text = facts.map(([name, value]) => `${name}: ${value}`).join("; ");
    const keys = this.stage.probe ? " The arrow keys move the pointer." : "";
    this.canvas.setAttribute("aria-label", `${this.stage.name}. ${text}.${keys}`);
  }

  showSliders() {
    const { parameters } = this;
    byId("teaching-sliders").hidden = !parameters || !this.stage.parameters.length;
    for (const label of findAll(".teaching-slider")) {
      const name = /** @type {ParameterName} */ (label.dataset.slider);
      label.hidden = !this.stage.parameters.includes(name);
      if (!parameters) continue;
      const input = /** @type {HTMLInputElement} */ (find("input", label));
      const value = parameters[name];
      input.min = String(Math.min(Number(input.min), value)); // it reaches the session's own value
      input.max = String(Math.max(Number(input.max), value));
      if (Number(input.value) !== value) input.value = String(value);
      const output = find("output", label);
      setText(output, `${number(value, 0)}${output.dataset.unit}`);
      input.setAttribute("aria-valuetext", output.textContent ?? "");
    }
    const why = Object.keys(this.changed).length ? null : "These are the session's values.";
    setAllowed(byId("teaching-reset"), why, "Back to the session's values.");
  }

  showPlayer() {
    byId("teaching-player").hidden = !this.lastTime;
    const bar = byId("teaching-time");
    bar.max = String(this.lastTime);
    bar.value = String(this.time);
    bar.setAttribute("aria-valuetext", `${Math.round((100 * this.time) / (this.lastTime || 1))} %`);
    setText(byId("teaching-play").children[0], this.playing ? "Pause" : "Play");
  }

  showProgress() {
    const { running } = this;
    const isSlow = running?.part === this.stage.part && performance.now() - running.since >= QUIET_MS - 5;
    byId("teaching-progress").hidden = !isSlow;
    FRAME.classList.toggle("busy", isSlow);
    const { share, text } = this.page.state.lesson ?? { share: 0, text: "Waiting" };
    setText(byId("teaching-progress-text"), `${text} · ${Math.round(100 * share)} %`);
    byId("teaching-progress-bar").value = share;
  }
}
