// The side of interest: brushes on the source image and the shape, what is uncertain, where to stroke next.

import { PagePart } from "../page/page.js";
import { askPicture, Fetched } from "../page/connection.js";
import { byId, make, section, setText, within } from "../page/dom.js";
import { mm } from "../page/format.js";

const RADII_MM = [4, 6, 8, 10, 15, 20, 30];
const FIRST_MM = 10;
const MOST_POINTS = 900; // of a stroke; the server takes a thousand
const COLORS = { this: "--side-this", other: "--side-other" };

export class SidesPanel extends PagePart {
  name = "sides";
  actions = {
    brush_this: () => this.take("this"),
    brush_other: () => this.take("other"),
    brush_smaller: () => this.resize(-1),
    brush_larger: () => this.resize(1),
    where_to_stroke: () => this.askWhere(1),
    where_before: () => this.askWhere(-1),
    show_sides: () => this.toggle("shown"),
    show_certainty: () => this.toggle("certain"),
  };
  /** @type {Panel["messages"]} */
  messages = { where_to_stroke: (answer) => this.goTo(answer) };
  side = /** @type {SideName | null} */ (null); // what a stroke says; null: no brush
  radius_mm = FIRST_MM;
  shown = true;
  certain = false;
  /** @type {UV[] | null} */
  line = null; // of the stroke that is being drawn on the shape: [[u, v], ...]
  known = /** @type {State["sides"]} */ (null);
  place = /** @type {{ revision: number | null; number: number } | null} */ (null); // where to stroke
  image = new Fetched(askPicture, () => this.canvas.redraw()); // the uncertainty of the shape
  panel = byId("sides");

  constructor(/** @type {Page} */ page) {
    super(page);
    page.brush = this;
    const slider = byId("brush-radius");
    slider.max = String(RADII_MM.length - 1);
    slider.addEventListener("input", () => this.setRadius(slider.valueAsNumber));
  }

  get pressed() {
    return {
      brush_this: this.side === "this",
      brush_other: this.side === "other",
      show_sides: this.shown,
      show_certainty: this.certain,
    };
  }

  get radius_m() {
    return this.radius_mm / 1000;
  }

  update(/** @type {State} */ state) {
    this.known = state.sides ?? null;
    this.panel.hidden = !this.known;
    if (!this.known) {
      this.side = null;
      return;
    }
    this.show(this.known);
    this.fetchImage(state);
  }

  show(/** @type {NonNullable<State["sides"]>} */ known) {
    setText(byId("sides-text"), known.text);
    const { conflicts } = known;
    section("sides-conflicts", conflicts.length > 0 && conflicts, () => conflicts.map((text) => make("li", text)));
    this.showRadius();
  }

  showRadius() {
    byId("brush-radius").value = String(RADII_MM.indexOf(this.radius_mm));
    byId("brush-radius").setAttribute("aria-valuetext", `${this.radius_mm} mm`);
    setText(byId("brush-size"), mm(this.radius_mm, 0));
  }

  // --- the brush -------------------------------------------------------------------------------

  take(/** @type {SideName} */ side) {
    if (!this.known) {
      this.page.notify("info", "This recording has masks of its own; there is nothing to paint.");
      return;
    }
    this.side = this.side === side ? null : side;
    this.line = null;
    this.tellScene();
    this.page.changed();
    this.canvas.redraw();
  }

  /** Clicks in the 3D scene paint while a brush is taken. */
  tellScene() {
    this.page.send({ type: "brush", side: this.side, radius_m: this.radius_m });
  }

  reconnected() {
    this.tellScene();
  }

  resize(/** @type {number} */ by) {
    this.setRadius(within(RADII_MM.indexOf(this.radius_mm) + by, 0, RADII_MM.length - 1));
  }

  setRadius(/** @type {number} */ index) {
    this.radius_mm = RADII_MM[index];
    if (this.known) this.showRadius();
    this.tellScene();
    this.canvas.redraw();
  }

  toggle(/** @type {"shown" | "certain"} */ what) {
    this[what] = !this[what];
    this.page.changed();
    this.canvas.redraw();
  }

