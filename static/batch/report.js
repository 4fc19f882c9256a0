// The page of a batch: what is chosen, sorted, filtered and decided; served, verdicts are kept.

import { Table } from "./table.js";
import { post } from "../page/connection.js";
import { byId, make, optionsOf, setText } from "../page/dom.js";

/**
 * @type {{
 *   served: boolean; serve: string; rows: Row[]; title: string; counts: string; notes: string;
 *   columns: { name: string; kind: string; meaning: string }[]
 * }}
 */
const data = JSON.parse(byId("data").textContent ?? "");
const served = data.served && location.protocol.startsWith("http");
const rows = data.rows;

const number = (/** @type {number} */ digits) => (/** @type {Cell} */ value) =>
  typeof value === "number" ? value.toFixed(digits) : "";
const percent = (/** @type {Cell} */ value) => (typeof value === "number" ? `${(100 * value).toFixed(0)} %` : "");
/**
 * How columns look that are not plain text, or have a width (px) in the table: those are its columns, in their order.
 *
 * @type {Record<string, { title?: string; format?: (value: Cell) => string; width?: number }>}
 */
const LOOKS = {
  name: { width: 180 },
  outcome: { width: 170 },
  reliability: { format: percent, width: 84 },
  area_cm2: { title: "area cm\u00b2", format: number(0), width: 84 },
  coverage_estimate: { title: "coverage", format: percent, width: 84 },
  reliable_share: { title: "reliable", format: percent, width: 84 },
  uncertainty_mm: { title: "uncertainty mm", format: number(1), width: 116 },
  floating_cm2: { title: "floating cm\u00b2", format: number(0), width: 96 },
  views_used: { title: "views", width: 60 },
  garment: { width: 84 },
  seconds: { title: "s", format: number(1), width: 60 },
  peak_memory_mb: { title: "peak MB", format: number(0), width: 80 },
  review: { width: 84 },
  garment_probability: { format: percent },
  cpu_seconds: { format: number(1) },
  memory_after_mb: { format: number(0) },
};
const text = (/** @type {Cell} */ value) => (value === null || value === undefined ? "" : String(value));

/** @type {Column[]} */
const every = data.columns.map(({ name, kind, meaning }) => {
  const { title = name.replaceAll("_", " "), format = kind === "number" ? number(2) : text } = LOOKS[name] ?? {};
  const isNumber = kind === "number" || kind === "count";
  return { name, meaning, title, number: isNumber, format, show: (row) => format(row[name]) };
});

const named = new Map(every.map((column) => [column.name, column]));

// --- the table -------------------------------------------------------------------------------

const picture = (/** @type {Row} */ { thumbnail: src }) =>
  src && make("img", { src, alt: "", decoding: "async", loading: "lazy", width: 48, height: 48 });

const link = (/** @type {Row} */ { name }) =>
  make("a", { href: `#${encodeURIComponent(name)}`, title: `Open the session of ${name}` }, name);

function outcome(/** @type {Row} */ row) {
  const done = row.edited ? "done, edited" : "done";
  const good = row.outcome === "done";
  const words = good ? done : `${row.outcome}: ${text(row.reason)}`;
  return make("span", { class: good ? "done" : "bad", title: text(row.reason) }, words);
}

const verdict = (/** @type {Row} */ row) => make("span", { class: row.review }, text(row.review));

/** @type {Record<string, Column["node"]>} */
const NODES = { name: link, outcome, review: verdict };
const anyGarment = rows.some((row) => row.garment);
const shownColumns = Object.entries(LOOKS)
  .filter(([name, { width }]) => width && (name !== "garment" || anyGarment))
  .map(([name, { width }]) => ({ .../** @type {Column} */ (named.get(name)), node: NODES[name], width }));

let sort = { name: "reliability", descending: false };
const table = new Table(
  { scroller: byId("scroller"), head: byId("head"), body: byId("body") },
  [{ name: "picture", title: "shape", width: 64, sortable: false, node: picture, show: () => "" }, ...shownColumns],
  (row, isOpen, event) => {
    choose(row);
    if (isOpen) {
      event.preventDefault();
      openSession();
    }
  },
  (name) => {
    sort = { name, descending: sort.name === name ? !sort.descending : false };
    refresh();
  },
);

/** For tests and scripts that control the page. */
const state = { revision: 0, shown: 0, rows: rows.length, chosen: /** @type {string | null} */ (null) };
Object.assign(window, { flatclothBatch: state });

const filters = {
  find: byId("find"),
  outcome: byId("outcome"),
  review: byId("review"),
  garment: /** @type {HTMLSelectElement} */ (byId("garment")),
};
const fill = (/** @type {HTMLElement} */ select, /** @type {string[][]} */ values) =>
  select.append(...optionsOf([["", "all"], ...values], ""));

const counted = (/** @type {string} */ name) => {
  const count = new Map();
  for (const row of rows) if (row[name]) count.set(row[name], (count.get(row[name]) ?? 0) + 1);
  return [...count].map(([value, n]) => [value, `${value} (${n})`]);
};
fill(filters.outcome, counted("outcome"));
fill(filters.review, [
  ["none", "not reviewed"],
  ["accepted", "accepted"],
  ["rejected", "rejected"],
]);
fill(filters.garment, counted("garment"));
byId("garment-label").hidden = !anyGarment;

