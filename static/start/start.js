// The start screen: examples, the last sessions, folders below the root, a camera. What is chosen opens for all tabs.

import { byId, make } from "/static/page/dom.js";
import { count } from "/static/page/format.js";
import { applyTheme } from "/static/page/theme.js";
import { answerDrops } from "/static/start/drop.js";

const WORDS = { recording: "recording", session: "session", file: "file", folder: "folder ›" };
const SLOW_MS = 6000;

async function ask(address, options) {
  const answer = await fetch(address, options).catch(() => null);
  if (!answer) return { error: "There is no connection to flatcloth; start it again." };
  const told = await answer.json().catch(() => null);
  return told ?? { error: `The program answered ${answer.status}.` };
}

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
  const told = await ask("/start/open", { method: "POST", body, headers: { "Content-Type": "application/json" } });
  clearTimeout(slow);
  show("opening", "");
  main.removeAttribute("aria-busy");
  if (!told.error) return location.assign("/");
  show("trouble", told.error);
  if (kind === "camera") showCamera(true);
}

function show(id, text) {
  byId(id).hidden = !text;
  byId(id).textContent = text;
}

function card(kind, name, title, ...lines) {
  return make(
    "button",
    { type: "button", class: "card", data: { kind, name }, on: { click: () => open(kind, name, title) } },
    make("img", {
      src: `/start/picture/${kind}/${encodeURIComponent(name)}`,
      alt: "",
      width: 72,
      height: 92,
      loading: "lazy",
      on: { error: (event) => (event.target.style.visibility = "hidden") },
    }),
    make("strong", {}, title),
    ...lines.map((line) => make("span", {}, line)),
  );
}

/** What an example is, as its name says: the garment, where it is held, the camera. */
function aboutExample(name) {
  const [garment, held, camera] = name.split("-");
  return `${garment}, held at the ${held}${camera === "clean" ? ", without noise" : ", with a camera's noise"}`;
}

const dated = (text) => new Date(text).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });

function showPlaces({ examples, sessions, root, current }) {
  const back = byId("back");
  back.hidden = current === null;
  back.textContent = `Back to ${current}`;
  byId("examples").replaceChildren(...examples.map(({ name }) => card("example", name, name, aboutExample(name))));
  byId("recent").replaceChildren(
    ...(sessions.length
      ? sessions.map((s) =>
          card("session", s.name, s.recording, `${count(s.views, "view")} · method ${s.method}`, dated(s.used)),
        )
      : [make("p", { class: "soft" }, "None yet. Each recording that is opened has a session, and is kept here.")]),
  );
  if (root === null) {
    byId("folder").replaceChildren(
      make(
        "p",
        { class: "soft" },
        "To open your own recordings here, start the program with their folder: ",
        make("code", {}, "flatcloth view --root DIR"),
      ),
    );
  } else showFolder("", root);
}

async function showFolder(path, root) {
  const told = await ask(`/start/folder.json?path=${encodeURIComponent(path)}`);
  if (told.error) return show("trouble", told.error);
  show("trouble", "");
  const here = told.path;
  const inside = (name) => (here ? `${here}/${name}` : name);
  const input = make("input", {
    type: "text",
    value: here,
    "aria-label": `Path below ${root}`,
    placeholder: "path of a recording or a session",
    spellcheck: "false",
    autocomplete: "off",
  });
  const form = make(
    "form",
    {
      class: "path",
      on: {
        submit: (event) => {
          event.preventDefault();
          open("folder", input.value, input.value || root);
        },
      },
    },
    make("span", { class: "soft" }, `${root} /`),
    input,
    make("button", { class: "button" }, "Open"),
    here
      ? make(
          "button",
          {
            type: "button",
            class: "button",
            on: { click: () => showFolder(here.split("/").slice(0, -1).join("/"), root) },
          },
          "Up",
        )
      : null,
  );
  const entries = told.entries.map(({ name, kind }) =>
    make(
      "li",
      {},
      make(
        "button",
        {
          type: "button",
          class: `entry${kind === "folder" ? "" : " openable"}`,
          on: {
            click: () => (kind === "folder" ? showFolder(inside(name), root) : open("folder", inside(name), name)),
          },
        },
        make("b", {}, name),
        make("span", {}, WORDS[kind]),
      ),
    ),
  );
  byId("folder").replaceChildren(
    form,
    entries.length
      ? make("ul", { class: "entries" }, ...entries)
      : make("p", { class: "soft" }, "There is nothing to open in this folder."),
  );
}

function showCamera(failed) {
  byId("camera").replaceChildren(
    ...(failed
      ? [
          make("p", {}, "No camera is ready. What to do:"),
          make(
            "ol",
            { class: "steps" },
            make("li", {}, "Plug a RealSense D400 camera into a USB 3 port (blue), with the cable it came with."),
            make("li", {}, "Close other programs that use it, such as the RealSense Viewer."),
            make(
              "li",
              {},
              "On Linux, let your account use it: install librealsense's udev rules, then plug it in again.",
            ),
          ),
        ]
      : [
          make(
            "p",
            { class: "soft" },
            "Capture a new recording: the page shows the camera, asks for each rotation, and keeps sharp, still views.",
          ),
        ]),
    make(
      "button",
      { type: "button", class: "button", id: "open-camera", on: { click: () => open("camera", "", "the camera") } },
      failed ? "Try again" : "Show the camera",
    ),
  );
}

applyTheme();
answerDrops();
showCamera(false);
const places = await ask("/start/places.json");
if (places.error) show("trouble", places.error);
else showPlaces(places);
Object.assign(window, { started: true });
