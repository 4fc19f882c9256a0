// The exported page: steps through the growth of a shape, in 3D and flattened, with its picks. It has no server.

import { FlatCanvas } from "/static/canvas/canvas.js";
import { make, rebuild, setText } from "/static/page/dom.js";
import { count, degrees, keyName, number, vector } from "/static/page/format.js";
import { startTips } from "/static/page/notices.js";
import { CloudView } from "/static/offline/cloud.js";
import { unpack } from "/static/offline/data.js";

const PLAY_MS = 1300;
const NEW = [255, 140, 0];
const AXIS_FROM = { outline: "along the outline", hand: "by hand", level: "level" };

const $ = (id) => document.getElementById(id);

class Page {
  constructor({ history, layers, cloth, around }) {
    Object.assign(this, { history, layers, cloth });
    this.last = history.steps.length - 1;
    this.step = this.last;
    this.layer = history.layers[0].name;
    this.tint = false; // whether the pixels that a step added are marked
    this.follow = true;
    this.current = null;
    this.flat = new FlatCanvas({
      pick: (u, v) => this.pickAt(u, v),
      hover: (u, v) => this.hover(u, v),
      nudge: () => {},
      mayDrag: () => false,
    });
    const { low, high } = history.extent;
    const scene = {
      cloth,
      around,
      axis: history.axis,
      axisLine: [history.axis.line],
      cameras: history.steps.map((s) => s.camera_m),
      center: low.map((x, i) => (x + high[i]) / 2),
      halfExtents: history.half_extents_m,
      spacing: history.around_spacing_m,
      start: this.step,
    };
    this.cloud = new CloudView($("cloud"), $("cloud-marks"), scene, (n) => n >= 0 && this.pick(n, 0));
    $("cloud-empty").hidden = this.cloud.works;
    this.cloud.setStep(this.step, false);
    setText($("cloud-empty"), "This browser shows no 3D here (WebGL 2 is off). The flattened view works without it.");
    this.actions = this.table();
    this.fixed();
    this.show();
  }

  table() {
    const layer = (info, i) => ({
      name: `layer_${info.name}`,
      group: "Layer",
      keys: [String(i + 1)],
      title: info.title,
      about: `Show ${info.about}.`,
      run: () => this.setLayer(info.name),
    });
    return [
      {
        name: "play",
        group: "Growth",
        keys: ["Space"],
        title: "Play",
        about: "Play the growth from the start view, or pause.",
        run: () => this.togglePlay(),
      },
      {
        name: "back",
        group: "Growth",
        keys: [",", "ArrowLeft"],
        title: "Back",
        about: "Show the step before.",
        run: () => this.stepBy(-1),
      },
      {
        name: "forward",
        group: "Growth",
        keys: [".", "ArrowRight"],
        title: "Forward",
        about: "Show the next step.",
        run: () => this.stepBy(1),
      },
      {
        name: "first",
        group: "Growth",
        keys: ["Home"],
        title: "Start",
        about: "Show the start view alone.",
        run: () => this.goTo(0, true),
      },
      {
        name: "last",
        group: "Growth",
        keys: ["End"],
        title: "Whole",
        about: "Show the whole shape.",
        run: () => this.goTo(this.last, false),
      },
      {
        name: "tint",
        group: "Growth",
        keys: ["n"],
        title: "New",
        about: "Mark what the step has added.",
        run: () => this.setTint(!this.tint),
      },
      ...this.history.layers.map(layer),
      {
        name: "fit",
        group: "View",
        keys: ["f"],
        title: "Fit",
        about: "Fit the flattened shape into its pane.",
        run: () => this.flat.fit(),
      },
      {
        name: "zoom_in",
        group: "View",
        keys: ["+", "="],
        title: "+",
        label: "Zoom in",
        about: "Zoom in.",
        run: () => this.flat.zoomBy(1.4),
      },
      {
        name: "zoom_out",
        group: "View",
        keys: ["-"],
        title: "−",
        label: "Zoom out",
        about: "Zoom out.",
        run: () => this.flat.zoomBy(1 / 1.4),
      },
      {
        name: "reset",
        group: "View",
        keys: ["r"],
        title: "Camera",
        about: "Look in 3D from where the camera stood.",
        run: () => this.cloud.setStep(this.step, true),
      },
      {
        name: "follow",
        group: "View",
        keys: ["v"],
        title: "Follow",
        about: "Let the 3D view follow the camera from step to step.",
        run: () => this.setFollow(!this.follow),
      },
      {
        name: "around",
        group: "View",
        keys: ["i"],
        title: "Item",
        about: "Show, in grey, what else the camera saw.",
        run: () => this.setAround(!this.cloud.showAround),
      },
      {
        name: "copy",
        group: "Page",
        keys: ["c"],
        title: "Copy",
        about: "Copy the numbers of the current pick.",
        run: () => this.copy(),
      },
      {
        name: "theme",
        group: "Page",
        keys: ["t"],
        title: "Theme",
        about: "Switch between light and dark.",
        run: toggleTheme,
      },
      { name: "help", group: "Page", keys: ["?"], title: "Keys", about: "Show this sheet.", run: () => this.help() },
    ];
  }

