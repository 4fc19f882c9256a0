// The page of a batch: what is chosen, sorted, filtered and decided; served, verdicts are kept.

import { showDetails } from "/static/batch/details.js";
import { makeHistograms } from "/static/batch/histograms.js";
import { makeTable } from "/static/batch/table.js";
import { byId } from "/static/page/dom.js";

const data = JSON.parse(byId("data").textContent);
const served = data.served && location.protocol.startsWith("http");
const rows = data.rows;

const number = (digits) => (value) => (typeof value === "number" ? value.toFixed(digits) : "");
const percent = (value) => (typeof value === "number" ? `${(100 * value).toFixed(0)} %` : "");
const FORMATS = {
  area_cm2: number(0),
  coverage_estimate: percent,
  reliable_share: percent,
  reliability: percent,
  garment_probability: percent,
  uncertainty_mm: number(1),
  floating_cm2: number(0),
  least_score: number(2),
  angles_off_deg: number(2),
  seconds: number(1),
  cpu_seconds: number(1),
  seconds_opening: number(2),
  seconds_integrating: number(2),
  seconds_garment: number(2),
  seconds_writing: number(2),
  seconds_measuring: number(2),
  peak_memory_mb: number(0),
  memory_after_mb: number(0),
};
const TITLES = {
  coverage_estimate: "coverage",
  reliable_share: "reliable",
  uncertainty_mm: "uncertainty mm",
  area_cm2: "area cm\u00b2",
  floating_cm2: "floating cm\u00b2",
  views_used: "views",
  seconds: "s",
  peak_memory_mb: "peak MB",
};
const text = (value) => (value === null || value === undefined ? "" : String(value));

const every = data.columns.map(({ name, kind, meaning }) => ({
  name,
  meaning,
  title: TITLES[name] ?? name.replaceAll("_", " "),
  number: kind === "number" || kind === "count",
  format: FORMAT_OF(name),
  show: (row) => FORMAT_OF(name)(row[name]),
}));

function FORMAT_OF(name) {
  return FORMATS[name] ?? text;
}

const named = new Map(every.map((column) => [column.name, column]));
const IN_TABLE = [
  "name",
  "outcome",
  "reliability",
  "area_cm2",
  "coverage_estimate",
  "reliable_share",
  "uncertainty_mm",
  "floating_cm2",
  "views_used",
  "garment",
  "seconds",
  "peak_memory_mb",
  "review",
];
const WIDTHS = {
  name: 180,
  outcome: 170,
  uncertainty_mm: 116,
  floating_cm2: 96,
  views_used: 60,
  seconds: 60,
  peak_memory_mb: 80,
};
const HISTOGRAMS = [
  "reliability",
  "coverage_estimate",
  "area_cm2",
  "uncertainty_mm",
  "floating_cm2",
  "seconds",
  "peak_memory_mb",
];

// --- the table -------------------------------------------------------------------------------

function picture(row) {
  if (!row.thumbnail) return document.createTextNode("");
  const image = document.createElement("img");
  image.src = row.thumbnail;
  image.alt = "";
  image.decoding = "async";
  image.width = image.height = 48;
  return image;
}

function link(row) {
  const a = document.createElement("a");
  a.href = `#${encodeURIComponent(row.name)}`;
  a.textContent = row.name;
  a.title = `Open the session of ${row.name}`;
  return a;
}

function outcome(row) {
  const span = document.createElement("span");
  span.className = row.outcome === "done" ? "done" : "bad";
  span.textContent =
    row.outcome === "done" ? (row.edited ? "done, edited" : "done") : `${row.outcome}: ${text(row.reason)}`;
  span.title = text(row.reason);
  return span;
}

function verdict(row) {
  const span = document.createElement("span");
  span.className = row.review ?? "";
  span.textContent = text(row.review);
  return span;
}

const NODES = { name: link, outcome, review: verdict };
const anyGarment = rows.some((row) => row.garment);
const shownColumns = IN_TABLE.filter((name) => name !== "garment" || anyGarment).map((name) => ({
  ...named.get(name),
  node: NODES[name],
  width: WIDTHS[name] ?? 84,
}));

let sort = { name: "reliability", descending: false };
const table = makeTable({
  scroller: byId("scroller"),
  head: byId("head"),
  body: byId("body"),
  columns: [
    { name: "picture", title: "shape", width: 64, sortable: false, node: picture, show: () => "" },
    ...shownColumns,
  ],
  onChoose(row, isOpen, event) {
    choose(row);
    if (isOpen) {
      event.preventDefault();
      openSession();
    }
  },
  onSort(name) {
    sort = { name, descending: sort.name === name ? !sort.descending : false };
    refresh();
  },
});

