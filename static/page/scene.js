// viser's page in its frame: theme, reload after a lost connection, keys, and what it warns of.

import { byId, find, findAll } from "/static/page/dom.js";
import { notify } from "/static/page/notices.js";
import { isDark, onTheme } from "/static/page/theme.js";

const SEEN = "flatcloth-scene-told"; // the warnings of viser's page that this browser has shown
const SOFTWARE =
  "The 3D scene is drawn without a graphics card, so it moves slowly. If this computer has one, turn on hardware " +
  "acceleration in the browser's settings.";

const frame = byId("viser");
let shownDark = /** @type {boolean | null} */ (null);

export function startScene(/** @type {(event: KeyboardEvent) => void} */ onKeyDown) {
  frame.addEventListener("load", () => {
    // Same origin: keys pressed in the scene mean the same as in the page. On the capture phase,
    // so that viser does not also fly its camera with the letters that are ours.
    frame.contentWindow?.addEventListener("keydown", onKeyDown, true);
    if (frame.contentDocument) foldWarnings(frame.contentDocument);
  });
  onTheme(() => loadScene(false));
  loadScene(true);
}

/** Load viser's page (again): after a lost connection it would wait for the focus before it returns. */
export function loadScene(/** @type {boolean} */ force) {
  if (!force && shownDark === isDark()) return;
  shownDark = isDark();
  const address = shownDark ? "/viser/?darkMode" : "/viser/";
  if (frame.contentWindow && frame.dataset.loaded) frame.contentWindow.location.replace(address);
  else frame.src = address;
  frame.dataset.loaded = "yes";
}

/** Warnings about the browser that viser's page lays over the scene become notices of this page, each once. */
function foldWarnings(/** @type {Document} */ inside) {
  const fold = () => {
    for (const warning of findAll(".mantine-Notification-root:not([data-folded])", inside)) {
      const title = find(".mantine-Notification-title", warning)?.textContent ?? "";
      if (!/webgl|browser/i.test(title)) continue;
      warning.dataset.folded = "";
      warning.style.display = "none";
      find("button", warning)?.click();
      const seen = JSON.parse(localStorage.getItem(SEEN) ?? "[]");
      if (seen.includes(title)) continue;
      localStorage.setItem(SEEN, JSON.stringify([...seen, title]));
      const description = find(".mantine-Notification-description", warning)?.textContent ?? "";
      notify("info", /software/i.test(title) ? SOFTWARE : `3D scene: ${title}. ${description}`);
    }
  };
  new MutationObserver(fold).observe(inside.body, { childList: true, subtree: true });
  fold();
}
