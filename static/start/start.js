// The start screen: examples, the last sessions, folders below the root, a camera. What is chosen opens for all tabs.

import { ask, post } from "../page/connection.js";
import { byId, find, make, rebuild, showWords } from "../page/dom.js";
import { cm2, count, number } from "../page/format.js";
import { applyTheme } from "../page/theme.js";

/** @type {Record<string, string>} */
const WORDS = { recording: "recording", session: "session", file: "file", folder: "folder ›" };
/**
 * @typedef {object} Summary how far a session is
 * @property {number} views
 * @property {number} area_cm2
 * @property {number} floating_cm2
 * @property {string} garment
 * @property {boolean} ended
 *
 * @typedef {object} Entry of a folder; a folder in it has neither date nor summary
 * @property {string} name
 * @property {string} kind
 * @property {string} [used]
 * @property {Summary | null} [summary]
 *
 * @typedef {object} Places what can be opened
 * @property {{ name: string }[]} examples
 * @property {{ name: string; recording: string; views: number; used: string; summary: Summary | null }[]} sessions
 * @property {string} cell why the robot cell cannot be opened; empty if it can
 * @property {string | null} root
 * @property {string | null} current
 */

const SLOW_MS = 6000;
const AGAIN_MS = 1000;
const NO_CONNECTION = "There is no connection to flatcloth. Start it again: this page goes on by itself.";

/** Once the program answers again, the page is loaded anew: it may be another program, with other places. */
async function comeBack() {
  if ((await ask("start/places.json"))?.ok) location.reload();
  else setTimeout(comeBack, AGAIN_MS);
}

/**
 * What the program answers; `error` if it cannot.
 *
 * @template T
 * @param {Promise<Response | null>} asked
 * @returns {Promise<T & { error?: string }>}
 */
async function answerTo(asked) {
  const answer = await asked;
  if (!answer) {
    setTimeout(comeBack, AGAIN_MS);
    return /** @type {never} */ ({ error: NO_CONNECTION });
  }
  return answer.json().catch(() => ({ error: `The program answered ${answer.status}.` }));
}

/** @param {string} kind @param {string} name @param {string} title */
async function open(kind, name, title) {
  const main = find("main");
  if (main.getAttribute("aria-busy") === "true") return;
  main.setAttribute("aria-busy", "true");
  show("trouble", "");
  show("opening", `Opening ${title} …`);
  const longer = "The first start after an installation takes longer, because code is compiled.";
  const slow = setTimeout(() => show("opening", `Opening ${title} … ${longer}`), SLOW_MS);
  const opened = await answerTo(post("start/open", { kind, name }));
  clearTimeout(slow);
  show("opening", "");
  main.removeAttribute("aria-busy");
  if (!opened.error) return location.assign("./");
  show("trouble", opened.error);
  if (kind !== "camera") return;
  byId("camera-about").hidden = true;
  byId("camera-help").hidden = false;
  byId("open-camera").textContent = "Try again";
}

const show = (/** @type {string} */ id, /** @type {string} */ text) => showWords(byId(id), text);

/** @param {string} kind @param {string} name @param {string} title @param {...string} lines */
function card(kind, name, title, ...lines) {
  return make(
    "button.card",
    { data: { kind, name }, click: () => open(kind, name, title) },
    make("img", {
      src: `start/picture/${kind}/${name.split("/").map(encodeURIComponent).join("/")}`,
      alt: "",
      width: 72,
      height: 92,
      loading: "lazy",
      error: (event) => (event.target.style.visibility = "hidden"),
    }),
    make("strong", title),
    ...lines.map((line) => make("span", line)),
  );
}

/** What an example is, as its name says: the garment, where it is held, the camera. */
function aboutExample(/** @type {string} */ name) {
  const [garment, held, camera] = name.split("-");
  const noise = camera === "clean" ? "without noise" : "with a camera's noise";
  return camera ? `${garment}, held at the ${held}, ${noise}` : `${garment} with a printed test pattern`;
}

/** How far a session is: garment, area, views. @param {Summary | null} summary @param {number | null} of views */
function aboutSession(summary, of = null) {
  if (!summary) return of === null ? ["session"] : [count(of, "view")];
  const { garment, area_cm2, floating_cm2, views, ended } = summary;
  const floats = floating_cm2 >= 1 ? `, ${number(floating_cm2, 0)} float` : "";
  return [
    `${garment && `${garment.replaceAll("_", " ")} · `}${cm2(area_cm2)}${floats}`,
    `${of === null ? count(views, "view") : `${views} of ${count(of, "view")}`} · ${ended ? "ended" : "not ended"}`,
  ];
}

/** @param {string} text */
const dated = (text) => new Date(text).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });

function showPlaces(/** @type {Places} */ { examples, sessions, cell, root, current }) {
  show("back", current === null ? "" : `Back to ${current}`);
  byId("examples").replaceChildren(...examples.map(({ name }) => card("example", name, name, aboutExample(name))));
  byId("open-cell").disabled = cell !== "";
  show("no-cell", cell);
  byId("recent").replaceChildren(
    ...(sessions.length
      ? sessions.map((s) => card("session", s.name, s.recording, ...aboutSession(s.summary, s.views), dated(s.used)))
      : [make("p.soft", "None yet. Each recording that is opened has a session, and is kept here.")]),
  );
  if (root === null) return;
  byId("path-root").textContent = `${root} /`;
  byId("path-box").setAttribute("aria-label", `Path below ${root}`);
  byId("path").onsubmit = (event) => {
    event.preventDefault();
    open("folder", byId("path-box").value, byId("path-box").value || root);
  };
  byId("path").hidden = false;
  showFolder("");
}

async function showFolder(/** @type {string} */ path) {
  /** @type {{ path: string; entries: Entry[]; error?: string }} */
  const folder = await answerTo(ask(`start/folder.json?path=${encodeURIComponent(path)}`));
  if (folder.error) return show("trouble", folder.error);
  show("trouble", "");
  const here = folder.path;
  const inside = (/** @type {string} */ name) => (here ? `${here}/${name}` : name);
  byId("path-box").value = here;
  byId("path-up").hidden = !here;
  byId("path-up").onclick = () => showFolder(here.split("/").slice(0, -1).join("/"));
  const folders = folder.entries.filter(({ kind }) => kind === "folder");
  const openable = folder.entries.filter(({ kind }) => kind !== "folder");
  const entries = folders.map(({ name, kind }) =>
    make(
      "li",
      make("button.entry", { click: () => showFolder(inside(name)) }, make("b", name), make("span", WORDS[kind])),
    ),
  );
  const cards = openable.map(({ name, kind, used, summary }) => {
    const about = kind === "session" ? aboutSession(summary ?? null) : [WORDS[kind]];
    return card("folder", inside(name), name, ...about, ...(used ? [dated(used)] : []));
  });
  rebuild(byId("folder"), [folder], () => [
    entries.length > 0 && make("ul.entries", ...entries),
    cards.length > 0 && make("div.cards", ...cards),
    !folder.entries.length && make("p.soft", "There is nothing to open in this folder."),
  ]);
}

byId("unloaded").remove();
byId("open-cell").addEventListener("click", () => open("cell", "", "the simulated robot cell"));
byId("open-camera").addEventListener("click", () => open("camera", "", "the camera"));
applyTheme();
/** @type {Places & { error?: string }} */
const places = await answerTo(ask("start/places.json"));
if (places.error) show("trouble", places.error);
else showPlaces(places);
Object.assign(window, { started: true });
