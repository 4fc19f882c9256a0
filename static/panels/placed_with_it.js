// The further parts that accepting a proposal places too: named on the canvas, listed, left out one by one.

import { drawDot } from "/static/canvas/marks.js";
import { drawName } from "/static/garment/marks.js";
import { make } from "/static/page/dom.js";
import { number } from "/static/page/format.js";

/** @param {Pending["also"][number]} parts */
const nameOf = ({ view_index, component }) => `view ${view_index}, part ${component + 1}`;

/**
 * Name each part where it adds cloth: its outline is one with the proposal's.
 * @param {FlatCanvas} canvas @param {Context} context @param {Style} style @param {Pending | null} pending
 */
export function drawPlacedWithIt(canvas, context, style, pending) {
  if (!pending || !canvas.overlay.shown || canvas.isMoved) return;
  for (const part of pending.also) {
    const at = canvas.transform.toPane(...part.place_uv_m);
    drawDot(context, at, style.getPropertyValue("--accent"), 4);
    drawName(context, style, at, nameOf(part));
  }
}

/** @param {Pending} parts @param {Send} send @param {(place: UV) => void} show */
export function placedWithIt({ also, view_index }, send, show) {
  if (!also.length) return null;
  return make(
    "div#placed-with-it.placed-with-it",
    make("p.note", "Accepting also places:"),
    make("ul", ...also.map((part) => row(part, view_index, send, show))),
  );
}

/**
 * @param {Pending["also"][number]} part @param {number} view_index @param {Send} send
 * @param {(place: UV) => void} show
 */
function row(part, view_index, send, show) {
  const { component, area_cm2, place_uv_m } = part;
  const name = nameOf(part);
  const id = `${part.view_index}-${component}`;
  return make(
    "li",
    make(
      "button",
      {
        key: `show-part-${id}`,
        tip: "Its place is found like the proposal's.\nClick: show the place.",
        click: () => show(place_uv_m),
      },
      make("span", name),
      make("span", `${number(area_cm2, 0)} cm²`),
    ),
    make("button.button", {
      label: `Leave out ${name}`,
      key: `leave-out-${id}`,
      tip: "Accept the proposal without this part. It is not proposed again; Undo takes it back.",
      click: () => send({ type: "leave_out", view_index, part_view: part.view_index, component }),
      text: "Leave out",
    }),
  );
}
