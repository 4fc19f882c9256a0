// The further parts that accepting a proposal places too: named on the canvas, listed, left out one by one.

import { drawName } from "/static/garment/marks.js";
import { make } from "/static/page/dom.js";
import { number } from "/static/page/format.js";

const nameOf = ({ view_index, component }) => `view ${view_index}, part ${component + 1}`;

/** Name each part where it lies, and the proposal itself, which is one outline with them. */
export function drawPlacedWithIt(canvas, context, style, pending) {
  if (!pending?.also.length || !canvas.overlay.shown || canvas.isMoved) return;
  for (const part of pending.also) drawAt(canvas, context, style, part.place_uv_m, nameOf(part));
  drawAt(canvas, context, style, canvas.center, `view ${pending.view_index}`);
}

function drawAt(canvas, context, style, [u, v], name) {
  const { x, y } = canvas.transform.toPane(u, v);
  drawName(context, style, { x: x - 17, y }, name);
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
