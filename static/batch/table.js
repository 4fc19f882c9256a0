// The table of results: its rows are made once, and shown in any order.

import { isPlain, make, targetOf, within } from "../page/dom.js";

/** @type {Record<string, number>} */
const STEPS = { ArrowDown: 1, ArrowUp: -1, PageDown: 10, PageUp: -10, Home: -Infinity, End: Infinity };

/** A table with fixed widths: nothing moves while it is sorted and filtered. */
export class Table {
  rows = /** @type {Row[]} */ ([]);
  chosen = /** @type {Row | null} */ (null);
  made = /** @type {Map<Row, HTMLElement>} */ (new Map());

  /**
   * @param {{ scroller: HTMLElement; head: HTMLElement; body: HTMLElement }} places
   * @param {Column[]} columns
   * @param {(row: Row, isOpen: boolean, event: Event) => void} onChoose a row was chosen; true: by its link
   * @param {(name: string) => void} onSort a column's name was clicked
   */
  constructor({ scroller, head, body }, columns, onChoose, onSort) {
    this.body = body;
    this.columns = columns;
    this.onChoose = onChoose;
    this.titles = new Map(columns.map((column) => [column.name, titleOf(column, onSort)]));
    head.append(...this.titles.values());
    scroller.addEventListener("keydown", (event) => this.key(event));
  }

  show(/** @type {Row[]} */ rows, /** @type {Sort} */ sort) {
    this.rows = rows;
    for (const [name, th] of this.titles) {
      if (sort.name === name) th.setAttribute("aria-sort", sort.descending ? "descending" : "ascending");
      else th.removeAttribute("aria-sort");
    }
    this.body.replaceChildren(...rows.map((row) => this.rowOf(row)));
  }

  /** Choose a row, and bring it into sight. */
  choose(/** @type {Row | null} */ row) {
    for (const [one, on] of /** @type {[Row | null, boolean][]} */ ([
      [this.chosen, false],
      [row, true],
    ]))
      if (one) this.rowOf(one).setAttribute("aria-selected", String(on));
    this.chosen = row;
    if (row) this.rowOf(row).scrollIntoView({ block: "nearest" });
  }

  /** A row says something else now. */
  renew(/** @type {Row} */ row) {
    this.made.delete(row);
  }

  rowOf(/** @type {Row} */ row) {
    const made = this.made.get(row);
    if (made) return made;
    const click = (/** @type {Event} */ event) => this.onChoose(row, targetOf(event).closest("a") !== null, event);
    const tr = make(
      "tr.row",
      { click, "aria-selected": String(row === this.chosen) },
      ...this.columns.map((column) => cellOf(column, row)),
    );
    this.made.set(row, tr);
    return tr;
  }

  key(/** @type {KeyboardEvent} */ event) {
    const { rows, chosen } = this;
    const step = STEPS[event.key];
    if (step === undefined || !isPlain(event) || !rows.length) return;
    event.preventDefault();
    const at = chosen ? rows.indexOf(chosen) : -1;
    this.onChoose(rows[at < 0 ? 0 : within(at + step, 0, rows.length - 1)], false, event);
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
