// Beside the pictures of the exported page: the current pick, all picks, the decisions, the values under the pointer.

import { byId, make, rebuild, setText, valueRow } from "/static/page/dom.js";
import { degrees, number, vector } from "/static/page/format.js";

/** @type {Record<string, string>} */
const AXIS_FROM = { outline: "along the outline", hand: "by hand", level: "level" };

export function showPick(/** @type {OfflinePage} */ page) {
  const pick = page.current;
  rebuild(byId("pick"), [pick, pick !== null && pick.uv_m !== null && page.isShown(pick)], () => {
    if (!pick)
      return [
        make("h2", {}, "Grasp point"),
        make("p", { class: "nothing" }, "Click the cloth, flat or in 3D, or choose a pick."),
      ];
    const { grip } = pick;
    return [
      make("div", { class: "heading" }, make("h2", {}, pick.name), page.button("copy")),
      make(
        "dl",
        { class: "values" },
        ...valueRow(
          "held",
          `${vector(pick.position_held_m, 1, 1000)} mm`,
          "Position x y z in the held frame: the camera frame of view 0, the item turned back",
        ),
        ...valueRow("normal", vector(pick.normal_held, 3), "Outward normal in the held frame"),
        ...(pick.z_angle_deg === null
          ? []
          : valueRow("Z-angle", degrees(pick.z_angle_deg), "Z-angle at which the pixel was seen")),
        ...valueRow(
          "source",
          `view ${pick.view_index} @ ${pick.source_rc.map((x) => number(x)).join(", ")}`,
          "View and image pixel (row, column) it was measured in",
        ),
        ...(pick.rc ? valueRow("pixel", pick.rc.join(", "), "Row, column of the flattened view") : []),
        ...(grip
          ? [
              ...valueRow(
                "approach",
                vector(grip.approach_held, 3),
                "Direction in which the gripper comes, held frame",
              ),
              ...valueRow(
                "axis",
                vector(grip.axis_held, 3),
                `In-plane axis of the gripper, held frame; ${AXIS_FROM[grip.axis_from]}`,
              ),
              ...valueRow("opening", `${number(1000 * grip.opening_m, 0)} mm`, "Distance of the fingers"),
              ...valueRow(
                "known to",
                grip.position_std_m === null
                  ? "–"
                  : (grip.position_std_m < 1e-4 ? "< 0.1" : number(1000 * grip.position_std_m)) +
                      ` mm  ${degrees(grip.normal_std_deg, 0)}`,
                "One standard deviation of position and approach",
              ),
            ]
          : []),
      ),
      pick.uv_m && !page.isShown(pick) ? make("p", { class: "note" }, "Not part of the shape at page step.") : null,
      pick.uv_m ? null : make("p", { class: "note" }, "Its view is not part of the shape."),
    ].filter(Boolean);
  });
}

export function showPicks(/** @type {OfflinePage} */ page) {
  const { picks } = page.history;
  rebuild(byId("picks"), [page.step, page.current?.id ?? null], () => [
    make("h2", {}, `Picks (${picks.length})`),
    picks.length
      ? make(
          "ol",
          { class: "picks" },
          ...picks.map((p) =>
            make(
              "li",
              { class: p.id === page.current?.id ? "current" : "" },
              make("i", { class: `dot${page.isShown(p) ? "" : " gone"}`, "aria-hidden": "true" }),
              make(
                "button",
                {
                  type: "button",
                  class: "name",
                  "aria-pressed": String(p.id === page.current?.id),
                  "aria-label": `Show ${p.name}`,
                  data: { id: `pick-${p.id}`, tip: "Show on both sides" },
                  on: { click: () => page.setCurrent(p) },
                },
                p.name,
              ),
            ),
          ),
        )
      : make("p", { class: "nothing" }, "None were kept in page session."),
  ]);
}

export function showDecisions(/** @type {OfflinePage} */ page) {
  /** @type {Record<string, string>} */
  const signs = { accepted: "✓", rejected: "✕", skipped: "»" };
  rebuild(byId("decisions"), page.step, () => [
    make("h2", {}, `Decisions (${page.history.decisions.length})`),
    make(
      "ol",
      { class: "verdicts" },
      ...page.history.decisions.map((d) =>
        make(
          "li",
          { class: `${d.verdict}${d.stands ? "" : " gone"}${d.step === page.step ? " now" : ""}` },
          make("i", { "aria-hidden": "true" }, signs[d.verdict]),
          make("span", {}, `View ${d.view_index} (${number(d.angle_deg, 0)}°) ${d.told}`),
        ),
      ),
    ),
  ]);
}

/** @param {OfflinePage} page @param {number | null} u @param {number} v */
export function showValues(page, u, v) {
  const n = u === null ? -1 : page.cloth.pixelAt(u, v, page.step);
  const values =
    n < 0
      ? ["–", "–", "–", "–"]
      : [
          `${vector([1000 * u, 1000 * v])} mm`,
          `${vector(page.cloth.point(n), 1, 1000)} mm`,
          degrees(page.cloth.zAngles[n] / 10),
          `view ${page.cloth.views[page.cloth.source[n]]}`,
        ];
  const list = byId("readout");
  if (!list.childElementCount) {
    list.append(
      ...[
        ["u, v", "mm on the plane"],
        ["x y z", "mm, held frame"],
        ["Z-angle", "deg"],
        ["Source", "view"],
      ].map(([name, about]) =>
        make("div", {}, make("dt", { data: { tip: `${name}: ${about}` } }, name), make("dd", {}, "–")),
      ),
    );
  }
  values.forEach((text, i) => setText(list.children[i].children[1], text));
}

export async function copyPick(/** @type {OfflinePage} */ page) {
  const pick = page.current;
  if (!pick) return;
  /** @param {string} name @param {number[]} values */
  const numbers = (name, values) => `${name}\t${values.map((x) => x.toFixed(5)).join(" ")}`;
  const text = [
    `name\t${pick.name}`,
    numbers("position_held_m", pick.position_held_m),
    numbers("normal_held", pick.normal_held),
    `view\t${pick.view_index}`,
    `source_row_col\t${pick.source_rc.map((x) => x.toFixed(2)).join(" ")}`,
    ...(pick.grip
      ? [
          numbers("approach_held", pick.grip.approach_held),
          numbers("axis_held", pick.grip.axis_held),
          `opening_m\t${pick.grip.opening_m}`,
        ]
      : []),
  ].join("\n");
  let done = await navigator.clipboard?.writeText(text).then(
    () => true,
    () => false,
  );
  if (!done) {
    // A page from a file may not be trusted with the clipboard; there is the old way.
    const area = make("textarea", { class: "unseen", readonly: true }, text);
    document.body.append(area);
    area.select();
    done = document.execCommand("copy");
    area.remove();
  }
  setText(byId("hint"), done ? `Copied the numbers of ${pick.name}.` : "The browser does not allow copying.");
}