  action = (name) => this.actions.find((a) => a.name === name);

  button(name) {
    const a = this.action(name);
    return make(
      "button",
      {
        type: "button",
        class: "button",
        "aria-label": a.label ?? null,
        data: { action: name, id: name, tip: `${a.about}\nKey: ${a.keys.map(keyName).join(" or ")}` },
        on: { click: () => a.run() },
      },
      a.title,
      make("kbd", {}, keyName(a.keys[0])),
    );
  }

  /** What does not change. */
  fixed() {
    const { recording, method } = this.history;
    $("recording").textContent = `${recording.name} · ${count(recording.n_views, "view")} · method ${method}`;
    if (recording.description) $("recording").dataset.tip = recording.description;
    $("page-actions").append(...["tint", "theme", "help"].map((n) => this.button(n)));
    $("layers").append(...this.history.layers.map((l) => this.button(`layer_${l.name}`)));
    $("zoom-tools").append(...["zoom_out", "zoom_in", "fit"].map((n) => this.button(n)));
    $("cloud-tools").append(...["reset", "follow", "around"].map((n) => this.button(n)));
    $("play-tools").append(...["back", "play", "forward"].map((n) => this.button(n)));
    document.querySelector('[data-action="play"]').classList.add("play");
    $("timeline").append(
      ...this.history.steps.map((s) =>
        make(
          "button",
          {
            type: "button",
            class: "view",
            "aria-label": `Step ${s.order + 1}: view ${s.view_index}, ${number(s.angle_deg, 0)}°, adds ${number(s.added_cm2, 0)} cm²`,
            data: { step: s.order, tip: `View ${s.view_index} at ${number(s.angle_deg, 0)}°\n${s.told}` },
            on: {
              click: () => {
                this.pause();
                this.goTo(s.order, true);
              },
            },
          },
          make("span", { class: "sign", "aria-hidden": "true" }, String(s.view_index)),
          make("span", { class: "angle" }, `${number(s.angle_deg, 0)}°`),
        ),
      ),
    );
  }

  // --- what is shown -------------------------------------------------------------------------

  show() {
    const step = this.history.steps[this.step];
    this.paint();
    for (const button of $("timeline").children) {
      const order = Number(button.dataset.step);
      button.classList.toggle("done", order <= this.step);
      if (order === this.step) button.setAttribute("aria-current", "true");
      else button.removeAttribute("aria-current");
    }
    const pressed = {
      play: Boolean(this.timer),
      tint: this.tint,
      follow: this.follow,
      around: this.cloud.showAround,
    };
    for (const { name } of this.history.layers) pressed[`layer_${name}`] = name === this.layer;
    for (const [name, on] of Object.entries(pressed))
      document.querySelector(`[data-action="${name}"]`)?.setAttribute("aria-pressed", String(on));
    document.querySelector('[data-action="play"]').firstChild.textContent = this.timer ? "Pause" : "Play";
    setText(
      $("hint"),
      `Step ${this.step + 1} of ${this.last + 1}: view ${step.view_index} at ${number(step.angle_deg, 0)}°, ${step.told}. ` +
        `It adds ${number(step.added_cm2, 0)} cm²; the shape has ${number(step.area_cm2, 0)} cm².${this.step === this.last && this.history.finished ? ` ${this.history.finished}` : ""}`,
    );
    this.showLegend();
    this.showPicks();
    this.showDecisions();
    this.showPick();
  }

