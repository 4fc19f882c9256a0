// What the exported page can do: one table for buttons, keys and the sheet of commands.

import { copyPick } from "./details.js";
import { GESTURES, showCommands } from "../page/commands.js";
import { toggleTheme } from "../page/theme.js";

/** Name, group, keys, title, what it does; and a name where the title is a sign. */
const TABLE = `
play | growth | Space | Play | Play the growth from the start view, or pause.
back | growth | , ArrowLeft | Back | Show the step before.
forward | growth | . ArrowRight | Forward | Show the next step.
first | growth | Home | Start | Show the start view alone.
last | growth | End | Whole | Show the whole shape.
tint | growth | n | New | Mark what the step has added.
turn_over | view | m | Turn over | Show the other side of the garment; again: back.
fit | view | f | Fit | Fit the flattened shape into its pane.
zoom_in | view | + = | + | Zoom in. | Zoom in
zoom_out | view | - | − | Zoom out. | Zoom out
reset | view | r | Camera | Look in 3D from where the camera stood, and follow it.
copy | page | c | Copy | Copy the numbers of the current pick.
theme | page | t | Theme | Switch between light and dark.
help | page | ? | Commands | Show all commands with their keys; find one by a few letters.
`;
/** @type {Record<string, (page: OfflinePage) => unknown>} */
const RUN = {
  play: (page) => page.togglePlay(),
  back: (page) => page.stepBy(-1),
  forward: (page) => page.stepBy(1),
  first: (page) => page.goTo(0, true),
  last: (page) => page.goTo(page.last, false),
  tint: (page) => page.setTint(!page.tint),
  turn_over: (page) => page.turnOver(),
  fit: (page) => page.flat.fit(),
  zoom_in: (page) => page.flat.zoomBy(1.4),
  zoom_out: (page) => page.flat.zoomBy(1 / 1.4),
  reset: (page) => page.cloud.lookAgain(),
  copy: copyPick,
  theme: toggleTheme,
  help: ({ actions }) =>
    showCommands([...actions, ...GESTURES], (name) => actions.find((action) => action.name === name)?.run()),
};

/** @returns {OfflineAction[]} */
export function actionTable(/** @type {OfflinePage} */ page) {
  const layers = page.history.layers.map((layer, i) => ({
    name: `layer_${layer.name}`,
    group: "layer",
    keys: [String(i + 1)],
    title: layer.title,
    description: `Show ${layer.about}.`,
    run: () => page.setLayer(layer.name),
  }));
  const rows = TABLE.trim().split("\n");
  const others = rows.map((row) => {
    const [name, group, keys, title, description, label] = row.split(" | ");
    return { name, group, keys: keys.split(" "), title, description, label, run: () => RUN[name](page) };
  });
  return [...others, ...layers];
}
