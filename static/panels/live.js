// Live mode: frames as they come, the bar that steers them, and the rate at which they are really drawn.

import { byId, optionsOf, setText } from "../page/dom.js";
import { boxOf } from "../canvas/geometry.js";
import { number } from "../page/format.js";
import { opened } from "../offline/parcel.js";

const RATES = [1, 2, 5, 10, 15, 30, 60];
const RATE_WINDOW_MS = 1000;

export class LiveBar {
  name = "live";

  /** `drawn(frame, image or null)` draws a frame. */
  constructor(/** @type {Page} */ page, /** @type {(frame: FrameInfo, shown: Shown | null) => void} */ drawn) {
    this.page = page;
    this.drawn = drawn;
    this.actions = {
      live_play: () => page.send({ type: "play", playing: !page.state.live?.playing }),
      live_back: () => page.send({ type: "play", step: -1 }),
      live_forward: () => page.send({ type: "play", step: 1 }),
      live_turn: () => page.send({ type: "play", forward: !page.state.live?.forward }),
    };
    this.frame = /** @type {FrameInfo | null} */ (null);
    this.drawnAt = /** @type {number[]} */ ([]);
    this.angles = /** @type {number[]} */ ([]);
    this.camera = "";
    this.playing = false;
    this.arrived = 0;
    this.dragging = false;
    this.slider = byId("live-frame");
    this.rate = byId("live-rate");
    this.slider.addEventListener("pointerdown", () => (this.dragging = true));
    for (const end of ["lostpointercapture", "pointerup"])
      this.slider.addEventListener(end, () => (this.dragging = false));
    this.slider.addEventListener("input", () => {
      this.showPlace(Number(this.slider.value));
      this.page.send({ type: "play", frame: Number(this.slider.value) });
    });
    this.rate.addEventListener("change", () => this.page.send({ type: "play", fps: Number(this.rate.value) }));
  }

  /** Take a state: what does not change with each frame. */
  update(/** @type {State} */ state) {
    if (!state.live) return;
    this.angles = state.views.map((view) => view.angle_deg);
    this.camera = state.capture?.camera ?? "";
    this.slider.max = String(this.angles.length - 1);
    if (this.playing !== state.live.playing) this.drawnAt = [];
    this.playing = state.live.playing;
    const rates = [...new Set([...RATES, state.live.fps])].sort((a, b) => a - b);
    if (this.rate.childElementCount !== rates.length) {
      const options = rates.map((fps) => [fps, `${number(fps, Number.isInteger(fps) ? 0 : 1)} per s`]);
      this.rate.replaceChildren(...optionsOf(options, state.live.fps));
    }
    if (document.activeElement !== this.rate || Number(this.rate.value) !== state.live.fps)
      this.rate.value = String(state.live.fps);
    if (!this.playing) this.showRate();
  }

  /** Decode and draw a frame; the server sends the next one only after `then`. */
  async take(/** @type {ArrayBuffer} */ buffer, /** @type {() => void} */ then) {
    const { values, pictures } = opened(new Uint8Array(buffer));
    const about = /** @type {FrameInfo} */ (values);
    const arrival = ++this.arrived;
    const image = pictures.frame ? await createImageBitmap(pictures.frame).catch(() => null) : null;
    const { grid } = about;
    const shown = image && grid && { revision: about.sequence, grid, box: boxOf(grid), image };
    requestAnimationFrame(() => {
      // Decoding may finish out of order: a change of layer overtakes the frame before it.
      if (arrival !== this.arrived) return;
      this.frame = about;
      this.drawn(about, shown);
      this.count();
      if (!this.dragging) this.slider.value = String(about.view_index);
      this.showPlace(this.dragging ? Number(this.slider.value) : about.view_index);
      this.showRate();
      then();
    });
  }

  count() {
    const now = performance.now();
    this.drawnAt.push(now);
    while (now - this.drawnAt[0] > RATE_WINDOW_MS) this.drawnAt.shift();
  }

  /** Frames drawn per second, over the last second. */
  get fps() {
    const span = (this.drawnAt.at(-1) ?? 0) - this.drawnAt[0];
    return this.playing && span > 0 ? (1000 * (this.drawnAt.length - 1)) / span : null;
  }

  get status() {
    return { frame: this.frame, fps: this.fps };
  }

  showPlace(/** @type {number} */ index) {
    const text = index < 0 ? this.camera : `View ${index} · ${number(this.angles?.[index], 0)}°`;
    setText(byId("live-place"), text);
    this.slider.setAttribute("aria-valuetext", text);
  }

  showRate() {
    const ms = this.frame?.flatten_ms;
    setText(byId("live-fps"), this.playing ? number(this.fps, 1) : "paused");
    setText(byId("live-fps-unit"), this.playing ? "frames/s" : "");
    setText(byId("live-ms"), number(ms, 0));
  }
}