/** For tests and scripts that control the page. */
const state = { revision: 0, shown: 0, rows: rows.length, chosen: null };
Object.assign(window, { flatclothBatch: state });

const filters = { find: byId("find"), outcome: byId("outcome"), review: byId("review"), garment: byId("garment") };
const histograms = makeHistograms(
  byId("histograms"),
  HISTOGRAMS.map((name) => named.get(name)),
  rows,
  refresh,
);

function fill(select, values) {
  for (const [value, words] of [["", "all"], ...values]) {
    const option = document.createElement("option");
    option.value = value;
    option.textContent = words;
    select.append(option);
  }
}

const counted = (name) => {
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

function matches(row) {
  const sought = filters.find.value.trim().toLowerCase();
  if (sought && !row.sought.includes(sought)) return false;
  if (filters.outcome.value && row.outcome !== filters.outcome.value) return false;
  if (filters.garment.value && row.garment !== filters.garment.value) return false;
  const review = filters.review.value;
  return !review || (review === "none" ? !row.review : row.review === review);
}

for (const row of rows)
  row.sought = [row.name, row.source, row.reason, row.garment, row.notes].map(text).join("\n").toLowerCase();

const collator = new Intl.Collator(undefined, { numeric: true });

/** Missing values come first: a failure is least reliable. */
function compare(a, b) {
  const [x, y] = [a[sort.name] ?? null, b[sort.name] ?? null];
  let order = 0;
  if (x === null || y === null) order = Number(x !== null) - Number(y !== null);
  else order = typeof x === "number" ? x - y : collator.compare(x, y);
  return (sort.descending ? -order : order) || a.place - b.place;
}

function refresh() {
  const matching = rows.filter(matches);
  const shown = matching.filter((row) => histograms.keeps(row)).sort(compare);
  table.show(shown, sort);
  histograms.draw((except) => matching.filter((row) => histograms.keeps(row, except)));
  byId("shown").textContent = `${shown.length} of ${rows.length} shown`;
  state.shown = shown.length;
  state.revision += 1;
}

// --- review ----------------------------------------------------------------------------------

function choose(row, how) {
  table.choose(row, how);
  showDetails(byId("details"), row, every);
  state.chosen = row?.name ?? null;
}

function told() {
  const decided = rows.filter((row) => row.review).length;
  const all = rows.filter((row) => row.review || row.outcome === "done").length;
  const count = (name) => rows.filter((row) => row.review === name).length;
  byId("progress").textContent =
    `${decided} of ${all} reviewed: ${count("accepted")} accepted, ${count("rejected")} rejected.` +
    (served ? "" : " In a file, verdicts are not kept.");
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

async function decide(review) {
  const row = table.chosen;
  if (!row) return;
  if (!served) {
    showCommand(row);
    return;
  }
  const answer = await fetch("verdict", {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify({ name: row.name, verdict: review }),
  });
  if (!answer.ok) {
    byId("progress").textContent = await answer.text();
    return;
  }
  row.review = review;
  told();
  refresh();
  if (review) next();
  else choose(row);
}

async function openSession() {
  const row = table.chosen;
  if (!row) return;
  if (!served) {
    showCommand(row);
    return;
  }
  const tab = window.open("", "_blank");
  byId("progress").textContent = `Opening ${row.name} \u2026`;
  const answer = await fetch("open", {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify({ name: row.name }),
  });
  if (answer.ok) {
    const { url } = await answer.json();
    (tab ?? window).location.href = url;
    told();
  } else {
    tab?.close();
    byId("progress").textContent = await answer.text();
  }
}

function showCommand(row) {
  byId("command-text").textContent = row.command;
  byId("serve-text").textContent = data.serve;
  byId("command").showModal();
}

byId("copy").addEventListener("click", () => navigator.clipboard?.writeText(byId("command-text").textContent));

function clearFilters() {
  for (const filter of Object.values(filters)) filter.value = "";
  histograms.clear();
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
  /** @type {any} */
  const at = event.target;
  if (at.closest("input, select, textarea")) return;
  if (event.key === "Enter" && at.closest("button, a")) return;
  ACTIONS[event.key]?.[1]();
});

// --- begin -----------------------------------------------------------------------------------

byId("title").textContent = data.title;
byId("counts").textContent = data.counts;
byId("notes").textContent = data.notes;
byId("notes").hidden = !data.notes;
told();
refresh();
choose(table.rows[0] ?? null);
