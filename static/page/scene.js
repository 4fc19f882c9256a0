// viser's page in its frame: theme, reload after a lost connection, keys, and the divider beside it.

import { byId } from "/static/page/dom.js";
import { isDark, onTheme } from "/static/page/theme.js";

const LEFT_MIN_PX = 584;
const RIGHT_MIN_PX = 600;
const STORED = "flatcloth-split";

const frame = byId("viser");
let shownDark = null;

export function startScene(onKeyDown) {
  frame.addEventListener("load", () => {
    // Same origin: keys pressed in the scene mean the same as in the page. On the capture phase,
    // so that viser does not also fly its camera with the letters that are ours.
    frame.contentWindow.addEventListener("keydown", onKeyDown, true);
  });
  onTheme(() => loadScene(false));
  loadScene(true);
  startDivider();
}

/** Load viser's page (again): after a lost connection it would wait for the focus before it returns. */
export function loadScene(force) {
  if (!force && shownDark === isDark()) return;
  shownDark = isDark();
  const address = shownDark ? "/viser/?darkMode" : "/viser/";
  if (frame.contentWindow && frame.dataset.loaded) frame.contentWindow.location.replace(address);
  else frame.src = address;
  frame.dataset.loaded = "yes";
}

function startDivider() {
  const split = byId("split");
  const divider = byId("divider");
  const shield = byId("scene-shield");
  let share = Number(localStorage.getItem(STORED)) || 0.45;

  const apply = () => {
    const width = split.clientWidth;
    const most = Math.max(LEFT_MIN_PX, width - RIGHT_MIN_PX);
    const left = Math.round(Math.min(most, Math.max(LEFT_MIN_PX, share * width)));
    split.style.setProperty("--left", `${left}px`);
    divider.setAttribute("aria-valuenow", String(Math.round((100 * left) / width)));
    return left / width;
  };
  const set = (value) => {
    share = value;
    share = apply();
    localStorage.setItem(STORED, String(share));
  };

  divider.addEventListener("pointerdown", (event) => {
    divider.setPointerCapture(event.pointerId);
    shield.hidden = false; // the frame would swallow the pointer
  });
  divider.addEventListener("pointermove", (event) => {
    if (divider.hasPointerCapture(event.pointerId))
      set((event.clientX - split.getBoundingClientRect().left) / split.clientWidth);
  });
  divider.addEventListener("lostpointercapture", () => (shield.hidden = true));
  divider.addEventListener("dblclick", () => set(0.45));
  divider.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: -0.02, ArrowRight: 0.02, Home: -1, End: 1 }[event.key];
    if (by === undefined) return;
    set(share + by);
    event.preventDefault();
    event.stopPropagation();
  });
  new ResizeObserver(apply).observe(split);
}
