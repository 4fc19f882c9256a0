// The stages of the side of interest: the item, the evidence of two layers, and the sides.

import { boxOfPoints } from "../canvas/geometry.js";
import { cm2, number, percent, rgbOf } from "../page/format.js";
import { imageBox, shareOf } from "./detail.js";
import { columns, painted } from "./draw.js";

const UNDECIDED = 0;
const NO_ITEM = 2;
const STRIPE_PX = 6; // undecided cloth is striped, so that it differs without colour, too

// --- pictures of labels ----------------------------------------------------------------------------

/**
 * The labels of a view, or their certainty, as a picture of the size of its crop.
 * @param {Sheet} sheet @param {SidesLesson} lesson @param {string} name @param {{ rows: number; cols: number }} grid
 * @param {boolean} certain
 */
function labelPicture(sheet, lesson, name, grid, certain) {
  const side = lesson.array[`${name}_side`];
  const sure = lesson.array[`${name}_percent`];
  const [ours, other, none, low] = ["kept", "new", "even", "panel"].map((color) => rgbOf(sheet.color[color]));
  return painted(grid.rows, grid.cols, (i) => {
    if (side[i] === NO_ITEM) return null;
    if (certain) {
      const share = Math.min(1, Math.max(0, (sure[i] - 50) / 50));
      return [...ours.map((c, k) => c * share + low[k] * (1 - share)), 255];
    }
    const striped =
      side[i] === UNDECIDED && (Math.floor(i / grid.cols) + (i % grid.cols)) % (2 * STRIPE_PX) < STRIPE_PX;
    const color = side[i] === UNDECIDED ? (striped ? none : low) : side[i] > 0 ? ours : other;
    return [...color, 235];
  });
}

/** @param {{ rows: number; cols: number }} grid */
const boxOfGrid = (grid) => ({ left: -0.5, top: -0.5, right: grid.cols - 0.5, bottom: grid.rows - 0.5 });

/**
 * @param {Sheet} sheet @param {Rect} rect @param {string} key @param {SidesLesson} lesson @param {string} name
 * @param {{ rows: number; cols: number }} grid @param {boolean} certain
 */
function drawLabels(sheet, rect, key, lesson, name, grid, certain) {
  const box = boxOfGrid(grid);
  return sheet.show(key, box, rect, {}, (map) =>
    sheet.picture(map, labelPicture(sheet, lesson, name, grid, certain), box),
  );
}

// --- the slice seen from above ---------------------------------------------------------------------

/** @param {Sheet} sheet @param {Rect} rect @param {SidesLesson} lesson @param {boolean} colored */
function drawSection(sheet, rect, lesson, colored) {
  const { section_mm: place, section_normal: normal, section_side: side } = lesson.array;
  const box = boxOfPoints(place);
  const map = sheet.pane("section", box, rect, { margin: 24 });
  const dot = Math.max(1.6, Math.min(4, 1.3 * map.scaleX));
  sheet.within(rect, () => {
    if (!colored) {
      sheet.segments(map, place, lesson.array.alike, sheet.color.pair, 1.4);
      sheet.segments(map, place, lesson.array.opposite, sheet.color.unused, 1.4);
    }
    const groups = colored ? { 1: "kept", "-1": "new", 0: "even" } : { all: "text" };
    for (const [value, color] of Object.entries(groups)) {
      const own = [];
      for (let k = 0; k < side.length; k++) if (value === "all" || side[k] === Number(value)) own.push(k);
      sheet.dots(
        map,
        own.flatMap((k) => [place[2 * k], place[2 * k + 1]]),
        dot,
        sheet.color[color],
      );
      for (const k of own) {
        const [x, y] = map.at(place[2 * k], place[2 * k + 1]);
        const along = 2.4 * dot * sheet.weight;
        sheet.line([x, y], [x + along * normal[2 * k], y + along * normal[2 * k + 1]], sheet.color[color], 1);
      }
    }
    sheet.text("camera of view 0 ↓", rect.x + rect.w / 2, rect.y + rect.h - 6, {
      align: "center",
      color: sheet.color.soft,
      size: 0.85,
      plate: true,
    });
  });
  sheet.frame(rect);
}

// --- the stages ------------------------------------------------------------------------------------

/** @type {Record<string, StageCode>} */
export const SIDE_STAGES = {
  item: {
    facts({ sides: lesson }) {
      const cut = Object.entries(lesson.cut_off_cm2);
      return [
        ["Item in this view", `${number(lesson.item_px, 0)} px`],
        ["Views that show it", String(lesson.n_views)],
        ["Cut off here", cut.length ? cut.map(([kind, area]) => `${kind} ${cm2(area)}`).join(", ") : "nothing"],
      ];
    },
    draw(sheet, rect, { sides: lesson }) {
      const image = lesson.picture.image;
      const box = imageBox(image);
      const inner = sheet.titled(rect, `View ${lesson.view_index}`, "pale: no part of the item");
      sheet.image("image", image, box, inner);
    },
  },
  two_layers: {
    facts: ({ sides: lesson }) => [
      ["Places on the cloth", String(lesson.clusters)],
      ["Pairs alike", String(lesson.n_alike)],
      ["Pairs opposite", String(lesson.n_opposite)],
    ],
    /** The start view beside the slice, which is marked in it. / */
    draw(sheet, rect, { sides: lesson }) {
      const image = lesson.picture.image;
      const box = imageBox(image);
      const share = shareOf(box, rect, 0.2, 0.4);
      const [left, right] = columns(rect, [share, 1 - share]);
      const [top, first] = lesson.first.offset_rc;
      const rc = lesson.array.section_rc;
      const points = Float32Array.from(rc, (_, i) => (i % 2 ? rc[i - 1] + top : rc[i + 1] + first));
      sheet.show("image", box, sheet.titled(left, `View ${lesson.view_index}`, "with the slice"), {}, (map) => {
        sheet.picture(map, image, box, 0.8);
        sheet.dots(map, points, 0.8, sheet.color.mark);
      });
      drawSection(sheet, sheet.titled(right, "The slice", "of all views, seen from above"), lesson, false);
    },
  },
  sides: {
    values: ({ sides: lesson }) => ({ samples: String(lesson.samples) }),
    layers: { color: "Sides", certainty: "Certainty" },
    facts: ({ sides: lesson }) => [
      ["Mean certainty", percent(lesson.certainty)],
      ["Of interest", cm2(lesson.found_cm2)],
      ["Undecided", cm2(lesson.undecided_cm2)],
    ],
    draw(sheet, rect, { sides: lesson }, ui) {
      const grid = lesson.first;
      const share = shareOf(boxOfGrid(grid), rect, 0.25, 0.5);
      const [left, right] = columns(rect, [share, 1 - share]);
      const certain = ui.layer === "certainty";
      const title = certain ? "Certainty" : "Sides";
      drawLabels(
        sheet,
        sheet.titled(left, title, `view ${lesson.view_index}`),
        "labels",
        lesson,
        "first",
        grid,
        certain,
      );
      drawSection(sheet, sheet.titled(right, "The slice", "of all views, seen from above"), lesson, true);
    },
  },
};
