// The source image of a view with its mask, beside the flattened view, and every view that saw the current pick.

import { PagePart } from "../page/page.js";
import { zoomedBox } from "../canvas/geometry.js";
import { askJson, askPicture, Fetched } from "../page/connection.js";
import { Pen, traceCross } from "../canvas/pen.js";
import { onPinch } from "../canvas/pinch.js";
import {
  byId,
  isPlain,
  make,
  onWheel,
  section,
  setText,
  setTitle,
  showWords,
  sized,
  taken,
  WAYS,
  within,
  swatch,
} from "../page/dom.js";
import { count, number, percent } from "../page/format.js";
import { KeptSwitch } from "../page/theme.js";

const LEAST_PX = 120; // of the image's longer side; it grows with the scene
const MOST_SHARE = 0.28; // of the scene's width and height
const MOST_ZOOM = 16;
const LOW_PX = 420; // a scene that is lower than this keeps the most of it for itself
const MARGIN = 0.12; // around the item, as a share of its size
const KEPT = 12; // pictures, and where the item is on them
const RESTS_MS = 400; // from a pick until its views are looked for, which takes the server longer than a click
/** @type {Record<string, string>} */
const HIDDEN = {
  "faces away": "face away",
  "covered by nearer cloth": "covered",
  "outside the image": "outside",
  "nothing measured there": "not measured",
};

/**
 * @typedef {object} Drawn what is drawn, for tests
 * @property {boolean} labels
 * @property {boolean} states
 * @property {number} view
 * @property {boolean} masked
 * @property {ItemBox} box
 * @property {number} scale
 * @property {RC | null} pick
 * @property {RC | null} pointer
 */

export class SourcePanel extends PagePart {
  name = "sources";
  actions = {
    source_image: () => this.toggle(this.folded),
    source_mask: () => this.toggle(this.masked),
    source_states: () => this.toggle(this.states),
  };
  panel = byId("sources");
  folded = new KeptSwitch("source-folded", innerWidth < 1200);
  masked = new KeptSwitch("source-mask", true);
  states = new KeptSwitch("source-states"); // why pixels are not in the shape
  zoom = { factor: 1, row: 0, col: 0 }; // and the pixel in the middle
  present = /** @type {number | null} */ (null); // the view that the page is at
  pinned = /** @type {number | null} */ (null); // another view that the operator looks at
  about = /** @type {string | undefined} */ (undefined); // what is in doubt, of which it shows a view
  /** @type {Fetched<SeenViews>} the views of the pick */
  seenIn = new Fetched(askJson, () => this.show());
  seenAt = /** @type {string | null} */ (null); // where it is asked for them
  rests = 0;
  at = /** @type {HoverAnswer["source"]} */ (null); // what is under the pointer on the flattened view
  kept = /** @type {Map<string, any>} */ (new Map()); // what was fetched, by address
  imageCanvas = byId("source-canvas");
  stroke = /** @type {UV[] | null} */ (null); // pixels (row, col) of the stroke that is being drawn
  drawn = /** @type {Drawn | null} */ (null);
  aim = /** @type {{ view: number; rc: RC } | null} */ (null); // where a stroke is suggested
  scene = /** @type {HTMLElement} */ (this.panel.parentElement);

  constructor(/** @type {Page} */ page) {
    super(page);
    this.listen();
    byId("source-back").addEventListener("click", () => this.present !== null && this.pin(this.present));
    new ResizeObserver(() => this.draw()).observe(this.scene);
  }

  get view() {
    return this.pinned ?? this.present;
  }

  get pick() {
    return this.page.state.pick;
  }

  /** The address of the states of a view, as a picture or as values; null if they are not shown. */
  statesOf(/** @type {number} */ view, ending = "png") {
    const revision = this.page.state.layers?.revision;
    return this.states.on && revision ? `source/${view}/states-${revision}.${ending}` : null;
  }

  /** What a hover read-out is asked for besides. */
  asksHover() {
    return this.panel.hidden || this.folded.on || this.view === null ? {} : { view: this.view };
  }

  update(/** @type {State} */ state) {
    this.panel.hidden = state.present_view === null;
    if (this.panel.hidden || !this.page.isSettled) return;
    if (state.present_view !== this.present) this.pinned = null;
    const { doubt } = this.page.doubts;
    if (doubt?.title !== this.about) this.pinned = doubt?.views[0]?.view_index ?? null; // that holds most of it
    this.about = doubt?.title;
    this.present = state.present_view;
    this.show();
  }

