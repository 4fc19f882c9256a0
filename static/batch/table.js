// The table of results: only the rows in sight are in the document, so that thousands scroll fast.

import { find, isPlain, make, targetOf, within } from "../page/dom.js";

const ROW_PX = 57;
const SPARE = 6;
/** @type {Record<string, number>} */
const STEPS = { ArrowDown: 1, ArrowUp: -1, PageDown: 10, PageUp: -10, Home: -Infinity, End: Infinity };

/** A table of many rows, of fixed height and widths: nothing moves while it is scrolled. */
export class Table {
  rows = /** @type {Row[]} */ ([]);
  chosen = /** @type {Row | null} */ (null);
  drawn = "";

  /**
   * @param {{ scroller: HTMLElement; head: HTMLElement; body: HTMLElement }} places
   * @param {Column[]} columns
   * @param {(row: Row, isOpen: boolean, event: Event) => void} onChoose a row was chosen; true: by its link
   * @param {(name: string) => void} onSort a column's name was clicked
   */
  constructor({ scroller, head, body }, columns, onChoose, onSort) {
    this.scroller = scroller;
    this.body = body;
    this.columns = columns;
    this.onChoose = onChoose;
    this.titles = new Map(columns.map((column) => [column.name, titleOf(column, onSort)]));
    head.append(...this.titles.values());
    scroller.addEventListener("scroll", () => this.draw(), { passive: true });
    new ResizeObserver(() => this.redraw()).observe(scroller);
    body.addEventListener("click", (event) => this.click(event));
    scroller.addEventListener("keydown", (event) => this.key(event));
  }

  show(/** @type {Row[]} */ rows, /** @type {Sort} */ sort) {
    this.rows = rows;
    find("table", this.scroller).setAttribute("aria-rowcount", String(rows.length + 1));
    for (const [name, th] of this.titles) {
      if (sort.name === name) th.setAttribute("aria-sort", sort.descending ? "descending" : "ascending");
      else th.removeAttribute("aria-sort");
    }
    this.redraw();
  }

  /** Choose a row, and bring it into sight. */
  choose(/** @type {Row | null} */ row) {
    this.chosen = row;
    const { scroller } = this;
    const index = row ? this.rows.indexOf(row) : -1;
    if (index >= 0) {
      const top = index * ROW_PX;
      if (top < scroller.scrollTop) scroller.scrollTop = top;
      else if (top + 2 * ROW_PX > scroller.scrollTop + scroller.clientHeight)
        scroller.scrollTop = top + 2 * ROW_PX - scroller.clientHeight;
    }
    this.redraw();
  }

  // --- the rows in sight -----------------------------------------------------------------------

  redraw() {
    this.drawn = "";
    this.draw();
  }

  draw() {
    const { rows, scroller } = this;
    const first = Math.max(0, Math.floor(scroller.scrollTop / ROW_PX) - SPARE);
    const last = Math.min(rows.length, Math.ceil((scroller.scrollTop + scroller.clientHeight) / ROW_PX) + SPARE);
    const key = `${first} ${last}`;
    if (key === this.drawn) return;
    this.drawn = key;
    const nodes = [];
    if (first > 0) nodes.push(this.space(first));
    for (let n = first; n < last; n++) nodes.push(this.rowOf(rows[n], n));
    if (last < rows.length) nodes.push(this.space(rows.length - last));
    this.body.replaceChildren(...nodes);
  }

  /** What stands for so many rows out of sight. */
  space(/** @type {number} */ count) {
    const style = { height: `${count * ROW_PX}px` };
    return make("tr.space", { "aria-hidden": "true" }, make("td", { colspan: this.columns.length, style }));
  }

  rowOf(/** @type {Row} */ row, /** @type {number} */ index) {
    return make(
      "tr.row",
      { data: { name: row.name }, "aria-rowindex": index + 2, "aria-selected": String(row === this.chosen) },
      ...this.columns.map((column) => cellOf(column, row)),
    );
  }

  // --- pointer and keys ------------------------------------------------------------------------

  click(/** @type {Event} */ event) {
    const tr = /** @type {HTMLElement | null} */ (targetOf(event).closest("tr.row"));
    const row = tr && this.rows.find((r) => r.name === tr.dataset.name);
    if (row) this.onChoose(row, targetOf(event).closest("a") !== null, event);
  }

  key(/** @type {KeyboardEvent} */ event) {
    const { rows, chosen } = this;
    const step = STEPS[event.key];
    if (step === undefined || !isPlain(event) || !rows.length) return;
    event.preventDefault();
    const at = chosen ? rows.indexOf(chosen) : -1;
    const next = at < 0 ? 0 : within(at + step, 0, rows.length - 1);
    this.onChoose(rows[next], false, event);
  }
}

/** @param {Column} column @param {(name: string) => void} onSort */
function titleOf({ name, title, meaning, number, sortable, width }, onSort) {
  const content =
    sortable === false ? title : make("button", { title: meaning ?? title, click: () => onSort(name) }, title);
  const style = { width: `${width}px`, padding: sortable === false ? "7px 8px" : "" };
  return make("th", { scope: "col", class: number ? "number" : null, style }, content);
}

function cellOf(/** @type {Column} */ column, /** @type {Row} */ row) {
  const { node } = column;
  const text = node ? null : column.show(row);
  return make("td", { class: column.number ? "number" : null, title: text }, text ?? node?.(row));
}
