// viser's page in its frame: theme, reload after a lost connection, keys, and what it cannot show.

import { byId, graphicsOf, hasKeys, isWithoutCard, NO_GRAPHICS, sayWhenLost, showWords } from "./dom.js";
import { notify } from "./notices.js";
import { isDark, onTheme } from "./theme.js";

const SEEN = "flatcloth-scene-told"; // whether this browser has shown it
const SOFTWARE =
  "The 3D scene is slow: this browser draws it without a graphics card (hardware acceleration is off).";

const frame = byId("viser");
let shownDark = /** @type {boolean | null} */ (null);

export function startScene(/** @type {(event: KeyboardEvent) => void} */ onKeyDown) {
  frame.addEventListener("load", () => {
    frame.style.visibility = ""; // until then it would be white, also in the dark
    // Same origin: keys pressed in the scene mean the same as in the page. On the capture phase,
    // so that viser does not also fly its camera with the letters that are ours.
    frame.contentWindow?.addEventListener("keydown", onKeyDown, true);
    if (frame.contentWindow) sayWhenLost(frame.contentWindow, byId("scene-empty"));
    if (!frame.contentDocument?.getElementById("root") || localStorage.getItem(SEEN)) return; // no scene, or known
    if (isWithoutCard() && hasKeys()) notify("info", SOFTWARE);
    localStorage.setItem(SEEN, "yes");
  });
  onTheme(() => shownDark !== null && shownDark !== isDark() && loadScene());
}

/** Load viser's page, if it is not there yet. */
export const openScene = () => shownDark ?? loadScene();

/** Load viser's page (again): after a lost connection it would wait for the focus before it returns. */
export function loadScene() {
  shownDark = isDark();
  const gl = graphicsOf(document.createElement("canvas"));
  showWords(byId("scene-empty"), gl ? "" : NO_GRAPHICS);
  if (!gl) return;
  gl.getExtension("WEBGL_lose_context")?.loseContext(); // browsers allow a page few of them
  const address = new URL(shownDark ? "viser/?darkMode" : "viser/", document.baseURI).href;
  frame.style.visibility = "hidden";
  if (frame.contentWindow && frame.dataset.loaded) frame.contentWindow.location.replace(address);
  else frame.src = address;
  frame.dataset.loaded = "yes";
}