  /** Mark the pixel that shows what is under the pointer on the flattened view. */
  hovered(/** @type {HoverAnswer | null} */ answer) {
    this.at = answer?.source ?? null;
    this.draw();
  }

  /** Show a pixel of a view, and mark it until something is painted. */
  lookAt(/** @type {number} */ view, /** @type {RC} */ rc) {
    this.aim = { view, rc };
    this.folded.on = false;
    this.pin(view);
  }

  // --- painting --------------------------------------------------------------------------------

  listen() {
    const canvas = this.imageCanvas;
    canvas.addEventListener("pointerdown", (event) => {
      const at = this.pixelAt(event);
      if (event.button !== 0 || !this.page.brush?.side || !at) return;
      event.preventDefault();
      canvas.setPointerCapture(event.pointerId);
      this.stroke = [at];
      this.draw();
    });
    canvas.addEventListener("pointermove", (event) => {
      const at = this.stroke && this.pixelAt(event);
      if (!at) return;
      this.stroke?.push(at);
      this.draw();
    });
    canvas.addEventListener("pointerup", () => {
      const { stroke, drawn } = this;
      this.stroke = null;
      if (!stroke || !drawn) return;
      this.aim = null;
      this.page.brush.paintImage(drawn.view, stroke);
      this.draw();
    });
    canvas.addEventListener("pointercancel", () => {
      this.stroke = null;
      this.draw();
    });
    canvas.addEventListener("keydown", (event) => this.key(event));
    onWheel(canvas, (factor, event) => this.zoomBy(factor, event) && event.preventDefault());
    const cancel = () => (this.stroke = null);
    onPinch(canvas, cancel, (factor, from, to) => this.zoomBy(factor, atPointer(from), atPointer(to)));
  }

  /** Zoom; what was under a pointer comes to be under another, or stays. */
  zoomBy(/** @type {number} */ factor, /** @type {Pointed} */ from, /** @type {Pointed} */ to = from) {
    const [at, then] = [this.pixelAt(from), this.pixelAt(to)];
    if (!at || !then || this.drawn?.view !== this.view) return false;
    const { box } = this.drawn;
    const before = this.zoom.factor;
    this.zoom.factor = within(before * factor, 1, MOST_ZOOM);
    const by = before / this.zoom.factor;
    this.zoom.row = at[0] + (box.top + box.height / 2 - then[0]) * by;
    this.zoom.col = at[1] + (box.left + box.width / 2 - then[1]) * by;
    this.draw();
    return true;
  }

  /** The pixel (row, col) of the recorded image under a pointer. @returns {UV | null} */
  pixelAt(/** @type {Pointed} */ event) {
    if (!this.drawn) return null;
    const at = this.imageCanvas.getBoundingClientRect();
    const { box, scale } = this.drawn;
    return [(event.clientY - at.top) / scale + box.top - 0.5, (event.clientX - at.left) / scale + box.left - 0.5];
  }

  /** With a brush the arrow keys move a mark over the image (Shift: tenfold), Enter paints a dab there. */
  key(/** @type {KeyboardEvent} */ event) {
    if (!this.page.brush?.side || !this.drawn || !isPlain(event)) return;
    const { box, view } = this.drawn;
    const step = event.shiftKey ? 10 : 1;
    const [row, col] = this.aim?.view === view ? this.aim.rc : [box.top + box.height / 2, box.left + box.width / 2];
    const here = /** @type {UV} */ ([row, col]);
    if (event.key in WAYS) {
      const [right, down] = WAYS[event.key];
      /** @type {RC} */
      const rc = [
        within(here[0] + down * step, box.top, box.top + box.height - 1),
        within(here[1] + right * step, box.left, box.left + box.width - 1),
      ];
      this.aim = { view, rc };
    } else if (event.key === "Enter") {
      this.page.brush.paintImage(view, [here]);
    } else return;
    taken(event);
    this.draw();
  }

