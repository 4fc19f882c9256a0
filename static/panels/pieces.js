// The pieces that float: listed with area and reason, marked on the canvas, dragged to where they belong, or
// placed by the garment.

import { PagePart } from "../page/page.js";
import { strokeLoop } from "../canvas/marks.js";
import { applied, boxOf, cornersOf, inBox } from "../canvas/geometry.js";
import { joiningText, overlapOfPiece, overlapOfProposal } from "../canvas/overlap.js";
import { drawCaption, drawMoved, drawPieces } from "../canvas/pieces.js";
import { byId, make, rebuild, smallButton, swatch } from "../page/dom.js";
import { cm2, count, floatingOf, mm, percent } from "../page/format.js";

const CLICK_PX = 4;

export class PiecesPanel extends PagePart {
  name = "pieces";
  pieces = /** @type {Piece[]} */ ([]);
  drawn = /** @type {Piece[]} */ ([]);
  /** @type {Map<string, FoundGarment["pieces"][number]>} that the garment has for them, by letter */
  places = new Map();
  chosen = /** @type {string | null} */ (null); // its letter
  section = byId("floating");
  why = /** @type {string | null} */ (null); // none can be placed by hand now
  /** The piece that is dragged, from where and by how much; until its proposal is drawn where it was dropped. */
  held = /** @type {{ piece: Piece; from: UV; by: UV; dropped: boolean } | null} */ (null);

  constructor(/** @type {Page} */ page) {
    super(page);
    page.canvas.around.push(() => this.pieces.flatMap(({ placed, grid }) => (placed ? [] : cornersOf(boxOf(grid)))));
    page.canvas.around.push(() => [...this.places.values()].flatMap((place) => place.outline_uv_m.flat()));
  }

  update(/** @type {State} */ state) {
    this.pieces = state.layers?.pieces ?? [];
    // While the garment is being recognised again, its places are those of another shape.
    const places = state.garment?.working ? [] : (state.garment?.found?.pieces ?? []);
    this.places = new Map(places.map((place) => [place.label, place]));
    if (!this.pieces.some((piece) => piece.label === this.chosen)) this.chosen = null;
    this.section.hidden = !this.pieces.length;
    this.why =
      this.canvas.side === "other"
        ? "The seams place the pieces of the other side: cut or keep one."
        : state.pending
          ? "Decide about the proposal first."
          : state.request
            ? "Something is being computed."
            : null;
    if (this.held?.dropped && !state.pending) this.held = null;
    const shown = [this.pieces, [...this.places.values()], this.chosen, this.why];
    rebuild(this.section, shown, () => this.build());
  }

  build() {
    const { pieces: floating, area_cm2: area } = floatingOf({ pieces: this.pieces });
    const placed = this.pieces.length - floating.length;
    return [
      make("h2", `Floating: ${count(floating.length, "piece")}, ${cm2(area)}`),
      placed && make("p.note", `${count(placed, "piece")} placed on the shape.`),
      floating.length > 0 && make("p.note", this.why ?? "Drag a piece on the flattened view to where it belongs."),
      make("ul.pieces", ...this.pieces.map((piece) => this.row(piece))),
    ];
  }

  row(/** @type {Piece} */ piece) {
    const { why } = this;
    const on = piece.label === this.chosen;
    const views = `Seen by view${piece.views.length === 1 ? "" : "s"} ${piece.views.join(", ")}.`;
    const place = () =>
      why ? this.page.notify("info", why) : this.page.send({ type: "place_piece", label: piece.label });
    return make(
      "li",
      make(
        "button.button.piece",
        { pressed: on, key: `floating-${piece.label}`, click: () => this.choose(on ? null : piece) },
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
          tip: why ?? "Place it where it is now, to be moved by the arrow keys or the handles.",
        }),
      ],
    );
  }

  /** The place that the garment has for a piece, to be accepted or refused like a proposal. */
  byGarment(/** @type {Piece} */ piece) {
    const place = this.places.get(piece.label);
    if (!place) return piece.placed ? make("p.note", piece.reason) : null;
    /** @param {string} title @param {boolean} accepted @param {string} tip */
    const button = (title, accepted, tip) =>
      this.page.decision(title, { type: "decide_piece", label: piece.label, accepted }, tip, false, {
        label: `${title}: piece ${piece.label}`,
        key: `garment-${piece.label}-${accepted}`,
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
    this.canvas.refit();
  }

  // --- dragging a piece ----------------------------------------------------------------------------

  press(/** @type {PointerPlace} */ { u, v }) {
    if (this.why !== null || this.page.brush?.kind || !this.canvas.layer.covers(u, v)) return false;
    const piece = this.pieces.find((one) => !one.placed && inBox(boxOf(one.grid), u, v));
    if (piece) this.held = { piece, from: [u, v], by: [0, 0], dropped: false };
    return Boolean(piece);
  }

  drag(/** @type {PointerPlace} */ { u, v }) {
    if (!this.held) return;
    this.held.by = [u - this.held.from[0], v - this.held.from[1]];
    this.canvas.redraw();
  }

  release() {
    const { held } = this;
    if (!held) return;
    const [u_m, v_m] = held.by;
    const far = Math.hypot(u_m, v_m) * this.canvas.transform.scale > CLICK_PX;
    held.dropped = far && this.page.send({ type: "place_piece", label: held.piece.label, u_m, v_m });
    if (!far) this.canvas.handlers.pick(...held.from);
    if (held.dropped) this.chosen = held.piece.label;
    else this.cancel();
  }

  cancel() {
    this.held = null;
    this.canvas.redraw();
  }

  /** The piece where it is dragged to, and whether it joins there; the same of the proposal. */
  drawHeld(/** @type {Style} */ style) {
    const { canvas, page } = this;
    const { preview } = canvas;
    const { shown } = canvas.overlay;
    if (this.held?.dropped && shown) this.held = null;
    if (shown && canvas.gesture && canvas.isMoved)
      this.captionJoining(style, shown.box, [preview.u, preview.v], overlapOfProposal(page) ?? 0);
    if (!this.held) return;
    const { piece, by } = this.held;
    const box = boxOf(piece.grid);
    drawMoved(canvas, style, [/** @type {UV[]} */ (cornersOf(box))], [0, ...by]);
    this.captionJoining(style, box, by, overlapOfPiece(page, piece, by));
  }

  /** @param {Style} style @param {Box} box @param {UV} by @param {number} overlap */
  captionJoining(style, box, [du, dv], overlap) {
    const there = /** @type {UV[]} */ (cornersOf(box).map(([u, v]) => [u + du, v + dv]));
    drawCaption(this.canvas, style, joiningText(overlap), there);
  }

  /** Each floating piece has a rectangle and its letter; one with a place by the garment its outline there. */
  drawOver(/** @type {Context} */ context, /** @type {Style} */ style) {
    // Those of the picture that is shown; that of the present state may be on its way.
    if (this.canvas.layerRevision === this.page.state?.layers?.revision) this.drawn = this.pieces;
    for (const piece of this.drawn) this.drawPlace(piece);
    this.drawBrought();
    const beside = this.drawn.filter((piece) => !piece.placed);
    drawPieces(this.canvas, context, style, beside, this.chosen);
    this.drawHeld(style);
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
    if (!place || place.state === "refused" || (piece.placed && place.state !== "placed")) return;
    const chosen = piece.label === this.chosen;
    const dash = piece.placed ? [] : [5, 4];
    for (const loop of place.outline_uv_m) strokeLoop(this.canvas, loop, piece.color, chosen ? 3 : 1.5, { dash });
  }
}
