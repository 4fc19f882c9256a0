// The table of results: only the rows in sight are in the document, so that thousands scroll fast.

import { find, isPlain, make, targetOf, within } from "/static/page/dom.js";

const ROW_PX = 57;
const SPARE = 6;
/** @type {Record<string, number>} */
const STEPS = { ArrowDown: 1, ArrowUp: -1, PageDown: 10, PageUp: -10, Home: -Infinity, End: Infinity };

/**
 * A table of many rows, of fixed height and widths: nothing moves while it is scrolled.
 *
 * `columns` are {name, title, width (px), number, show(row), node(row)}; `onChoose` is called with a row when it
 * is chosen, and with true if its link was clicked; `onSort` with the name of a column.
 *
 * @param {object} parts
 * @param {HTMLElement} parts.scroller
 * @param {HTMLElement} parts.head
 * @param {HTMLElement} parts.body
 * @param {Column[]} parts.columns
 * @param {(row: Row, isOpen: boolean, event: Event) => void} parts.onChoose
 * @param {(name: string) => void} parts.onSort
 */
export function makeTable({ scroller, head, body, columns, onChoose, onSort }) {
  let rows = /** @type {Row[]} */ ([]);
  let chosen = /** @type {Row | null} */ (null);
  let drawn = "";
  const titles = new Map();

  for (const column of columns) {
    const { name, title, meaning, number, sortable, width } = column;
    const content =
      sortable === false ? title : make("button", { title: meaning ?? title, click: () => onSort(name) }, title);
    const style = { width: `${width}px`, padding: sortable === false ? "7px 8px" : "" };
    const th = make("th", { scope: "col", class: number ? "number" : null, style }, content);
    titles.set(name, th);
    head.append(th);
  }

  const space = (/** @type {number} */ px) =>
    make(
      "tr.space",
      { "aria-hidden": "true" },
      make("td", { colspan: columns.length, style: { height: `${px}px` } }),
    );

  function cellOf(/** @type {Column} */ column, /** @type {Row} */ row) {
    const { node } = column;
    const text = node ? null : column.show(row);
    return make("td", { class: column.number ? "number" : null, title: text }, text ?? node?.(row));
  }

  const rowOf = (/** @type {Row} */ row, /** @type {number} */ index) =>
    make(
      "tr.row",
      { data: { name: row.name }, "aria-rowindex": index + 2, "aria-selected": String(row === chosen) },
      ...columns.map((column) => cellOf(column, row)),
    );

  function draw() {
    const first = Math.max(0, Math.floor(scroller.scrollTop / ROW_PX) - SPARE);
    const last = Math.min(rows.length, Math.ceil((scroller.scrollTop + scroller.clientHeight) / ROW_PX) + SPARE);
    const key = `${first} ${last}`;
    if (key === drawn) return;
    drawn = key;
    const nodes = [];
    if (first > 0) nodes.push(space(first * ROW_PX));
    for (let n = first; n < last; n++) nodes.push(rowOf(rows[n], n));
    if (last < rows.length) nodes.push(space((rows.length - last) * ROW_PX));
    body.replaceChildren(...nodes);
  }

  function redraw() {
    drawn = "";
    draw();
  }

  function choose(/** @type {Row | null} */ row) {
    chosen = row;
    const index = row ? rows.indexOf(row) : -1;
    if (index >= 0) {
      const top = index * ROW_PX;
      if (top < scroller.scrollTop) scroller.scrollTop = top;
      else if (top + 2 * ROW_PX > scroller.scrollTop + scroller.clientHeight)
        scroller.scrollTop = top + 2 * ROW_PX - scroller.clientHeight;
    }
    redraw();
  }

  scroller.addEventListener("scroll", draw, { passive: true });
  new ResizeObserver(redraw).observe(scroller);
  body.addEventListener("click", (event) => {
    const tr = /** @type {HTMLElement | null} */ (targetOf(event).closest("tr.row"));
    const row = tr && rows.find((r) => r.name === tr.dataset.name);
    if (row) onChoose(row, targetOf(event).closest("a") !== null, event);
  });
  scroller.addEventListener("keydown", (event) => {
    const step = STEPS[event.key];
    if (step === undefined || !isPlain(event) || !rows.length) return;
    event.preventDefault();
    const at = chosen ? rows.indexOf(chosen) : -1;
    const next = at < 0 ? 0 : within(at + step, 0, rows.length - 1);
    onChoose(rows[next], false, event);
  });

  return {
    show(/** @type {Row[]} */ newRows, /** @type {Sort} */ sort) {
      rows = newRows;
      find("table", scroller).setAttribute("aria-rowcount", String(rows.length + 1));
      for (const [name, th] of titles) {
        if (sort.name === name) th.setAttribute("aria-sort", sort.descending ? "descending" : "ascending");
        else th.removeAttribute("aria-sort");
      }
      redraw();
    },
    choose,
    redraw,
    get rows() {
      return rows;
    },
    get chosen() {
      return chosen;
    },
  };
}
