// What the exported page can do: one table for buttons, keys and the sheet of keys.

import { copyPick } from "./details.js";
import { toggleTheme } from "../page/theme.js";
import { actionSection, keySection, showKeys } from "../page/keys.js";

/**
 * Name, group, keys, title, what it does, how; and a label where the title is a sign.
 *
 * @type {[string, string, string[], string, string, (page: OfflinePage) => unknown, string?][]}
 */
const ACTIONS = [
  [
    "play",
    "Growth",
    ["Space"],
    "Play",
    "Play the growth from the start view, or pause.",
    (page) => page.togglePlay(),
  ],
  ["back", "Growth", [",", "ArrowLeft"], "Back", "Show the step before.", (page) => page.stepBy(-1)],
  ["forward", "Growth", [".", "ArrowRight"], "Forward", "Show the next step.", (page) => page.stepBy(1)],
  ["first", "Growth", ["Home"], "Start", "Show the start view alone.", (page) => page.goTo(0, true)],
  ["last", "Growth", ["End"], "Whole", "Show the whole shape.", (page) => page.goTo(page.last, false)],
  ["tint", "Growth", ["n"], "New", "Mark what the step has added.", (page) => page.setTint(!page.tint)],
  [
    "turn_over",
    "View",
    ["m"],
    "Turn over",
    "Show the other side of the garment; again: back.",
    (page) => page.turnOver(),
  ],
  ["fit", "View", ["f"], "Fit", "Fit the flattened shape into its pane.", (page) => page.flat.fit()],
  ["zoom_in", "View", ["+", "="], "+", "Zoom in.", (page) => page.flat.zoomBy(1.4), "Zoom in"],
  ["zoom_out", "View", ["-"], "−", "Zoom out.", (page) => page.flat.zoomBy(1 / 1.4), "Zoom out"],
  [
    "reset",
    "View",
    ["r"],
    "Camera",
    "Look in 3D from where the camera stood, and follow it.",
    (page) => page.cloud.lookAgain(),
  ],
  ["copy", "Page", ["c"], "Copy", "Copy the numbers of the current pick.", (page) => copyPick(page)],
  ["theme", "Page", ["t"], "Theme", "Switch between light and dark.", toggleTheme],
  ["help", "Page", ["?"], "Keys", "Show this sheet.", (page) => showHelp(page)],
];
const GROUPS = ["Growth", "Layer", "View", "Page"];
/** @type {HelpRow[]} */
const POINTER = [
  [["Click"], "", "Grasp point, flat or in 3D."],
  [["Drag"], "", "Turn in 3D, move the flattened view."],
  [["Right drag"], "", "Move in 3D."],
  [["Wheel"], "", "Zoom."],
];

/** @returns {OfflineAction[]} */
export function actionTable(/** @type {OfflinePage} */ page) {
  const layers = page.history.layers.map((layer, i) => ({
    name: `layer_${layer.name}`,
    group: "Layer",
    keys: [String(i + 1)],
    title: layer.title,
    description: `Show ${layer.about}.`,
    run: () => page.setLayer(layer.name),
  }));
  const others = ACTIONS.map(([name, group, keys, title, description, run, label]) => {
    return { name, group, keys, title, description, label, run: () => run(page) };
  });
  return [...others, ...layers];
}

function showHelp(/** @type {OfflinePage} */ page) {
  const sections = GROUPS.map((group) => actionSection(group, group, page.actions));
  showKeys([...sections, keySection("Pointer", POINTER)]);
}