function matches(/** @type {Row} */ row) {
  const sought = filters.find.value.trim().toLowerCase();
  if (sought && !row.sought.includes(sought)) return false;
  if (filters.outcome.value && row.outcome !== filters.outcome.value) return false;
  if (filters.garment.value && row.garment !== filters.garment.value) return false;
  const review = filters.review.value;
  return !review || (review === "none" ? !row.review : row.review === review);
}

for (const row of rows)
  row.sought = [row.name, row.source, row.reason, row.garment, row.notes].map(text).join("\n").toLowerCase();

const NO_CONNECTION = "There is no connection to flatcloth.";
const collator = new Intl.Collator(undefined, { numeric: true });

/** Missing values come first: a failure is least reliable. */
function compare(/** @type {Row} */ a, /** @type {Row} */ b) {
  const [x, y] = [a[sort.name] ?? null, b[sort.name] ?? null];
  let order = 0;
  if (x === null || y === null) order = Number(x !== null) - Number(y !== null);
  else order = typeof x === "number" ? x - Number(y) : collator.compare(String(x), String(y));
  return (sort.descending ? -order : order) || a.place - b.place;
}

function refresh() {
  const shown = rows.filter(matches).sort(compare);
  table.show(shown, sort);
  byId("shown").textContent = `${shown.length} of ${rows.length} shown`;
  state.shown = shown.length;
  state.revision += 1;
}

// --- review ----------------------------------------------------------------------------------

function choose(/** @type {Row | null} */ row) {
  table.choose(row);
  showDetails(row);
  state.chosen = row?.name ?? null;
}

/** Show a row of the table with all columns, or none. */
function showDetails(/** @type {Row | null} */ row) {
  if (!row) return byId("details").replaceChildren("Choose a result.");
  /** @type {Record<string, string | null>} */
  const classes = { outcome: row.outcome === "done" ? "done" : "bad", review: row.review };
  const list = every.flatMap(({ name, title, meaning, show }) => {
    const value = name === "name" ? "" : show(row);
    return value ? [make("dt", { title: meaning ?? "" }, title), make("dd", { class: classes[name] }, value)] : [];
  });
  const picture = row.thumbnail && make("img", { src: row.thumbnail, alt: `The flattened shape of ${row.name}` });
  byId("details").replaceChildren(make("h2", row.name), ...(picture ? [picture] : []), make("dl", list));
}

function showProgress() {
  const decided = rows.filter((row) => row.review).length;
  const all = rows.filter((row) => row.review || row.outcome === "done").length;
  const count = (/** @type {string} */ name) => rows.filter((row) => row.review === name).length;
  say(
    `${decided} of ${all} reviewed: ${count("accepted")} accepted, ${count("rejected")} rejected.` +
      (served ? "" : " In a file, verdicts are not kept."),
  );
}

/** The next finished result without a verdict, least reliable first, in any order of the table. */
function next() {
  const open = rows.filter((row) => !row.review && row.outcome === "done").sort((a, b) => a.place - b.place);
  const at = table.chosen && !table.chosen.review ? table.chosen.place : -1;
  const row = open.find((one) => one.place > at) ?? open[0];
  if (!row) return;
  if (!table.rows.includes(row)) clearFilters();
  choose(row);
}

async function decide(/** @type {string | null} */ review) {
  const row = table.chosen;
  if (!row) return;
  if (!served) return showCommand(row);
  const answer = await post("verdict", { name: row.name, verdict: review });
  if (!answer?.ok) return say((await answer?.text()) ?? NO_CONNECTION);
  row.review = review;
  table.renew(row);
  showProgress();
  refresh();
  if (review) next();
  else choose(row);
}

async function openSession() {
  const row = table.chosen;
  if (!row) return;
  if (!served) return showCommand(row);
  const tab = window.open("", "_blank");
  say(`Opening ${row.name} \u2026`);
  const answer = await post("open", { name: row.name });
  if (answer?.ok) {
    const { url } = await answer.json();
    (tab ?? window).location.href = url;
    showProgress();
  } else {
    tab?.close();
    say((await answer?.text()) ?? NO_CONNECTION);
  }
}

const say = (/** @type {string} */ words) => setText(byId("progress"), words);

function showCommand(/** @type {Row} */ row) {
  byId("command-text").textContent = row.command;
  byId("serve-text").textContent = data.serve;
  byId("command").showModal();
}

byId("copy").addEventListener("click", () => navigator.clipboard?.writeText(byId("command-text").textContent ?? ""));

function clearFilters() {
  for (const filter of Object.values(filters)) filter.value = "";
  refresh();
}

for (const filter of Object.values(filters)) filter.addEventListener("input", refresh);
byId("clear").addEventListener("click", clearFilters);
/** @type {Record<string, [string, () => void]>} */
const ACTIONS = {
  j: ["next", next],
  a: ["accept", () => decide("accepted")],
  r: ["reject", () => decide("rejected")],
  u: ["take-back", () => decide(null)],
  Enter: ["open", openSession],
};
for (const [id, act] of Object.values(ACTIONS)) byId(id).addEventListener("click", act);
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || byId("command").open) return;
  const at = /** @type {Element} */ (event.target);
  if (at.closest("input, select, textarea")) return;
  if (event.key === "Enter" && at.closest("button, a")) return;
  ACTIONS[event.key]?.[1]();
});

// --- begin -----------------------------------------------------------------------------------

byId("title").textContent = data.title;
byId("counts").textContent = data.counts;
byId("notes").textContent = data.notes;
byId("notes").hidden = !data.notes;
showProgress();
refresh();
choose(table.rows[0] ?? null);
