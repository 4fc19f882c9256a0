// The pieces that float: listed with area and reason, marked on the canvas, placed by hand or by the garment.

import { PagePart } from "../page/page.js";
import { strokeLoop } from "../canvas/marks.js";
import { applied, boxOf, cornersOf } from "../canvas/geometry.js";
import { drawPieces } from "../canvas/pieces.js";
import { percent } from "../garment/lists.js";
import { byId, make, rebuild, smallButton, swatch } from "../page/dom.js";
import { cm2, count, floatingOf, mm } from "../page/format.js";

export class PiecesPanel extends PagePart {
  name = "pieces";
  pieces = /** @type {Piece[]} */ ([]);
  /** @type {Map<string, FoundGarment["pieces"][number]>} that the garment has for them, by letter */
  places = new Map();
  chosen = /** @type {string | null} */ (null); // its letter
  section = byId("floating");

  update(/** @type {State} */ state) {
    this.pieces = state.layers?.pieces ?? [];
    // While the garment is being recognised again, its places are those of another shape.
    const places = state.garment?.working ? [] : (state.garment?.found?.pieces ?? []);
    this.places = new Map(places.map((place) => [place.label, place]));
    if (!this.pieces.some((piece) => piece.label === this.chosen)) this.chosen = null;
    this.section.hidden = !this.pieces.length;
    const why =
      this.canvas.side === "other"
        ? "The seams place the pieces of the other side: cut or keep one."
        : state.pending
          ? "Decide about the proposal first."
          : state.request
            ? "Something is being computed."
            : null;
    rebuild(this.section, [this.pieces, [...this.places.values()], this.chosen, why], () => this.build(why));
  }

  build(/** @type {string | null} */ why) {
    const { pieces: floating, area_cm2: area } = floatingOf({ pieces: this.pieces });
    const placed = this.pieces.length - floating.length;
    return [
      make("h2", `Floating: ${count(floating.length, "piece")}, ${cm2(area)}`),
      placed && make("p.note", `${count(placed, "piece")} placed by the garment.`),
      make("ul.pieces", ...this.pieces.map((piece) => this.row(piece, why))),
    ];
  }

  row(/** @type {Piece} */ piece, /** @type {string | null} */ why) {
    const on = piece.label === this.chosen;
    const views = `Seen by view${piece.views.length === 1 ? "" : "s"} ${piece.views.join(", ")}.`;
    const place = () =>
      why ? this.page.notify("info", why) : this.page.send({ type: "place_piece", label: piece.label });
    return make(
      "li",
      make(
        "button.button.piece",
        {
          pressed: on,
          key: `floating-${piece.label}`,
          tip: `${piece.reason}\n${views}\nClick: show it.`,
          click: () => this.choose(on ? null : piece),
        },
        swatch(piece.color),
        make("b", piece.label),
        ` ${cm2(piece.area_cm2)}`,
      ),
      this.byGarment(piece),
      on && [
        make("p.note", `${piece.reason} ${views}`),
        smallButton("Place by hand", place, {
          "aria-disabled": why ? "true" : null,
          key: `place-${piece.label}`,
          tip: why ?? "The view that shows most of it is proposed: drag it onto the shape; the piece comes along.",
        }),
      ],
    );
  }

  /** The place that the garment has for a piece, to be accepted or refused like a proposal. */
  byGarment(/** @type {Piece} */ piece) {
    const place = this.places.get(piece.label);
    if (!place) return piece.placed ? make("p.note", "Placed by the garment.") : null;
    /** @param {string} title @param {boolean} accepted @param {string} tip */
    const button = (title, accepted, tip) =>
      smallButton(title, () => this.page.send({ type: "decide_piece", label: piece.label, accepted }), {
        label: `${title}: piece ${piece.label}`,
        key: `garment-${piece.label}-${accepted}`,
        tip: `${tip}\nUndo takes it back.`,
      });
    const text = `By the garment: ${percent(place.probability)}, ± ${mm(place.std_mm, 0)}`;
    const accept = button("Place there", true, "It becomes part of the shape that is shown, where it is outlined.");
    const refuse = button("Refuse", false, "The garment has no place for it there.");
    return make(
      "div.by-garment",
      { role: "group", label: `Place of piece ${piece.label} by the garment` },
      make("p.note", place.state === "proposed" ? `${text}.` : `${text}: ${place.state}.`),
      place.state !== "placed" && accept,
      place.state !== "refused" && refuse,
    );
  }

  choose(/** @type {Piece | null} */ piece) {
    this.chosen = piece?.label ?? null;
    this.page.changed();
    this.canvas.redraw();
  }

  /** Each floating piece has a rectangle and its letter; one with a place by the garment its outline there. */
  drawOver(/** @type {Context} */ context, /** @type {Style} */ style) {
    for (const piece of this.pieces) this.drawPlace(piece);
    this.drawBrought();
    const beside = this.pieces.filter((piece) => !piece.placed);
    drawPieces(this.canvas, context, style, beside, this.chosen);
  }

  /** Where a piece comes to lie that goes along with the proposal. */
  drawBrought() {
    const { brings } = this.page.state?.pending ?? {};
    const piece = brings && this.pieces.find(({ label }) => label === brings.label);
    if (!piece) return;
    const { theta_rad: turn, u_m, v_m } = brings.placement;
    const corners = cornersOf(boxOf(piece.grid)).map(([u, v]) => applied([turn, u_m, v_m], u, v));
    strokeLoop(this.canvas, corners, piece.color, 2.5, { dash: [2, 3] });
  }

  /** The outline of a piece where the garment has a place for it. */
  drawPlace(/** @type {Piece} */ piece) {
    const place = this.places.get(piece.label);
    if (!place || place.state === "refused") return;
    const chosen = piece.label === this.chosen;
    const dash = piece.placed ? [] : [5, 4];
    for (const loop of place.outline_uv_m) strokeLoop(this.canvas, loop, piece.color, chosen ? 3 : 1.5, { dash });
  }
}