  escape() {
    if (!this.side) return false;
    this.take(this.side);
    return true;
  }

  // --- a tool of the canvas --------------------------------------------------------------------

  press(/** @type {PointerPlace} */ at) {
    if (!this.side || !this.canvas.layer.shown) return false;
    this.line = [[at.u, at.v]];
    this.canvas.redraw();
    return true;
  }

  drag(/** @type {PointerPlace} */ at) {
    if (!this.line || this.line.length >= MOST_POINTS) return;
    this.line.push([at.u, at.v]);
    this.canvas.redraw();
  }

  release(/** @type {PointerPlace} */ at) {
    const line = this.line;
    this.line = null;
    if (!line) return;
    this.drag(at);
    const { side, radius_m } = this;
    const on = this.onSheet(line);
    if (side) this.page.send({ type: "stroke_shape", side, points_uv_m: on.line, radius_m, sheet: on.sheet });
    this.canvas.redraw();
  }

  /** A line of the canvas on the side of the item that it begins on. */
  onSheet(/** @type {UV[]} */ line) {
    const places = line.map(([u, v]) => this.canvas.located(u, v));
    const [{ sheet }] = places;
    const on = places.filter((place) => place.sheet === sheet);
    return { sheet, line: on.map(({ u_m, v_m }) => /** @type {UV} */ ([u_m, v_m])) };
  }

  /** A line on one side means nothing on the other. */
  turned() {
    this.line = null;
  }

  /** Two fingers zoom: what the first one began is no stroke. */
  cancel() {
    this.line = null;
  }

  // --- on the source image ---------------------------------------------------------------------

  get color() {
    return COLORS[this.side ?? "this"];
  }

  paintImage(/** @type {number} */ view, /** @type {UV[]} */ points) {
    const { side, radius_m } = this;
    const most = points.slice(0, MOST_POINTS);
    if (side) this.page.send({ type: "stroke_image", side, view_index: view, points_rc: most, radius_m });
  }

  /** The address of the labels of a view, null if they are not shown or not known. */
  addressOf(/** @type {number} */ view) {
    if (!this.known?.certainty || !(this.shown || this.certain)) return null;
    return `sides/${view}.png?layer=${this.certain ? "certainty" : "side"}&revision=${this.known.revision}`;
  }

  /** The addresses of a small image of a view and of its labels, null if they are not shown or not known. */
  thumbsOf(/** @type {number} */ view) {
    const labels = this.addressOf(view)?.replace(".png", "/small.png");
    return labels ? [`sides/${view}/color.jpg?v=${this.known?.token}`, labels] : null;
  }

  /** Go to the next place, or to that before; after a stroke the best one is the first again. */
  askWhere(/** @type {1 | -1} */ step) {
    const revision = this.known?.revision ?? null;
    const number = this.place?.revision === revision ? this.place.number + step : 0;
    this.place = { revision, number };
    this.page.send({ type: "where_to_stroke", number });
  }

  goTo(/** @type {import("../page/messages").StrokeAdvice} */ answer) {
    if (this.place) this.place.number = answer.number;
    this.page.notify("info", answer.text);
    if (answer.view_index !== null && answer.rc) this.page.each("lookAt", answer.view_index, answer.rc);
  }

  // --- over the shape --------------------------------------------------------------------------

  fetchImage(/** @type {State} */ state) {
    const layers = state.layers?.revision;
    const known = this.certain && layers && this.canvas.side === "this" ? this.known : null;
    const key = known && known.certainty !== null ? `${layers}-${known.revision}` : null;
    this.image.want(key && `sides/shape.png?revision=${key}`);
  }

  drawOver(/** @type {Pen} */ pen) {
    const canvas = this.canvas;
    const shown = canvas.layer.shown;
    const { value: image } = this.image;
    if (image && shown && image.width === shown.grid.cols) canvas.drawPicture(shown, image);
    if (!this.side || !this.line) return;
    pen.context.globalAlpha = 0.55;
    pen.line(this.line.map(pen.at), this.color, Math.max(2, 2 * this.radius_m * canvas.transform.scale));
    pen.context.globalAlpha = 1;
  }
}
