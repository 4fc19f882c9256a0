// The page of a batch: what is chosen, sorted, filtered and decided; served, verdicts are kept.

import { post } from "../page/connection.js";
import { byId, isPlain, make, optionsOf, setText, targetOf, within } from "../page/dom.js";

/**
 * @type {{
 *   served: boolean; serve: string; rows: Row[]; title: string; counts: string; notes: string;
 *   columns: { name: string; kind: string; meaning: string }[]
 * }}
 */
const data = JSON.parse(byId("data").textContent ?? "");
const served = data.served && location.protocol.startsWith("http");
const { rows } = data;
const anyGarment = rows.some((row) => row.garment);
const NO_CONNECTION = "There is no connection to flatcloth.";
const collator = new Intl.Collator(undefined, { numeric: true });

// --- the table: its rows are made once, and shown in any order; its widths are fixed, so nothing moves ---------

const text = (/** @type {Cell} */ value) => (value === null || value === undefined ? "" : String(value));
const number = (/** @type {number} */ digits) => (/** @type {Cell} */ value) =>
  typeof value === "number" ? value.toFixed(digits) : "";
const percent = (/** @type {Cell} */ value) => (typeof value === "number" ? `${(100 * value).toFixed(0)} %` : "");

const link = (/** @type {Row} */ { name }) =>
  make("a", { href: `#${encodeURIComponent(name)}`, title: `Open the session of ${name}` }, name);

function outcome(/** @type {Row} */ row) {
  const done = row.edited ? "done, edited" : "done";
  const good = row.outcome === "done";
  const words = good ? done : `${row.outcome}: ${text(row.reason)}`;
  return make("span", { class: good ? "done" : "bad", title: text(row.reason) }, words);
}

const verdict = (/** @type {Row} */ row) => make("span", { class: row.review }, text(row.review));

const picture = (/** @type {Row} */ { thumbnail: src }) =>
  src && make("img", { src, alt: "", decoding: "async", loading: "lazy", width: 48, height: 48 });

/**
 * How columns look that are not plain text, or have a width (px) in the table: those are its columns, in their order.
 *
 * @type {Record<string, { title?: string; format?: (value: Cell) => string; width?: number; node?: (row: Row) => Child }>}
 */
const LOOKS = {
  thumbnail: { title: "shape", width: 64, node: picture },
  name: { width: 180, node: link },
  outcome: { width: 170, node: outcome },
  reliability: { format: percent, width: 84 },
  area_cm2: { title: "area cm\u00b2", format: number(0), width: 84 },
  coverage_estimate: { title: "coverage", format: percent, width: 84 },
  reliable_share: { title: "reliable", format: percent, width: 84 },
  uncertainty_mm: { title: "uncertainty mm", format: number(1), width: 116 },
  floating_cm2: { title: "floating cm\u00b2", format: number(0), width: 96 },
  views_used: { title: "views", width: 60 },
  ...(anyGarment ? { garment: { width: 84 } } : {}),
  seconds: { title: "s", format: number(1), width: 60 },
  peak_memory_mb: { title: "peak MB", format: number(0), width: 80 },
  review: { width: 84, node: verdict },
  garment_probability: { format: percent },
  cpu_seconds: { format: number(1) },
  memory_after_mb: { format: number(0) },
};

/** A column of the results, or the pictures. */
function columnOf(/** @type {string} */ name) {
  const { kind = "", meaning = "" } = data.columns.find((column) => column.name === name) ?? {};
  const { title = name.replaceAll("_", " "), format = kind === "number" ? number(2) : text } = LOOKS[name] ?? {};
  const style = ["number", "count"].includes(kind) ? "number" : null;
  return { ...LOOKS[name], name, title, meaning, style, show: (/** @type {Row} */ row) => format(row[name]) };
}

/** @typedef {ReturnType<typeof columnOf>} Column */
const table = Object.keys(LOOKS)
  .filter((name) => LOOKS[name].width)
  .map(columnOf);
const titles = table.map(titleOf);
byId("head").append(...titles);
const elements = /** @type {Map<Row, HTMLElement>} */ (new Map());
let shown = /** @type {Row[]} */ ([]);
let chosen = /** @type {Row | null} */ (null);
let sort = { name: "reliability", descending: false };

function titleOf(/** @type {Column} */ { name, title, meaning, style, width }) {
  const isSorted = name !== "thumbnail";
  const click = () => {
    sort = { name, descending: sort.name === name ? !sort.descending : false };
    refresh();
  };
  const about = { scope: "col", class: style, style: { width: `${width}px`, padding: isSorted ? "" : "7px 8px" } };
  return make("th", about, isSorted ? make("button", { title: meaning || title, click }, title) : title);
}

