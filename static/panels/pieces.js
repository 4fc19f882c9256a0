// The pieces that float: listed with area and reason, marked on the canvas, placed by hand.

import { drawPieces } from "/static/canvas/pieces.js";
import { byId, make, rebuild } from "/static/page/dom.js";
import { count, number } from "/static/page/format.js";

export class PiecesPanel {
  name = "pieces";

  constructor(page) {
    this.page = page;
    this.canvas = page.canvas;
    this.pieces = [];
    this.chosen = null; // its letter
    this.section = make("section", { id: "floating", "aria-label": "Floating pieces", hidden: true });
    byId("pick").before(this.section);
    this.canvas.drawers.push((_, context, style) =>
      drawPieces(this.canvas, context, style, this.pieces, this.chosen),
    );
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
}