  /** Paint the flattened shape after the step, and color the cloth in 3D alike. */
  paint() {
    const { grid, at, first, count: n } = this.cloth;
    const layer = this.layers[this.layer];
    const image = new ImageData(grid.cols, grid.rows);
    const colors = new Uint8Array(3 * n);
    for (let k = 0; k < n; k++) {
      const from = 4 * at[k];
      for (let c = 0; c < 3; c++) colors[3 * k + c] = layer.pixels[from + c];
      if (first[k] > this.step) continue;
      const mark = this.tint && first[k] === this.step ? 0.5 : 0;
      for (let c = 0; c < 3; c++) image.data[from + c] = (1 - mark) * layer.pixels[from + c] + mark * NEW[c];
      image.data[from + 3] = 255;
    }
    const canvas = new OffscreenCanvas(grid.cols, grid.rows);
    canvas.getContext("2d").putImageData(image, 0, 0);
    this.flat.showFrame({ revision: this.step + 1, grid, box: this.cloth.box, image: canvas }, 0, null);
    this.cloud.tint = this.tint ? 0.5 : 0;
    this.cloud.setColors(colors);
    this.marks();
  }

  marks() {
    this.flat.pick = this.current && this.isShown(this.current) ? this.current : null;
    this.flat.showMarks(this.history.picks.filter((p) => this.isShown(p)));
    this.cloud.setMark(
      this.current ? { point: this.current.position_held_m, gripper: this.current.gripper_m } : null,
    );
  }

  isShown = (pick) => pick.uv_m !== null && this.cloth.pixelAt(...pick.uv_m, this.step) >= 0;

  showLegend() {
    const { legend } = this.layers[this.layer];
    const box = $("legend");
    box.hidden = legend.kind === "none";
    if (box.hidden) return;
    rebuild(box, legend, () => {
      const heading = make("h3", {}, legend.title);
      if (legend.kind === "classes") {
        return [
          heading,
          ...legend.classes.map((c) => {
            const swatch = make("i", { class: "swatch" });
            swatch.style.background = c.color;
            return make("p", {}, swatch, c.label);
          }),
        ];
      }
      const ramp = make("i", { class: "ramp" });
      ramp.style.background = `linear-gradient(to top, ${legend.colors.join(", ")})`;
      const ticks = [legend.high, (legend.low + legend.high) / 2, legend.low];
      return [
        heading,
        make("div", { class: "scale" }, ramp, make("div", {}, ...ticks.map((x) => make("span", {}, number(x, 0))))),
      ];
    });
  }

  // --- steps ---------------------------------------------------------------------------------

  goTo(step, tint) {
    const moved = step !== this.step;
    this.step = step;
    this.tint = tint && step >= 0;
    this.cloud.setStep(step, this.follow && moved);
    this.show();
  }

  stepBy(by) {
    this.pause();
    const step = Math.min(this.last, Math.max(0, this.step + by));
    if (step !== this.step) this.goTo(step, true);
  }

  togglePlay() {
    if (this.timer) {
      this.pause();
      return this.show();
    }
    this.timer = setInterval(() => {
      if (this.step < this.last) return this.goTo(this.step + 1, true);
      this.pause();
      this.goTo(this.last, false);
    }, PLAY_MS);
    this.goTo(this.step === this.last ? 0 : this.step, true);
  }

  pause() {
    clearInterval(this.timer);
    this.timer = null;
  }

  setLayer(name) {
    this.layer = name;
    this.show();
  }

  setTint(on) {
    this.tint = on;
    this.show();
  }

  setFollow(on) {
    this.follow = on;
    if (on) this.cloud.setStep(this.step, true);
    this.show();
  }

  setAround(on) {
    this.cloud.setAround(on);
    this.show();
  }

  // --- picks ---------------------------------------------------------------------------------

  pickAt(u, v) {
    const { n, miss } = this.cloth.nearest(u, v, this.step);
    if (n >= 0) this.pick(n, miss);
  }

  /** Look at a pixel of the cloth: shown on both sides, but kept nowhere. */
  pick(n, miss) {
    const { rc, uv } = this.cloth.place(n);
    this.setCurrent({
      id: null,
      name: "Here",
      rc,
      uv_m: uv,
      miss_m: miss,
      position_held_m: this.cloth.point(n),
      normal_held: this.cloth.normal(n),
      z_angle_deg: this.cloth.zAngles[n] / 10,
      view_index: this.cloth.views[this.cloth.source[n]],
      source_rc: [this.cloth.sourceRc[2 * n] / 10, this.cloth.sourceRc[2 * n + 1] / 10],
      grip: null,
      gripper_m: null,
    });
  }

