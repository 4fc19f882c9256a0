// The table of results: only the rows in sight are in the document, so that thousands scroll fast.

const ROW_PX = 57;
const SPARE = 6;

/**
 * A table of many rows, of fixed height and widths: nothing moves while it is scrolled.
 *
 * `columns` are {name, title, width (px), number, show(row), node(row)}; `onChoose` is called with a row when it
 * is chosen, and with true if its link was clicked; `onSort` with the name of a column.
 *
 * @param {any} parts
 */
export function makeTable({ scroller, head, body, columns, onChoose, onSort }) {
  let rows = [];
  let chosen = null;
  let drawn = "";
  const titles = new Map();

  for (const column of columns) {
    const th = document.createElement("th");
    th.scope = "col";
    if (column.number) th.className = "number";
    if (column.sortable === false) {
      th.textContent = column.title;
      th.style.padding = "7px 8px";
    } else {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = column.title;
      button.title = column.meaning ?? column.title;
      button.addEventListener("click", () => onSort(column.name));
      th.append(button);
    }
    th.style.width = `${column.width}px`;
    titles.set(column.name, th);
    head.append(th);
  }

  function space(px) {
    const tr = document.createElement("tr");
    tr.className = "space";
    tr.setAttribute("aria-hidden", "true");
    const td = document.createElement("td");
    td.colSpan = columns.length;
    td.style.height = `${px}px`;
    tr.append(td);
    return tr;
  }

  function rowOf(row, index) {
    const tr = document.createElement("tr");
    tr.className = "row";
    tr.dataset.name = row.name;
    tr.setAttribute("aria-rowindex", String(index + 2));
    tr.setAttribute("aria-selected", String(row === chosen));
    for (const column of columns) {
      const td = document.createElement("td");
      if (column.number) td.className = "number";
      const made = column.node ? column.node(row) : null;
      if (made) td.append(made);
      else {
        td.textContent = column.show(row);
        td.title = td.textContent;
      }
      tr.append(td);
    }
    return tr;
  }

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

  function choose(row, { scroll = true } = {}) {
    chosen = row;
    const index = rows.indexOf(row);
    if (scroll && index >= 0) {
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
    const tr = event.target.closest("tr.row");
    const row = tr && rows.find((r) => r.name === tr.dataset.name);
    if (row) onChoose(row, event.target.closest("a") !== null, event);
  });
  scroller.addEventListener("keydown", (event) => {
    const step = { ArrowDown: 1, ArrowUp: -1, PageDown: 10, PageUp: -10, Home: -Infinity, End: Infinity }[event.key];
    if (step === undefined || event.ctrlKey || event.metaKey || event.altKey || !rows.length) return;
    event.preventDefault();
    const at = rows.indexOf(chosen);
    const next = at < 0 ? 0 : Math.min(rows.length - 1, Math.max(0, at + step));
    onChoose(rows[next], false, event);
  });

  return {
    show(newRows, sort) {
      rows = newRows;
      scroller.parentElement.querySelector("table").setAttribute("aria-rowcount", String(rows.length + 1));
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
