// Looking at the flattened view: turned and flipped, with grid, another colour map and window. The data stay as
// they are.

import { LayerList } from "/static/canvas/layer_list.js";
import { byId, make, rebuild, setText } from "/static/page/dom.js";
import { number } from "/static/page/format.js";

const STEP_DEG = 15;
const GRID_GAP_PX = 44;
const GRID_MM = [10, 20, 50, 100, 200, 500, 1000];
const SIGNS = { turn_left_seen: "↺", turn_right_seen: "↻", flip: "Flip", grid: "Grid", ruler: "Ruler" };
const PLAIN = { map: "", low: 0, high: 1, shown: false, opacity: 1, blending: "source-over" };

/** Keeps how each layer is looked at. */
export class Looking {
  name = "looking";

  constructor(page) {
    this.page = page;
    this.canvas = page.canvas;
    this.actions = {
      look: () => this.toggle(),
      turn_left_seen: () => this.turnBy(-1),
      turn_right_seen: () => this.turnBy(1),
      flip: () => this.flip(),
      grid: () => {
        this.grid = !this.grid;
        this.canvas.redraw();
        page.changed();
      },
    };
    this.settings = new Map(); // by layer or difference
    this.maps = {};
    this.open = false;
    this.grid = false;
    this.list = new LayerList(page, this);
    this.canvas.layers = this;
    this.canvas.drawers.push((_, context, style) => this.grid && this.drawGrid(context, style));
    this.chip = make("button", {
      type: "button",
      class: "button small turned",
      hidden: true,
      "aria-label": "Undo turn and flip",
      data: { tip: "The flattened view is turned or flipped for looking only; the data are not.\nClick: as it is" },
      on: { click: () => this.turn(0, false) },
    });
    byId("stage").append(this.chip);
    this.loadMaps();
  }

  async loadMaps() {
    const answer = await fetch("/colormaps.json").catch(() => null);
    if (answer?.ok) this.maps = await answer.json();
  }

  // --- turn and flip ---------------------------------------------------------------------------

  turnBy(steps) {
    const { angle, flipped } = this.canvas.transform;
    const degrees = Math.round((angle * 180) / Math.PI) + STEP_DEG * steps;
    this.turn((((degrees % 360) + 360) % 360) * (Math.PI / 180), flipped);
  }

  /** Exchange left and right as they are seen now. */
  flip() {
    const { angle, flipped } = this.canvas.transform;
    this.turn((2 * Math.PI - angle) % (2 * Math.PI), !flipped);
  }

  turn(angle, flipped) {
    this.canvas.turnTo(angle, flipped);
    const degrees = Math.round((angle * 180) / Math.PI) % 360;
    this.chip.hidden = degrees === 0 && !flipped;
    setText(
      this.chip,
      [degrees ? `turned ${number(degrees > 180 ? degrees - 360 : degrees, 0)}°` : "", flipped ? "flipped" : ""]
        .filter(Boolean)
        .join(", "),
    );
  }

  // --- colour map and window -------------------------------------------------------------------

  of(layer) {
    return this.settings.get(layer) ?? PLAIN;
  }

  set(layer, change) {
    this.settings.set(layer, { ...this.of(layer), ...change });
    this.page.changed();
  }

  /** While a slider is moved: only the canvas follows. */
  setQuietly(layer, change) {
    this.settings.set(layer, { ...this.of(layer), ...change });
    this.canvas.redraw();
  }

  update(state) {
    this.list.update(state);
  }

  /** Draw the shape: the chosen layer, and those that lie over it. */
  paintShape(canvas) {
    const { context } = canvas;
    const pale = context.globalAlpha;
    context.globalAlpha = pale * this.of(this.page.layer).opacity;
    canvas.drawPicture(canvas.layer.shown, canvas.layer.shown.image);
    context.globalAlpha = pale;
    if (!this.page.isLive) this.list.paint(canvas);
  }

  /** How a layer is looked at, as part of an address. */
  query(layer) {
    const { map, low, high } = this.of(layer);
    const parts = [map && `map=${map}`, low > 0 && `low=${low}`, high < 1 && `high=${high}`];
    return parts.filter(Boolean).join("&");
  }

  /** A legend as the layer is looked at. */
  legend(layer, legend) {
    if (legend?.kind !== "ramp") return legend;
    const { map, low, high } = this.of(layer);
    const at = (share) => legend.low + share * (legend.high - legend.low);
    return { ...legend, low: at(low), high: at(high), colors: this.maps[map]?.colors ?? legend.colors };
  }

  get pressed() {
    return { look: this.open, grid: this.grid };
  }

  reset() {
    this.settings.clear();
    this.grid = false;
    this.turn(0, false);
    this.page.changed();
  }

  // --- the panel -------------------------------------------------------------------------------

  toggle() {
    this.open = !this.open;
    this.page.changed();
    if (this.open) byId("look").querySelector("button")?.focus();
  }