  setCurrent(pick) {
    this.current = pick;
    this.marks();
    this.showPick();
    this.showPicks();
  }

  showPick() {
    const pick = this.current;
    rebuild($("pick"), [pick, pick !== null && pick.uv_m !== null && this.isShown(pick)], () => {
      if (!pick)
        return [
          make("h2", {}, "Grasp point"),
          make("p", { class: "nothing" }, "Click the cloth, flat or in 3D, or choose a pick."),
        ];
      const row = (name, text, tip) => [make("dt", { data: { tip } }, name), make("dd", {}, text)];
      const { grip } = pick;
      return [
        make("div", { class: "heading" }, make("h2", {}, pick.name), this.button("copy")),
        make(
          "dl",
          { class: "values" },
          ...row(
            "held",
            `${vector(pick.position_held_m, 1, 1000)} mm`,
            "Position x y z in the held frame: the camera frame of view 0, the item turned back",
          ),
          ...row("normal", vector(pick.normal_held, 3), "Outward normal in the held frame"),
          ...(pick.z_angle_deg === null
            ? []
            : row("Z-angle", degrees(pick.z_angle_deg), "Z-angle at which the pixel was seen")),
          ...row(
            "source",
            `view ${pick.view_index} @ ${pick.source_rc.map((x) => number(x)).join(", ")}`,
            "View and image pixel (row, column) it was measured in",
          ),
          ...(pick.rc ? row("pixel", pick.rc.join(", "), "Row, column of the flattened view") : []),
          ...(grip
            ? [
                ...row("approach", vector(grip.approach_held, 3), "Direction in which the gripper comes, held frame"),
                ...row(
                  "axis",
                  vector(grip.axis_held, 3),
                  `In-plane axis of the gripper, held frame; ${AXIS_FROM[grip.axis_from]}`,
                ),
                ...row("opening", `${number(1000 * grip.opening_m, 0)} mm`, "Distance of the fingers"),
                ...row(
                  "known to",
                  grip.position_std_m === null
                    ? "–"
                    : `${grip.position_std_m < 1e-4 ? "< 0.1" : number(1000 * grip.position_std_m)} mm  ${degrees(grip.normal_std_deg, 0)}`,
                  "One standard deviation of position and approach",
                ),
              ]
            : []),
        ),
        pick.uv_m && !this.isShown(pick) ? make("p", { class: "note" }, "Not part of the shape at this step.") : null,
        pick.uv_m ? null : make("p", { class: "note" }, "Its view is not part of the shape."),
      ].filter(Boolean);
    });
  }

  showPicks() {
    const { picks } = this.history;
    rebuild($("picks"), [this.step, this.current?.id ?? null], () => [
      make("h2", {}, `Picks (${picks.length})`),
      picks.length
        ? make(
            "ol",
            { class: "picks" },
            ...picks.map((p) =>
              make(
                "li",
                { class: p.id === this.current?.id ? "current" : "" },
                make("i", { class: `dot${this.isShown(p) ? "" : " gone"}`, "aria-hidden": "true" }),
                make(
                  "button",
                  {
                    type: "button",
                    class: "name",
                    "aria-pressed": String(p.id === this.current?.id),
                    "aria-label": `Show ${p.name}`,
                    data: { id: `pick-${p.id}`, tip: "Show on both sides" },
                    on: { click: () => this.setCurrent(p) },
                  },
                  p.name,
                ),
              ),
            ),
          )
        : make("p", { class: "nothing" }, "None were kept in this session."),
    ]);
  }

  showDecisions() {
    const signs = { accepted: "✓", rejected: "✕", skipped: "»" };
    rebuild($("decisions"), this.step, () => [
      make("h2", {}, `Decisions (${this.history.decisions.length})`),
      make(
        "ol",
        { class: "verdicts" },
        ...this.history.decisions.map((d) =>
          make(
            "li",
            { class: `${d.verdict}${d.stands ? "" : " gone"}${d.step === this.step ? " now" : ""}` },
            make("i", { "aria-hidden": "true" }, signs[d.verdict]),
            make("span", {}, `View ${d.view_index} (${number(d.angle_deg, 0)}°) ${d.told}`),
          ),
        ),
      ),
    ]);
  }