  /** @param {Pen} pen @param {UV[]} stroke @param {number} scale */
  drawStroke(pen, stroke, scale) {
    const brush = this.page.brush;
    const { context } = pen;
    context.save();
    context.globalAlpha = 0.6;
    context.lineCap = context.lineJoin = "round";
    // How wide the brush is on the cloth depends on its distance; here it is drawn as at the middle of the item.
    const width = Math.max(3, 2 * brush.radius_m * (this.page.state.sides?.pixels_per_m ?? 500) * scale);
    pen.line([stroke[0], ...stroke].map(pen.at), brush.color, width);
    context.restore();
  }

  get pressed() {
    return { source_mask: this.masked.on, source_states: this.states.on };
  }

  toggle(/** @type {KeptSwitch} */ what) {
    what.on = !what.on;
    this.page.changed();
  }

  /** Look at another view: its image here, the item in 3D from where it was taken. */
  pin(/** @type {number} */ view) {
    this.page.send({ type: "turn_to", view_index: view });
    this.pinned = view === this.present ? null : view;
    this.zoom.factor = 1;
    this.show();
    this.page.changed();
  }

  // --- the pick --------------------------------------------------------------------------------

  /** Look for the views that saw the pick once it rests, and somebody sees them. */
  lookForPick() {
    const pick = this.folded.on ? null : this.pick;
    const address = pick && `source/seen/${pick.id}.json?at=${pick.position_held_m}`; // a number is given again
    if (address === this.seenAt) return;
    this.seenAt = address;
    this.seenIn.want(null);
    clearTimeout(this.rests);
    this.rests = setTimeout(() => this.seenIn.want(this.seenAt), RESTS_MS);
  }

  // --- what is shown ---------------------------------------------------------------------------

  show() {
    const folded = this.folded.on;
    this.lookForPick();
    this.panel.classList.toggle("folded", folded);
    setTitle("source_image", folded ? "Source image" : "Fold");
    if (folded || this.view === null) return;
    setText(byId("source-title"), `View ${this.view} · ${number(this.page.state.views[this.view].angle_deg, 0)}°`);
    showWords(byId("source-back"), this.view === this.present ? "" : `Back to view ${this.present}`);
    this.showSeen();
    // How much of the view is in which state, below its image.
    const address = this.statesOf(this.view, "json");
    const shares = /** @type {Share[] | null} */ (address && this.fetched(address));
    section("source-states", address && [address, shares], () => shares?.map(shareRow));
    this.draw();
  }

  showSeen() {
    const { pick } = this;
    const seen = this.seenIn.value;
    section("source-seen", pick && [pick.id, pick.name, seen, this.view], () => {
      if (!seen) return make("p.nothing", `Looking for ${pick?.name} in every view.`);
      const others = Object.entries(seen.hidden)
        .filter(([, n]) => n)
        .map(([why, n]) => `${n} ${HIDDEN[why]}`)
        .join(", ");
      const title = `${pick?.name}: seen in ${seen.seen.length} of ${count(seen.n_views, "view")}`;
      return [
        make("p", { tip: others ? `The others: ${others}.` : "" }, title),
        make("div.thumbs", { role: "group", label: title }, ...seen.seen.map((one) => this.thumb(one))),
      ];
    });
  }

  thumb(/** @type {Seen} */ one) {
    const name = `View ${one.view_index}, ${number(one.angle_deg, 0)}°`;
    return make(
      "button.thumb",
      {
        label: `${name}: show its image`,
        pressed: one.view_index === this.view,
        key: `thumb-${one.view_index}`,
        tip:
          `${name}, pixel ${number(one.rc[0], 0)}, ${number(one.rc[1], 0)}\n` +
          "Click: show its image, and turn the item to it",
        click: () => this.pin(one.view_index),
      },
      make("img", { src: one.thumb, alt: "", width: 44, height: 44 }),
      make("span", `${number(one.angle_deg, 0)}°`),
    );
  }

  /** What an address gives, a picture or values; null while that is fetched: it is drawn when it is there. */
  fetched(/** @type {string} */ address) {
    const known = this.kept.get(address);
    if (known !== undefined) return known;
    this.kept.set(address, null);
    for (const old of this.kept.keys()) if (this.kept.size > KEPT) this.kept.delete(old);
    (address.includes(".json") ? askJson : askPicture)(address).then((found) => {
      if (!found) return; // what cannot be read is not asked for again and again
      this.kept.set(address, found);
      this.show();
    });
    return null;
  }

