// The pieces that float: listed with area and reason, marked on the canvas, placed by hand.

import { byId, make, rebuild } from "/static/page/dom.js";
import { count, number } from "/static/page/format.js";

const FONT = "600 13px system-ui, sans-serif";

export class PiecesPanel {
  name = "pieces";

  constructor(page) {
    this.page = page;
    this.canvas = page.canvas;
    this.pieces = [];
    this.chosen = null; // its letter
    this.section = make("section", { id: "floating", "aria-label": "Floating pieces", hidden: true });
    byId("pick").before(this.section);
    this.canvas.drawers.push((_, context, style) => this.draw(context, style));
  }

  update(state) {
    this.pieces = state.layers?.pieces ?? [];
    if (!this.pieces.some((piece) => piece.label === this.chosen)) this.chosen = null;
    this.section.hidden = !this.pieces.length;
    const why = state.pending
      ? "Decide about the proposal first."
      : state.request
        ? "Something is being computed."
        : null;
    rebuild(this.section, [this.pieces, this.chosen, why], () => this.build(why));
  }

  build(why) {
    const area = this.pieces.reduce((sum, piece) => sum + piece.area_cm2, 0);
    return [
      make("h2", {}, `Floating: ${count(this.pieces.length, "piece")}, ${number(area, 0)} cm²`),
      make("ul", { class: "pieces" }, ...this.pieces.map((piece) => this.row(piece, why))),
    ];
  }

  row(piece, why) {
    const on = piece.label === this.chosen;
    const swatch = make("i", { class: "swatch" });
    swatch.style.background = piece.color;
    const views = `Seen by view${piece.views.length === 1 ? "" : "s"} ${piece.views.join(", ")}.`;
    const place = () =>
      why ? this.page.notify("info", why) : this.page.send({ type: "place_piece", label: piece.label });
    return make(
      "li",
      {},
      make(
        "button",
        {
          type: "button",
          class: "button piece",
          "aria-pressed": String(on),
          data: { id: `floating-${piece.label}`, tip: `${piece.reason}\n${views}\nClick: show it.` },
          on: { click: () => this.choose(on ? null : piece) },
        },
        swatch,
        make("b", {}, piece.label),
        ` ${number(piece.area_cm2, 0)} cm²`,
      ),
      ...(on
        ? [
            make("p", { class: "note" }, `${piece.reason} ${views}`),
            make(
              "button",
              {
                type: "button",
                class: "button small",
                "aria-disabled": why ? "true" : null,
                data: {
                  id: `place-${piece.label}`,
                  tip:
                    why ?? "The view that shows most of it becomes the proposal: drag it where it belongs, accept.",
                },
                on: { click: place },
              },
              "Place by hand",
            ),
          ]
        : []),
    );
  }

  choose(piece) {
    this.chosen = piece?.label ?? null;
    this.page.changed();
    this.canvas.redraw();
  }

  get status() {
    return { pieces: this.pieces, chosen: this.chosen };
  }

  /** Each piece has a rectangle in its colour and its letter with the area. */
  draw(context, style) {
    for (const piece of this.pieces) {
      const { origin_uv_m: origin, pixel_size_m: d, rows, cols } = piece.grid;
      const [left, top] = origin;
      const [right, bottom] = [left + d * cols, top + d * rows];
      const corners = [
        [left, top],
        [right, top],
        [right, bottom],
        [left, bottom],
      ].map(([u, v]) => this.canvas.transform.toPane(u, v));
      context.beginPath();
      corners.forEach(({ x, y }, i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
      context.closePath();
      context.strokeStyle = piece.color;
      context.lineWidth = piece.label === this.chosen ? 3 : 1.5;
      context.setLineDash(piece.label === this.chosen ? [] : [5, 4]);
      context.stroke();
      context.setLineDash([]);
      this.drawLabel(context, style, corners, piece);
    }
  }

  drawLabel(context, style, corners, piece) {
    const x = Math.min(...corners.map((c) => c.x));
    const y = Math.min(...corners.map((c) => c.y));
    const text = `${piece.label} · ${number(piece.area_cm2, 0)} cm²`;
    context.font = FONT;
    context.textBaseline = "middle";
    const width = context.measureText(text).width + 20;
    context.fillStyle = style.getPropertyValue("--panel");
    context.fillRect(x, y - 21, width, 19);
    context.fillStyle = piece.color;
    context.fillRect(x, y - 21, 6, 19);
    context.fillStyle = style.getPropertyValue("--text");
    context.fillText(text, x + 12, y - 11);
  }
}