  /** Show the panel for a layer with its legend (null: it has no numbers), and the legends of all. */
  show(layer, legend, live, legends = null) {
    const panel = byId("look");
    panel.hidden = !this.open;
    if (!this.open) return;
    const setting = this.of(layer);
    const ramp = legend?.kind === "ramp";
    const all = [...this.settings.entries()];
    rebuild(panel, [layer, legend, all, Object.keys(this.maps), live, legends, this.page.layer], () =>
      [
        make("h2", {}, "Layers"),
        this.list.build(live ? { [layer]: legend } : legends, live),
        make(
          "div",
          { class: "looks" },
          ...Object.entries(SIGNS).map(([name, sign]) => this.page.toolbar.button(name, sign)),
        ),
        make(
          "button",
          {
            type: "button",
            class: "button last",
            data: { id: "look-reset", tip: "As it is: not turned, not flipped, no grid, each layer's own colours" },
            on: { click: () => this.reset() },
          },
          "Reset",
        ),
        ...(live
          ? []
          : [
              ramp ? this.mapField(layer, setting) : null,
              ...(ramp || layer === "color" ? this.windowFields(layer, setting, legend, ramp) : []),
            ]),
      ].filter(Boolean),
    );
  }

  mapField(layer, setting) {
    const options = [["", "Own colours"], ...Object.entries(this.maps).map(([name, map]) => [name, map.title])];
    return make(
      "label",
      { class: "field" },
      make(
        "select",
        {
          "aria-label": "Colours",
          data: { id: "look-map", tip: "Colours; equal steps of a value look equal in each" },
          on: { change: (event) => this.set(layer, { map: event.target.value }) },
        },
        ...options.map(([name, title]) => make("option", { value: name, selected: name === setting.map }, title)),
      ),
    );
  }

  windowFields(layer, setting, legend, ramp) {
    const told = (share) =>
      ramp ? number(legend.low + share * (legend.high - legend.low), 0) : `${Math.round(100 * share)} %`;
    const names = ramp ? { low: "From", high: "To" } : { low: "Black", high: "White" };
    return ["low", "high"].map((end) => {
      const output = make("output", {}, told(setting[end]));
      const input = make("input", {
        type: "range",
        min: 0,
        max: 1,
        step: 0.01,
        value: setting[end],
        data: { id: `look-${end}` },
        "aria-label": names[end],
        on: {
          input: () => setText(output, told(this.clamped(end, input.valueAsNumber, setting))),
          change: () => this.set(layer, { [end]: this.clamped(end, input.valueAsNumber, setting) }),
        },
      });
      return make("label", { class: "field" }, make("span", {}, names[end]), input, output);
    });
  }

  clamped(end, value, { low, high }) {
    return end === "low"
      ? Math.min(value, Math.round(100 * high - 1) / 100)
      : Math.max(value, Math.round(100 * low + 1) / 100);
  }

  // --- the grid --------------------------------------------------------------------------------

  drawGrid(context, style) {
    const { canvas } = this;
    const { transform: at, width, height } = canvas;
    const mm = GRID_MM.find((step) => (step / 1000) * at.scale >= GRID_GAP_PX) ?? GRID_MM.at(-1);
    const gap = mm / 1000;
    const corners = [
      [0, 0],
      [width, 0],
      [0, height],
      [width, height],
    ].map(([x, y]) => at.toPlane(x, y));
    const range = (name) => [Math.min(...corners.map((c) => c[name])), Math.max(...corners.map((c) => c[name]))];
    const [u, v] = [range("u"), range("v")];
    context.lineWidth = 1;
    context.font = "11px system-ui, sans-serif";
    context.textBaseline = "top";
    for (const along of ["u", "v"]) {
      const [from, across] = along === "u" ? [u, v] : [v, u];
      const way = along === "u" ? at.toPaneVector(0, 1) : at.toPaneVector(1, 0);
      const steep = Math.abs(way.y) >= Math.abs(way.x) - 1e-9 * at.scale;
      for (let n = Math.ceil(from[0] / gap); n * gap <= from[1]; n++) {
        /** @type {any} */
        const ends = across.map((c) => (along === "u" ? at.toPane(n * gap, c) : at.toPane(c, n * gap)));
        this.gridLine(context, style, ends, n === 0);
        this.gridLabel(context, style, ends, `${Math.round((n * mm) / 10)} cm`, steep);
      }
    }
  }

  gridLine(context, style, [a, b], strong) {
    for (const [color, alpha, extra] of [
      ["#fff", 0.4, 1.5],
      [style.getPropertyValue("--text"), strong ? 0.8 : 0.35, 0],
    ]) {
      context.globalAlpha = alpha;
      context.strokeStyle = color;
      context.lineWidth = (strong ? 1.5 : 1) + extra;
      context.beginPath();
      context.moveTo(a.x, a.y);
      context.lineTo(b.x, b.y);
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  /** Steep lines are labelled where they meet the upper rim, the others at the right one. */
  gridLabel(context, style, [a, b], label, steep) {
    const { width, height } = this.canvas;
    const share = steep ? -a.y / (b.y - a.y) : (width - a.x) / (b.x - a.x);
    const text = context.measureText(label).width;
    const x = steep ? a.x + share * (b.x - a.x) + 3 : width - text - 4;
    const y = steep ? 3 : a.y + share * (b.y - a.y) + 2;
    if (x < 4 || x > width - text - (steep ? 60 : 0) || y < 3 || (!steep && (y < 20 || y > height - 16))) return;
    context.globalAlpha = 0.8;
    context.fillStyle = style.getPropertyValue("--panel");
    context.fillRect(x - 2, y - 1, text + 4, 14);
    context.globalAlpha = 1;
    context.fillStyle = style.getPropertyValue("--text");
    context.fillText(label, x, y);
  }
}
