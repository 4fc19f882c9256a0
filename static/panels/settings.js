// The settings: one door, made from the server's table, each with a reset; and the numbers of the method, to read.

import { PagePart } from "../page/page.js";
import { askJson } from "../page/connection.js";
import { byId, choice, make, numberBox, rebuild, smallButton, tickBox } from "../page/dom.js";
import { number } from "../page/format.js";
import { chosenTheme, setTheme } from "../page/theme.js";

/** @type {import("../page/messages").Choice} a setting that this browser keeps */
const THEME = {
  name: "theme",
  title: "Theme",
  description: "Of this browser; all else is kept with the session.",
  value: "",
  default: "",
  options: [
    ["", "As the system"],
    ["light", "Light"],
    ["dark", "Dark"],
  ],
};

export class SettingsSheet extends PagePart {
  name = "settings";
  settings = /** @type {Partial<State["settings"]>} */ ({});
  actions = { settings: () => this.open() };

  constructor(/** @type {Page} */ page) {
    super(page);
    byId("settings-reset").addEventListener("click", () => {
      page.send({ type: "set", reset: true });
      setTheme("");
      this.show();
    });
  }

  update(/** @type {State} */ state) {
    this.settings = state.settings;
    if (byId("settings").open) this.show();
  }

  open() {
    this.show();
    byId("settings").showModal();
    this.showNumbers();
  }

  show() {
    const rows = Object.values(this.settings).filter(({ name }) => !name.startsWith("show_")); // those Look has
    const theme = chosenTheme();
    byId("settings-reset").setAttribute("aria-disabled", String(!theme && rows.every((s) => s.value === s.default)));
    /** @type {import("../page/messages").Choice} */
    const themes = { ...THEME, value: theme };
    rebuild(byId("settings-body"), [rows, theme], () => [
      ...rows.map((s) => this.row(s, (next) => this.page.send({ type: "set", [s.name]: next }))),
      this.row(themes, (name) => {
        setTheme(String(name));
        this.show();
      }),
    ]);
  }

  /** @param {State["settings"][keyof State["settings"]]} setting @param {(next: unknown) => unknown} set */
  row(setting, set) {
    const { name, title, description, value } = setting;
    const id = `setting-${name}`;
    const about = { id, key: id, "aria-describedby": `${id}-about` };
    const field =
      "options" in setting
        ? choice(
            setting.options.map(([value, words]) => [value, words]),
            setting.value,
            { ...about, change: ({ target }) => set(target.value) },
          )
        : "low" in setting
          ? numberBox(setting, setting.value, {
              ...about,
              change: ({ target: box }) =>
                box.validity.rangeOverflow || box.validity.rangeUnderflow || !box.value
                  ? (box.value = String(value))
                  : set(box.valueAsNumber),
            })
          : tickBox(setting.value, set, about);
    const options = "options" in setting ? setting.options : [];
    const usual = options.find(([of]) => of === setting.default)?.[1] ?? textOf(setting.default);
    const reset = () => set(setting.default);
    const tip = `Reset: default: ${usual}`;
    return [
      make("label", { for: id }, title),
      field,
      make(
        "span",
        value !== setting.default &&
          smallButton("Reset", reset, { key: `${id}-reset`, tip, label: `Reset ${title}` }),
      ),
      make("p.note", { id: `${id}-about` }, description),
    ];
  }

  async showNumbers() {
    const box = byId("settings-numbers");
    if (box.childElementCount) return;
    /** @type {{ section: string; values: { name: string; about: string; value: unknown; default: unknown }[] }[]} */
    const sections = (await askJson("settings/numbers.json")) ?? [];
    box.replaceChildren(
      ...sections.map(({ section, values }) =>
        make(
          "section",
          make("h3", section),
          make(
            "dl.values",
            ...values.flatMap((v) => [
              make("dt", { tip: v.about }, v.name.replaceAll("_", " ")),
              make("dd", { class: textOf(v.value) === textOf(v.default) ? "" : "changed" }, textOf(v.value)),
            ]),
          ),
        ),
      ),
    );
  }
}

/** @returns {string} */
function textOf(/** @type {unknown} */ value) {
  if (Array.isArray(value)) return value.map(textOf).join(", ");
  if (typeof value === "number")
    return number(value, Number.isInteger(value) ? 0 : Math.abs(value) >= 0.1 ? 2 : 5)
      .replace(/(\.\d*?)0+$/, "$1")
      .replace(/\.$/, "");
  return value === true ? "on" : value === false ? "off" : String(value);
}