  draw() {
    const { view } = this;
    if (this.panel.hidden || this.folded.on || view === null) return;
    const masked = this.masked.on;
    const color = this.fetched(`source/${view}/color.jpg`);
    const shaded = masked ? ", what is not the item shaded" : "";
    this.imageCanvas.setAttribute("aria-label", `Source image of view ${view}${shaded}`);
    const mask = this.fetched(`source/${view}/mask.png`);
    const sides = this.page.brush?.addressOf(view);
    const lost = this.statesOf(view);
    const labels = lost ? this.fetched(lost) : sides && masked ? this.fetched(sides) : null;
    this.imageCanvas.classList.toggle("painting", Boolean(this.page.brush?.side));
    this.imageCanvas.tabIndex = this.page.brush?.side ? 0 : -1;
    const item = this.fetched(`sides/${view}/box.json?v=${this.page.state.sides?.token}`);
    if (!color || !mask || !item) return;
    const whole = withMargin(item, color);
    const [mostWide, mostHigh] = [this.scene.clientWidth, this.scene.clientHeight].map((px) =>
      Math.max(this.scene.clientHeight < LOW_PX ? 0 : LEAST_PX, MOST_SHARE * px),
    );
    const fit = Math.min(mostWide / whole.width, mostHigh / whole.height);
    const [width, height] = [Math.round(whole.width * fit), Math.round(whole.height * fit)];
    const box = zoomedBox(whole, this.zoom);
    const scale = fit * this.zoom.factor;
    const context = sized(this.imageCanvas, width, height);
    const pen = new Pen(context, ([row, col]) => ({
      x: (col + 0.5 - box.left) * scale,
      y: (row + 0.5 - box.top) * scale,
    }));
    Object.assign(this.imageCanvas.style, { width: `${width}px`, height: `${height}px` });
    byId("source-seen").style.maxHeight = `${height}px`;
    context.imageSmoothingQuality = "high";
    for (const image of masked || lost ? [color, labels ?? mask] : [color]) {
      context.drawImage(image, box.left, box.top, box.width, box.height, 0, 0, width, height);
    }
    const [pick, pointer] = [this.pickedPixel(), this.at?.view_index === view ? this.at.rc : null];
    const aim = this.aim?.view === view ? this.aim.rc : null;
    for (const [name, rc] of Object.entries({ "--pick": pick, "--accent": pointer, "--warn": aim })) {
      if (!rc || rc[0] === null || rc[1] === null) continue;
      const middle = pen.at([rc[0], rc[1]]);
      pen.rimmed(name, 1.75, (to) => traceCross(to, middle, 3, 10));
    }
    pen.squares(this.page.gather("sourceMarks", view).map(pen.at), "--accent", 4);
    const states = Boolean(lost && labels);
    this.drawn = { labels: Boolean(labels), states, view, masked, box, scale, pick, pointer };
    if (this.stroke) this.drawStroke(pen, this.stroke, scale);
  }

  /** Where the current pick lies in the image shown; null if that view did not see it. */
  pickedPixel() {
    if (!this.pick) return null;
    if (this.pick.view_index === this.view) return this.pick.source_rc;
    return this.seenIn.value?.seen.find((one) => one.view_index === this.view)?.rc ?? null;
  }
}

/** @typedef {{ clientX: number; clientY: number }} Pointed */
const atPointer = (/** @type {Point} */ { x, y }) => ({ clientX: x, clientY: y });

/** A part of an image with a margin around it. @param {ItemBox} box @param {ImageBitmap} image @returns {ItemBox} */
function withMargin({ left, top, width, height }, image) {
  const by = Math.round(MARGIN * Math.max(width, height, 20));
  const [x, y] = [Math.max(0, left - by), Math.max(0, top - by)];
  const [right, bottom] = [Math.min(image.width, left + width + by), Math.min(image.height, top + height + by)];
  return { left: x, top: y, width: right - x, height: bottom - y };
}

/** @typedef {{ state: string; text: string; color: string | null; share: number; missing: number }} Share */

function shareRow(/** @type {Share} */ { state, text, color, share, missing }) {
  const tip =
    `${number(100 * share, 1)} % of the item's pixels; ` +
    `${number(100 * missing, 1)} % show cloth that is in the result from no view`;
  return make("p", { tip, data: { state } }, swatch(color ?? "transparent"), `${percent(share)} ${text}`);
}
