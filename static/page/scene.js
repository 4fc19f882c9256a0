// viser's page in its frame: theme, reload after a lost connection, keys, and what it cannot show.

import { byId, graphicsOf, hasKeys, isWithoutCard, showWords } from "./dom.js";
import { notify } from "./notices.js";
import { isDark, KeptSwitch, onTheme } from "./theme.js";

const SOFTWARE =
  "The 3D scene is slow: this browser draws it without a graphics card (hardware acceleration is off).";
const LOST =
  "The browser has taken its graphics from the 3D view (WebGL context lost). If it does not come back, load this " +
  "page again.";
const NO_GRAPHICS =
  "The 3D view needs WebGL 2, which this browser does not give it. The flattened view works without it.";

const [frame, words] = [byId("viser"), byId("scene-empty")];
const told = new KeptSwitch("scene-told"); // whether this browser has shown the scene before
let shownDark = /** @type {boolean | null} */ (null);

export function startScene(/** @type {(event: KeyboardEvent) => void} */ onKeyDown) {
  frame.addEventListener("load", () => {
    frame.style.visibility = ""; // until then it would be white, also in the dark
    // Same origin: keys pressed in the scene mean the same as in the page. On the capture phase,
    // so that viser does not also fly its camera with the letters that are ours.
    const inside = frame.contentWindow;
    inside?.addEventListener("keydown", onKeyDown, true);
    inside?.addEventListener("webglcontextlost", () => showWords(words, LOST), true);
    inside?.addEventListener("webglcontextrestored", () => showWords(words, ""), true);
    if (!frame.contentDocument?.getElementById("root") || told.on) return; // no scene, or known
    if (isWithoutCard() && hasKeys()) notify("info", SOFTWARE);
    told.on = true;
  });
  onTheme(() => shownDark !== null && shownDark !== isDark() && loadScene());
}

/** Load viser's page, if it is not there yet. */
export const openScene = () => shownDark ?? loadScene();

/** Load viser's page (again): after a lost connection it would wait for the focus before it returns. */
export function loadScene() {
  shownDark = isDark();
  const gl = graphicsOf(document.createElement("canvas"));
  showWords(words, gl ? "" : NO_GRAPHICS);
  if (!gl) return;
  gl.getExtension("WEBGL_lose_context")?.loseContext(); // browsers allow a page few of them
  const address = new URL(shownDark ? "viser/?darkMode" : "viser/", document.baseURI).href;
  frame.style.visibility = "hidden";
  if (frame.contentWindow && frame.dataset.loaded) frame.contentWindow.location.replace(address);
  else frame.src = address;
  frame.dataset.loaded = "yes";
}