  hover(u, v) {
    const n = u === null ? -1 : this.cloth.pixelAt(u, v, this.step);
    const values =
      n < 0
        ? ["–", "–", "–", "–"]
        : [
            `${vector([1000 * u, 1000 * v])} mm`,
            `${vector(this.cloth.point(n), 1, 1000)} mm`,
            degrees(this.cloth.zAngles[n] / 10),
            `view ${this.cloth.views[this.cloth.source[n]]}`,
          ];
    const list = $("readout");
    if (!list.childElementCount) {
      list.append(
        ...[
          ["u, v", "mm on the plane"],
          ["x y z", "mm, held frame"],
          ["Z-angle", "deg"],
          ["Source", "view"],
        ].map(([name, about]) =>
          make("div", {}, make("dt", { data: { tip: `${name}: ${about}` } }, name), make("dd", {}, "–")),
        ),
      );
    }
    values.forEach((text, i) => setText(list.children[i].lastChild, text));
  }

  async copy() {
    const pick = this.current;
    if (!pick) return;
    const numbers = (name, values) => `${name}\t${values.map((x) => x.toFixed(5)).join(" ")}`;
    const text = [
      `name\t${pick.name}`,
      numbers("position_held_m", pick.position_held_m),
      numbers("normal_held", pick.normal_held),
      `view\t${pick.view_index}`,
      `source_row_col\t${pick.source_rc.map((x) => x.toFixed(2)).join(" ")}`,
      ...(pick.grip
        ? [
            numbers("approach_held", pick.grip.approach_held),
            numbers("axis_held", pick.grip.axis_held),
            `opening_m\t${pick.grip.opening_m}`,
          ]
        : []),
    ].join("\n");
    let done = await navigator.clipboard?.writeText(text).then(
      () => true,
      () => false,
    );
    if (!done) {
      // A page from a file may not be trusted with the clipboard; there is the old way.
      const area = make("textarea", { class: "unseen", readonly: true }, text);
      document.body.append(area);
      area.select();
      done = document.execCommand("copy");
      area.remove();
    }
    setText($("hint"), done ? `Copied the numbers of ${pick.name}.` : "The browser does not allow copying.");
  }

  // --- help and keys -------------------------------------------------------------------------

  help() {
    const groups = [...new Set(this.actions.map((a) => a.group))];
    const keys = (rows) =>
      make(
        "dl",
        { class: "keys" },
        ...rows.flatMap(([caps, title, about]) => [
          make("dt", {}, ...caps.map((k) => make("kbd", {}, keyName(k)))),
          make("dd", {}, make("strong", {}, title), " ", about),
        ]),
      );
    $("help-body").replaceChildren(
      ...groups.map((group) =>
        make(
          "section",
          {},
          make("h3", {}, group),
          keys(
            this.actions
              .filter((a) => a.group === group)
              .map((a) => [a.keys.slice(0, 2), a.label ?? a.title, a.about]),
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
    $("help").showModal();
  }

  key(event) {
    if (event.altKey || event.metaKey || event.ctrlKey || document.querySelector("dialog[open]")) return;
    const key = event.key === " " ? "Space" : event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const action = this.actions.find((a) => a.keys.includes(key));
    // Space presses the button that has the focus.
    if (!action || (key === "Space" && event.target.closest?.("button"))) return;
    event.preventDefault();
    action.run();
  }
}

// --- theme ------------------------------------------------------------------------------

const system = matchMedia("(prefers-color-scheme: dark)");
let chosen = null;
let page = null;

function applyTheme() {
  document.documentElement.dataset.theme = chosen ?? (system.matches ? "dark" : "light");
  page?.flat.redraw();
  page?.cloud.redraw();
}

function toggleTheme() {
  chosen = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  applyTheme();
}

system.addEventListener("change", applyTheme);
applyTheme();
startTips();
try {
  page = new Page(await unpack($("history").textContent, $("arrays").textContent));
  document.addEventListener("keydown", (event) => page.key(event));
  applyTheme();
  page.hover(null);
  window.flatcloth = page;
} catch (error) {
  $("broken").hidden = false;
  setText($("broken"), `This page cannot be shown here: ${error.message}. Open it with a browser of 2023 or newer.`);
  throw error;
}
