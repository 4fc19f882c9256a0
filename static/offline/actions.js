// What the exported page can do: one table for buttons, keys and the sheet of keys.

import { keyName } from "/static/page/format.js";
import { byId, make } from "/static/page/dom.js";

/** @returns {OfflineAction[]} */
export function actionTable(/** @type {OfflinePage} */ page) {
  const layer = (/** @type {OfflineLayer} */ info, /** @type {number} */ i) => ({
    name: `layer_${info.name}`,
    group: "Layer",
    keys: [String(i + 1)],
    title: info.title,
    about: `Show ${info.about}.`,
    run: () => page.setLayer(info.name),
  });
  return [
    {
      name: "play",
      group: "Growth",
      keys: ["Space"],
      title: "Play",
      about: "Play the growth from the start view, or pause.",
      run: () => page.togglePlay(),
    },
    {
      name: "back",
      group: "Growth",
      keys: [",", "ArrowLeft"],
      title: "Back",
      about: "Show the step before.",
      run: () => page.stepBy(-1),
    },
    {
      name: "forward",
      group: "Growth",
      keys: [".", "ArrowRight"],
      title: "Forward",
      about: "Show the next step.",
      run: () => page.stepBy(1),
    },
    {
      name: "first",
      group: "Growth",
      keys: ["Home"],
      title: "Start",
      about: "Show the start view alone.",
      run: () => page.goTo(0, true),
    },
    {
      name: "last",
      group: "Growth",
      keys: ["End"],
      title: "Whole",
      about: "Show the whole shape.",
      run: () => page.goTo(page.last, false),
    },
    {
      name: "tint",
      group: "Growth",
      keys: ["n"],
      title: "New",
      about: "Mark what the step has added.",
      run: () => page.setTint(!page.tint),
    },
    ...page.history.layers.map(layer),
    {
      name: "fit",
      group: "View",
      keys: ["f"],
      title: "Fit",
      about: "Fit the flattened shape into its pane.",
      run: () => page.flat.fit(),
    },
    {
      name: "zoom_in",
      group: "View",
      keys: ["+", "="],
      title: "+",
      label: "Zoom in",
      about: "Zoom in.",
      run: () => page.flat.zoomBy(1.4),
    },
    {
      name: "zoom_out",
      group: "View",
      keys: ["-"],
      title: "−",
      label: "Zoom out",
      about: "Zoom out.",
      run: () => page.flat.zoomBy(1 / 1.4),
    },
    {
      name: "reset",
      group: "View",
      keys: ["r"],
      title: "Camera",
      about: "Look in 3D from where the camera stood.",
      run: () => page.cloud.setStep(page.step, true),
    },
    {
      name: "follow",
      group: "View",
      keys: ["v"],
      title: "Follow",
      about: "Let the 3D view follow the camera from step to step.",
      run: () => page.setFollow(!page.follow),
    },
    {
      name: "around",
      group: "View",
      keys: ["i"],
      title: "Item",
      about: "Show, in grey, what else the camera saw.",
      run: () => page.setAround(!page.cloud.showAround),
    },
    {
      name: "copy",
      group: "Page",
      keys: ["c"],
      title: "Copy",
      about: "Copy the numbers of the current pick.",
      run: () => page.copy(),
    },
    {
      name: "theme",
      group: "Page",
      keys: ["t"],
      title: "Theme",
      about: "Switch between light and dark.",
      run: () => page.toggleTheme(),
    },
    { name: "help", group: "Page", keys: ["?"], title: "Keys", about: "Show page sheet.", run: () => page.help() },
  ];
}

export function showHelp(/** @type {OfflinePage} */ page) {
  const groups = [...new Set(page.actions.map((a) => a.group))];
  const keys = (/** @type {[string[], string, string][]} */ rows) =>
    make(
      "dl",
      { class: "keys" },
      ...rows.flatMap(([caps, title, about]) => [
        make("dt", {}, ...caps.map((k) => make("kbd", {}, keyName(k)))),
        make("dd", {}, make("strong", {}, title), " ", about),
      ]),
    );
  byId("help-body").replaceChildren(
    ...groups.map((group) =>
      make(
        "section",
        {},
        make("h3", {}, group),
        keys(
          page.actions.filter((a) => a.group === group).map((a) => [a.keys.slice(0, 2), a.label ?? a.title, a.about]),
        ),
      ),
    ),
    make(
      "section",
      {},
      make("h3", {}, "Pointer"),
      keys([
        [["Click"], "", "Grasp point, flat or in 3D."],
        [["Drag"], "", "Turn in 3D, move the flattened view."],
        [["Right drag"], "", "Move in 3D."],
        [["Wheel"], "", "Zoom."],
      ]),
    ),
  );
  byId("help").showModal();
}
