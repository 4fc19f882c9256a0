// Beside the pictures of the exported page: the current pick, all picks, the decisions, the values under the pointer.

import { byId, heading, make, rebuild, values } from "../page/dom.js";
import { degrees, mm, number, vector } from "../page/format.js";
import { AXIS_FROM, copyText, pickText, sourceRow, stdMm } from "../panels/pick_text.js";
import { showReadout } from "../panels/readout.js";

export function showPick(/** @type {OfflinePage} */ page) {
  const pick = page.current;
  const shown = pick !== null && page.isShown(pick);
  rebuild(byId("pick"), [pick, shown], () => {
    if (!pick)
      return [make("h2", "Grasp point"), make("p.nothing", "Click the cloth, flat or in 3D, or choose a pick.")];
    return [
      heading(pick.name, page.button("copy")),
      values(
        [
          "Place",
          `${vector(pick.position_held_m, 1, 1000)} mm`,
          "Position x y z in the object frame: the camera frame of view 0, the item turned back",
        ],
        ["Normal", vector(pick.normal_held, 3), "Outward normal in the object frame"],
        pick.z_angle_deg !== null && ["Z-angle", degrees(pick.z_angle_deg), "Z-angle at which the pixel was seen"],
        sourceRow(pick),
        pick.rc && ["Pixel", pick.rc.join(", "), "Row, column of the flattened view"],
        ...(pick.grip ? gripRows(pick.grip) : []),
      ),
      pick.uv_m && !shown && make("p.note", "Not part of the shape at this step."),
      !pick.uv_m && make("p.note", "Its view is not part of the shape."),
    ];
  });
}

/** @param {NonNullable<OfflinePick["grip"]>} grip @returns {ValueRow[]} */
const gripRows = (grip) => [
  ["Approach", vector(grip.approach_held, 3), "Direction in which the gripper comes, object frame"],
  ["Axis", vector(grip.axis_held, 3), `In-plane axis of the gripper, object frame; ${AXIS_FROM[grip.axis_from]}`],
  ["Opening", mm(1000 * grip.opening_m, 0), "Distance of the fingers"],
  [
    "Known to",
    grip.position_std_m === null ? "–" : `${stdMm(grip.position_std_m)}  ${degrees(grip.normal_std_deg, 0)}`,
    "One standard deviation of position and approach",
  ],
];

export function showPicks(/** @type {OfflinePage} */ page) {
  const { picks } = page.history;
  const current = page.current?.id ?? null;
  const row = (/** @type {OfflinePick} */ pick) =>
    make(
      "li",
      { class: pick.id === current ? "current" : "" },
      make("i", { class: `dot${page.isShown(pick) ? "" : " gone"}`, "aria-hidden": "true" }),
      make("button.name", {
        pressed: pick.id === current,
        label: `Show ${pick.name}`,
        key: `pick-${pick.id}`,
        tip: "Show on both sides",
        click: () => page.setCurrent(pick),
        text: pick.name,
      }),
    );
  rebuild(byId("picks"), [page.step, current], () => [
    make("h2", `Picks (${picks.length})`),
    picks.length ? make("ol.picks", ...picks.map(row)) : make("p.nothing", "None were kept in this session."),
  ]);
}

export function showDecisions(/** @type {OfflinePage} */ page) {
  /** @type {Record<string, string>} */
  const signs = { accepted: "✓", rejected: "✕", skipped: "»" };
  const { decisions } = page.history;
  rebuild(byId("decisions"), page.step, () => [
    make("h2", `Decisions (${decisions.length})`),
    make(
      "ol.verdicts",
      ...decisions.map((d) =>
        make(
          "li",
          { class: `${d.verdict}${d.stands ? "" : " gone"}${d.step === page.step ? " now" : ""}` },
          make("i", { "aria-hidden": "true" }, signs[d.verdict]),
          make("span", `View ${d.view_index} (${number(d.angle_deg, 0)}°) ${d.told}`),
        ),
      ),
    ),
  ]);
}

/** @param {OfflinePage} page @param {Place | null} at */
export function showValues({ cloth, step }, at) {
  const n = at ? cloth.pixelAt(at.u_m, at.v_m, step) : -1;
  const known = (/** @type {() => string} */ text) => (n < 0 ? "–" : text());
  showReadout([
    ["u, v", "mm on the plane", known(() => `${vector([at?.u_m ?? 0, at?.v_m ?? 0], 1, 1000)} mm`)],
    ["x y z", "mm, object frame", known(() => `${vector(cloth.point(n), 1, 1000)} mm`)],
    ["Z-angle", "deg", known(() => degrees(cloth.zAngle(n)))],
    ["Source", "view", known(() => `view ${cloth.views[cloth.source[n]]}`)],
  ]);
}

export async function copyPick(/** @type {OfflinePage} */ page) {
  const { current: pick } = page;
  if (!pick) return;
  const done = await copyText(pickText(pick));
  page.notify("info", done ? `Copied the numbers of ${pick.name}.` : "The browser does not allow copying.");
}
