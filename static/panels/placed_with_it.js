// The further parts that accepting a proposal places too: named on the canvas, listed, left out one by one.

import { drawDot } from "/static/canvas/marks.js";
import { drawName } from "/static/garment/marks.js";
import { make } from "/static/page/dom.js";
import { number } from "/static/page/format.js";

const nameOf = ({ view_index, component }) => `view ${view_index}, part ${component + 1}`;

/** Name each part where it adds cloth: its outline is one with the proposal's. */
export function drawPlacedWithIt(canvas, context, style, pending) {
  if (!pending || !canvas.overlay.shown || canvas.isMoved) return;
  for (const part of pending.also) {
    const at = canvas.transform.toPane(...part.place_uv_m);
    drawDot(context, at, style.getPropertyValue("--accent"), 4);
    drawName(context, style, at, nameOf(part));
  }
}

export function placedWithIt({ also, view_index }, send, show) {
  if (!also.length) return null;
  return make(
    "div",
    { class: "placed-with-it", id: "placed-with-it" },
    make("p", { class: "note" }, "Accepting also places:"),
    make("ul", {}, ...also.map((part) => row(part, view_index, send, show))),
  );
}

function row(part, view_index, send, show) {
  const { component, area_cm2, place_uv_m } = part;
  const name = nameOf(part);
  const id = `${part.view_index}-${component}`;
  return make(
    "li",
    {},
    make(
      "button",
      {
        type: "button",
        data: { id: `show-part-${id}`, tip: "Its place is found like the proposal's.\nClick: show the place." },
        on: { click: () => show(place_uv_m) },
      },
      make("span", {}, name),
      make("span", {}, `${number(area_cm2, 0)} cm²`),
    ),
    make(
      "button",
      {
        type: "button",
        class: "button",
        "aria-label": `Leave out ${name}`,
        data: {
          id: `leave-out-${id}`,
          tip: "Accept the proposal without this part. It is not proposed again; Undo takes it back.",
        },
        on: { click: () => send({ type: "leave_out", view_index, part_view: part.view_index, component }) },
      },
      "Leave out",
    ),
  );
}
