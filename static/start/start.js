// The start screen: examples, the last sessions, folders below the root, a camera. What is chosen opens for all tabs.

import { ask } from "/static/page/connection.js";
import { byId, make } from "/static/page/dom.js";
import { count } from "/static/page/format.js";
import { applyTheme } from "/static/page/theme.js";
import { answerDrops } from "/static/start/drop.js";

/** @type {Record<string, string>} */
const WORDS = { recording: "recording", session: "session", file: "file", folder: "folder ›" };
/**
 * @typedef {object} Places what can be opened
 * @property {{ name: string }[]} examples
 * @property {{ name: string; recording: string; views: number; method: string; used: string }[]} sessions
 * @property {string | null} root
 * @property {string | null} current
 */

const SLOW_MS = 6000;

/** What the program answers; `error` if it cannot. @returns {Promise<any>} */
async function request(/** @type {string} */ address, /** @type {RequestInit} */ options = {}) {
  const answer = await ask(address, options);
  if (!answer) return { error: "There is no connection to flatcloth; start it again." };
  const told = await answer.json().catch(/** @returns {null} */ () => null);
  return told ?? { error: `The program answered ${answer.status}.` };
}

/** @param {string} kind @param {string} name @param {string} title */
async function open(kind, name, title) {
  const main = document.querySelector("main");
  if (main.getAttribute("aria-busy") === "true") return;
  main.setAttribute("aria-busy", "true");
  show("trouble", "");
  show("opening", `Opening ${title} …`);
  const slow = setTimeout(
    () =>
      show(
        "opening",
        `Opening ${title} … The first start after an installation takes longer, because code is compiled.`,
      ),
    SLOW_MS,
  );
  const body = JSON.stringify({ kind, name });
  const told = await request("/start/open", {
    method: "POST",
    body,
    headers: { "Content-Type": "application/json" },
  });
  clearTimeout(slow);
  show("opening", "");
  main.removeAttribute("aria-busy");
  if (!told.error) return location.assign("/");
  show("trouble", told.error);
  if (kind === "camera") showCamera(true);
}

function show(/** @type {string} */ id, /** @type {string} */ text) {
  byId(id).hidden = !text;
  byId(id).textContent = text;
}

/** @param {string} kind @param {string} name @param {string} title @param {...string} lines */
function card(kind, name, title, ...lines) {
  return make(
    "button.card",
    { data: { kind, name }, click: () => open(kind, name, title) },
    make("img", {
      src: `/start/picture/${kind}/${encodeURIComponent(name)}`,
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
  return `${garment}, held at the ${held}${camera === "clean" ? ", without noise" : ", with a camera's noise"}`;
}

/** @param {string} text */
const dated = (text) => new Date(text).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });

function showPlaces(/** @type {Places} */ { examples, sessions, root, current }) {
  const back = byId("back");
  back.hidden = current === null;
  back.textContent = `Back to ${current}`;
  byId("examples").replaceChildren(...examples.map(({ name }) => card("example", name, name, aboutExample(name))));
  byId("recent").replaceChildren(
    ...(sessions.length
      ? sessions.map((s) =>
          card("session", s.name, s.recording, `${count(s.views, "view")} · method ${s.method}`, dated(s.used)),
        )
      : [make("p.soft", "None yet. Each recording that is opened has a session, and is kept here.")]),
  );
  if (root === null) {
    byId("folder").replaceChildren(
      make(
        "p.soft",
        "To open your own recordings here, start the program with their folder: ",
        make("code", "flatcloth view --root DIR"),
      ),
    );
  } else showFolder("", root);
}

async function showFolder(/** @type {string} */ path, /** @type {string} */ root) {
  const told = await request(`/start/folder.json?path=${encodeURIComponent(path)}`);
  if (told.error) return show("trouble", told.error);
  show("trouble", "");
  const here = told.path;
  const inside = (/** @type {string} */ name) => (here ? `${here}/${name}` : name);
  const input = make("input", {
    type: "text",
    value: here,
    label: `Path below ${root}`,
    placeholder: "path of a recording or a session",
    spellcheck: "false",
    autocomplete: "off",
  });
  const form = make(
    "form.path",
    {
      submit: (event) => {
        event.preventDefault();
        open("folder", input.value, input.value || root);
      },
    },
    make("span.soft", `${root} /`),
    input,
    make("button.button", { type: "submit" }, "Open"),
    here && make("button.button", { click: () => showFolder(here.split("/").slice(0, -1).join("/"), root) }, "Up"),
  );
  const entries = told.entries.map((/** @type {{ name: string; kind: string }} */ { name, kind }) =>
    make(
      "li",
      make(
        "button",
        {
          class: `entry${kind === "folder" ? "" : " openable"}`,
          click: () => (kind === "folder" ? showFolder(inside(name), root) : open("folder", inside(name), name)),
        },
        make("b", name),
        make("span", WORDS[kind]),
      ),
    ),
  );
  byId("folder").replaceChildren(
    form,
    entries.length ? make("ul.entries", ...entries) : make("p.soft", "There is nothing to open in this folder."),
  );
}

function showCamera(/** @type {boolean} */ failed) {
  byId("camera").replaceChildren(
    ...(failed
      ? [
          make("p", "No camera is ready. What to do:"),
          make(
            "ol.steps",
            make("li", "Plug a RealSense D400 camera into a USB 3 port (blue), with the cable it came with."),
            make("li", "Close other programs that use it, such as the RealSense Viewer."),
            make(
              "li",
              "On Linux, let your account use it: install librealsense's udev rules, then plug it in again.",
            ),
          ),
        ]
      : [
          make(
            "p.soft",
            "Capture a new recording: the page shows the camera, asks for each rotation, and keeps sharp, still views.",
          ),
        ]),
    make(
      "button#open-camera.button",
      { click: () => open("camera", "", "the camera") },
      failed ? "Try again" : "Show the camera",
    ),
  );
}

applyTheme();
answerDrops();
showCamera(false);
const places = await request("/start/places.json");
if (places.error) show("trouble", places.error);
else showPlaces(places);
Object.assign(window, { started: true });
