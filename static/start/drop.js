// A file that is dropped on the page is not sent anywhere: a notice says how to import it.

import { make } from "../page/dom.js";

/** @type {Record<string, string>} */
const KNOWN = { bag: "a camera's or ROS recording", db3: "a camera's or ROS 2 recording", mcap: "a ROS 2 recording" };

export function answerDrops() {
  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    const name = event.dataTransfer?.files[0]?.name;
    if (name) tell(name);
  });
}

function tell(/** @type {string} */ name) {
  const kind = KNOWN[name.split(".").at(-1)?.toLowerCase() ?? ""];
  const out = name.replace(/\.[^.]*$/, "").replace(/[^\w.-]+/g, "-") || "recording";
  const quoted = /^[\w./-]+$/.test(name) ? name : `'${name.replaceAll("'", "'\\''")}'`;
  const parts = kind
    ? [
        make("p", `This is ${kind}. It is large, so the page does not take it; import it where it lies:`),
        make("code", `flatcloth import ${quoted} --out ${out} --step 10`),
        make(
          "p",
          "--step is the rotation from stop to stop in degrees; --turning-speed is for an item that turns evenly.",
        ),
        make("code", `flatcloth view ${out}`),
      ]
    : [make("p", "Open the folder of a recording or a session on the start screen (Shift+H).")];
  const title = kind ? `Import ${name}` : `${name} cannot be dropped here`;
  const close = make("button.button", { type: "submit", autofocus: true }, "Close");
  const dialog = make(
    "dialog.sheet.drop",
    { label: title, close: (event) => event.target.remove() },
    make("h2", title),
    ...parts,
    make("form", { method: "dialog" }, close),
  );
  document.body.append(dialog);
  dialog.showModal();
}
