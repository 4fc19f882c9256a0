// The stages of Fig. 4: the next rotation, the new view, and its alignment.

import { cm2, degrees, mm, number } from "/static/page/format.js";
import {
  drawLines,
  drawNewView,
  drawOverlay,
  drawRenewal,
  drawSearch,
  searchFacts,
} from "/static/teaching/alignment.js";
import { stagesOf } from "/static/teaching/lesson.js";
import { cases, equation, fraction, row, sum, sup, words } from "/static/teaching/math.js";
import {
  angleStart,
  curvesFacts,
  drawCurvesStage,
  drawRotation,
  drawZAngle,
  rotationFacts,
  viewName,
  zAngleFacts,
} from "/static/teaching/rotation.js";

const ALL = /** @type {ParameterName[]} */ (["sampling_interval_px", "z_angle_limit_deg", "overlap_cm2"]);

export const EXTENDING_STAGES = stagesOf("alignment", ALL, [
  {
    name: "Z-angle",
    figure: "Fig. 4a · section 4.1, step 1",
    part: "planning",
    parameters: ALL.slice(0, 2),
    probe: "z",
    start: angleStart,
    text: [
      "How far is the cloth turned away from the camera, about the vertical? The Z-angle of a normal is 0° " +
        "towards the camera, negative to the left, positive to the right (x points to the camera, z up).",
      "Steep cloth is measured badly. Pixels beyond the limit A_w are grey and do not count from here on. Where " +
        "the cloth turns out of sight, or nearer cloth covers it, its outline is an occluding edge: it goes on there.",
    ],
    math: () => [
      equation(
        "a =",
        sup("tan", "−1"),
        "(",
        fraction("n_y", "n_x"),
        ") ·",
        fraction("180°", "π"),
        words(",   "),
        "|a| < A_w",
      ),
    ],
    facts: zAngleFacts,
    legend: { limit: "limit A_w", soft: "does not count", band: "occluding edge", mark: "at the pointer" },
    draw: drawZAngle,
  },
  {
    name: "Curves",
    figure: "Fig. 4a · step 2",
    part: "planning",
    parameters: ALL.slice(0, 2),
    probe: "columns",
    start: angleStart,
    text: [
      "Column by column: h(u) counts the pixels within the limit, A_z(u) is their mean Z-angle.",
      "Hanging cloth is curved mainly sideways, so a column has nearly one Z-angle, and A_z gives the position " +
        "of a column around the item.",
    ],
    math: () => [
      equation("h(u) = # {v : |a(u, v)| < A_w}"),
      equation("A_z (u) =", fraction("1", "h(u)"), sum("v"), "a(u, v)"),
    ],
    facts: curvesFacts,
    legend: { count: "h(u)", mean: "A_z(u)", mark: "at the pointer" },
    draw: drawCurvesStage,
  },
  {
    name: "Rotation",
    figure: "Fig. 4a · steps 3 and 4",
    part: "planning",
    text: [
      "A larger turn shows more hidden cloth; but the next view must overlap this one by S_0. Columns are " +
        "counted from the occluding edge until their area exceeds S_0: at u_b, with the Z-angle A_0.",
      "The turn that brings u_b just to the limit is the largest that keeps this overlap; it is held to 10 to " +
        "50°. Of the recorded views, the largest turn up to A is taken.",
    ],
    math: ({ planning: p }) => [
      equation("p^2", sum(`u ${p.side === "right" ? "≥" : "≤"} u_b`), "h(u) > S_0"),
      equation("A_0 = A_z (u_b)", words(",   "), `A = A_w ${p.side === "right" ? "+" : "−"} A_0`),
    ],
    facts: rotationFacts,
    legend: { count: "h(u)", mean: "A_z(u)", accent: "S_0, u_b, A", band: "occluding edge", mark: "A_0, next view" },
    draw: drawRotation,
  },
  {
    name: "New view",
    figure: "Fig. 4b, c · section 3",
    text: [
      "The item is turned by A, and the new view is flattened by the same stages 1 to 7.",
      "It shows cloth that was hidden, and cloth that both views show. Its place on the plane is still " +
        "unknown: each view has a plane of its own.",
    ],
    math: () => [equation("x^′ = c + R(k, A)(x − c)"), equation("c, k", words(": point and direction of the axis"))],
    facts: ({ alignment: a }) => {
      /** @type {Fact[]} */
      const leftOut = [["Left out", `view ${a.planned_view}: it could not be aligned`]];
      return [
        ["New view", viewName(a, a.view_index)],
        [
          "Turned by",
          a.lines
            ? `${degrees(Math.abs(a.lines.rotation_deg), 0)} to the ${a.lines.rotation_deg < 0 ? "left" : "right"}`
            : "–",
        ],
        ["Area", cm2(a.new_cm2)],
        ...(a.planned_view === a.view_index ? [] : leftOut),
      ];
    },
    draw: drawNewView,
  },
  {
    name: "Lines",
    figure: "Fig. 4d, e · section 4.2",
    text: [
      "Turning adds A to every Z-angle: A_z − A is what the cloth of the new view had before. Both views saw " +
        "the range that they share (shaded).",
      "Pixels of its middle A_m make a band in each view; the axis of the band is a line on the cloth, and the " +
        "same height z on both lines gives a pair of points.",
    ],
    math: () => [equation("A_m =", words("middle of "), sup("A_z", "0"), "∩ (", sup("A_z", "1"), "− A)")],
    facts: ({ alignment: a }) =>
      a.lines
        ? [
            ["A, with its sign", degrees(a.lines.rotation_deg, 0)],
            ["Shared range", a.lines.common_range_deg.map((x) => degrees(x, 0)).join(" to ")],
            ["A_m", degrees(a.lines.a_m_deg)],
            ["Height of the points", mm(a.lines.height_mm, 0)],
          ]
        : [],
    legend: {
      mean: "A_z, A_z − A",
      before: "A_z after the turn",
      "soft 0.4": "shared range",
      band: "pixels at A_m",
      text: "line",
      mark: "point",
    },
    draw: drawLines,
  },
  {
    name: "Initial overlay",
    figure: "Fig. 4f · section 4.2",
    text: [
      "Line on line and point on point: that fixes one turn θ and one shift t, the initial estimate.",
      "It need not be good. Where the overlap is nearly flat, all of it has about one Z-angle, and the band " +
        "has no clear axis. If the placement found from it is refused, the method starts again from all pixels " +
        "that show the same place of the item, and the overlay is that one.",
    ],
    math: () => [
      equation("R(θ) d^1 = d^0", words(" (directions)")),
      equation("R(θ) q^1 + t = q^0", words(" (points)")),
    ],
    facts: ({ alignment: a }) => [
      ["Turn θ", degrees((180 * a.initial[0]) / Math.PI)],
      ["Shift t", `${mm(1000 * a.initial[1], 0)}, ${mm(1000 * a.initial[2], 0)}`],
      ["Score", number(a.initial_score, 2)],
    ],
    legend: { kept: "current view", new: "new view", band: "pixels at A_m", text: "lines", mark: "points" },
    draw: (sheet, rect, { alignment: lesson }) =>
      drawOverlay(
        sheet,
        sheet.titled(rect, "The plane", "the new view at its initial place"),
        lesson,
        lesson.initial,
        "overlay",
        true,
      ),
  },
  {
    name: "Search",
    figure: "section 4.2",
    plays: ({ alignment: a }) => a.search.motions.length - 1,
    text: [
      "Turns and shifts around the initial estimate are tried. Where both views lie on each other, intensity I, " +
        "height z and the Z-angle a should agree; ρ limits what one bad pixel can do. The paper compares I and z; " +
        "across plain cloth only a tells.",
      "First a coarse grid; its best places (rings) are followed in finer and finer steps. From the best one, the " +
        "last steps compare I and z alone. The result is proposed to the operator, or the initial " +
        "estimate where that scores more.",
    ],
    math: () => [
      equation("T =", words("arg min "), sum("p"), "ρ(Δ I) + ρ(Δ z) + ρ(Δ a)"),
      equation("Δ I = I^0 (T p) − I^1 (p)"),
    ],
    facts: searchFacts,
    legend: { kept: "current view", new: "new view", text: "best of the grid", mark: "way to the result" },
    draw: drawSearch,
  },
  {
    name: "Renewal",
    figure: "Fig. 4g · section 4.3",
    text: [
      "Both views become one. Where both show the cloth, the half next to the occluding edge takes the new " +
        "view; in the other half the smaller |Z-angle| wins, as it was measured more frontally.",
      "The plane is that of the new view from now on, and it begins again with stage 9, until no occluding " +
        "edge is left.",
    ],
    math: () => [
      equation(
        "F =",
        cases(
          ["F^1", words(" in the half at the edge")],
          ["F^1", row(words(" where "), "|a^1| < |a^0|")],
          ["F^0", words(" elsewhere")],
        ),
      ),
    ],
    facts: ({ alignment: a }) => [
      ["Area", `${number(a.current_cm2, 0)} → ${cm2(a.renewed_cm2)}`],
      ["Gained", cm2(a.renewed_cm2 - a.current_cm2)],
      ["Other parts placed", String(a.placed_with)],
      ["Side", a.side ?? "–"],
    ],
    legend: {
      kept: "current view only",
      "kept 0.55": "both: current taken",
      new: "new view only",
      "new 0.55": "both: new taken",
    },
    draw: drawRenewal,
  },
]);