function elementOf(/** @type {Row} */ row) {
  const known = elements.get(row);
  if (known) return known;
  const click = (/** @type {Event} */ event) => {
    choose(row);
    if (!targetOf(event).closest("a")) return;
    event.preventDefault();
    openSession();
  };
  const cells = table.map(({ node, style, show }) =>
    make("td", { class: style, title: node ? null : show(row) }, node ? node(row) : show(row)),
  );
  const made = make("tr.row", { click, "aria-selected": String(row === chosen) }, ...cells);
  elements.set(row, made);
  return made;
}

/** @type {Record<string, number>} */
const STEPS = { ArrowDown: 1, ArrowUp: -1, PageDown: 10, PageUp: -10, Home: -Infinity, End: Infinity };
byId("scroller").addEventListener("keydown", (event) => {
  const step = STEPS[event.key];
  if (step === undefined || !isPlain(event) || !shown.length) return;
  event.preventDefault();
  const at = chosen ? shown.indexOf(chosen) : -1;
  choose(shown[at < 0 ? 0 : within(at + step, 0, shown.length - 1)]);
});

// --- what is shown ---------------------------------------------------------------------------

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

/** Missing values come first: a failure is least reliable. */
function compare(/** @type {Row} */ a, /** @type {Row} */ b) {
  const [x, y] = [a[sort.name] ?? null, b[sort.name] ?? null];
  let order = 0;
  if (x === null || y === null) order = Number(x !== null) - Number(y !== null);
  else order = typeof x === "number" ? x - Number(y) : collator.compare(String(x), String(y));
  return (sort.descending ? -order : order) || a.place - b.place;
}

function refresh() {
  shown = rows.filter(matches).sort(compare);
  table.forEach(({ name }, n) => {
    if (sort.name === name) titles[n].setAttribute("aria-sort", sort.descending ? "descending" : "ascending");
    else titles[n].removeAttribute("aria-sort");
  });
  byId("body").replaceChildren(...shown.map(elementOf));
  byId("shown").textContent = `${shown.length} of ${rows.length} shown`;
  state.shown = shown.length;
  state.revision += 1;
}

/** Choose a row, and bring it into sight; or none. */
function choose(/** @type {Row | null} */ row) {
  if (chosen) elementOf(chosen).setAttribute("aria-selected", "false");
  chosen = row;
  state.chosen = row?.name ?? null;
  if (!row) return byId("details").replaceChildren("Choose a result.");
  elementOf(row).setAttribute("aria-selected", "true");
  elementOf(row).scrollIntoView({ block: "nearest" });
  /** @type {Record<string, string | null>} */
  const classes = { outcome: row.outcome === "done" ? "done" : "bad", review: row.review };
  const list = data.columns.flatMap(({ name, meaning }) => {
    const { title, show } = columnOf(name);
    const value = name === "name" ? "" : show(row);
    return value ? [make("dt", { title: meaning ?? "" }, title), make("dd", { class: classes[name] }, value)] : [];
  });
  const large = row.thumbnail && make("img", { src: row.thumbnail, alt: `The flattened shape of ${row.name}` });
  byId("details").replaceChildren(make("h2", row.name), large || "", make("dl", list));
}

// --- review ----------------------------------------------------------------------------------

const say = (/** @type {string} */ words) => setText(byId("progress"), words);

function showProgress() {
  const count = (/** @type {string} */ name) => rows.filter((row) => row.review === name).length;
  const decided = rows.filter((row) => row.review).length;
  const all = rows.filter((row) => row.review || row.outcome === "done").length;
  const kept = served ? "" : " In a file, verdicts are not kept.";
  say(`${decided} of ${all} reviewed: ${count("accepted")} accepted, ${count("rejected")} rejected.${kept}`);
}

/** The next finished result without a verdict, least reliable first, in any order of the table. */
function next() {
  const open = rows.filter((row) => !row.review && row.outcome === "done").sort((a, b) => a.place - b.place);
  const at = chosen && !chosen.review ? chosen.place : -1;
  const row = open.find((one) => one.place > at) ?? open[0];
  if (!row) return;
  if (!shown.includes(row)) clearFilters();
  choose(row);
}

async function decide(/** @type {string | null} */ review) {
  const row = chosen;
  if (!row) return;
  if (!served) return showCommand(row);
  const answer = await post("verdict", { name: row.name, verdict: review });
  if (!answer?.ok) return say((await answer?.text()) ?? NO_CONNECTION);
  row.review = review;
  elements.delete(row); // it says something else now
  showProgress();
  refresh();
  if (review) next();
  else choose(row);
}

async function openSession() {
  const row = chosen;
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
choose(shown[0] ?? null);
