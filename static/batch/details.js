// The chosen result, with all columns of the table.

import { make } from "../page/dom.js";

const STAGES = {
  opening: "#5b8def",
  integrating: "#d98a29",
  garment: "#3fa7a0",
  writing: "#6fae5a",
  measuring: "#a874c9",
};

function stagesOf(/** @type {Row} */ row) {
  const known = Object.entries(STAGES)
    .map(([name, color]) => ({ name, color, seconds: Number(row[`seconds_${name}`] ?? NaN) }))
    .filter(({ seconds }) => !Number.isNaN(seconds) && row.seconds);
  const words = known.map(({ name, seconds }) => `${name} ${seconds.toFixed(1)} s`).join(", ");
  const parts = known.map(({ color, seconds }) =>
    make("i", { style: { width: `${(100 * seconds) / Number(row.seconds)}%`, background: color } }),
  );
  return make("div.stages", { role: "img", label: `Time by stage: ${words}`, title: words }, parts);
}

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
  const stages = typeof row.seconds === "number" && [stagesOf(row)];
  place.replaceChildren(...[make("h2", row.name), picture || [], stages || [], make("dl", list)].flat());
}
