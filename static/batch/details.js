// The chosen result, with all columns of the table.

import { make } from "../page/dom.js";

/**
 * Show a row of the table with all columns, or none.
 * @param {Element} place @param {Row | null} row @param {Column[]} columns
 */
export function showDetails(place, row, columns) {
  if (!row) return place.replaceChildren("Choose a result.");
  /** @type {Record<string, string | null>} */
  const classes = { outcome: row.outcome === "done" ? "done" : "bad", review: row.review };
  const values = columns.map((column) => ({ ...column, value: column.show(row) }));
  const list = values
    .filter(({ name, value }) => value !== "" && name !== "name")
    .map(({ name, title, meaning, value }) => [
      make("dt", { title: meaning ?? "" }, title),
      make("dd", { class: classes[name] }, value),
    ]);
  const picture = row.thumbnail && make("img", { src: row.thumbnail, alt: `The flattened shape of ${row.name}` });
  place.replaceChildren(...[make("h2", row.name), picture || [], make("dl", list)].flat());
}
