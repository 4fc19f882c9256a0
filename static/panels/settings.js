// The settings: one door, made from the server's table, each with a reset; and the numbers of the method, to read.

import { ask } from "/static/page/connection.js";
import { byId, make, rebuild } from "/static/page/dom.js";
import { number } from "/static/page/format.js";
import { chosenTheme, setTheme } from "/static/page/theme.js";

/** @type {Record<string, string>} */
const THEMES = { "": "As the system", light: "Light", dark: "Dark" };

export class SettingsSheet {
  name = "settings";

  constructor(/** @type {Page} */ page) {
    this.page = page;
    /** @type {State["settings"]} */
    this.settings = /** @type {any} */ ({});
    this.actions = { settings: () => this.open() };
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
    const rows = Object.values(this.settings);
    const theme = chosenTheme();
    byId("settings-reset").setAttribute("aria-disabled", String(!theme && rows.every((s) => s.value === s.default)));
    rebuild(byId("settings-body"), [rows, theme], () => [
      ...rows.flatMap((s) => this.row(s)),
      ...this.themeRow(theme),
    ]);
  }

  row(/** @type {State["settings"][keyof State["settings"]]} */ setting) {
    const { name, title, description, value } = setting;
    const set = (/** @type {unknown} */ next) => this.page.send({ type: "set", [name]: next });
    const id = `setting-${name}`;
    const field =
      setting.low === null
        ? make("input", {
            type: "checkbox",
            id,
            checked: value,
            key: id,
            "aria-describedby": `${id}-about`,
            change: (event) => set(event.target.checked),
          })
        : make("input", {
            type: "number",
            id,
            min: setting.low,
            max: setting.high,
            step: setting.step,
            value,
            key: id,
            "aria-describedby": `${id}-about`,
            change: (event) =>
              event.target.validity.rangeOverflow || event.target.validity.rangeUnderflow || !event.target.value
                ? (event.target.value = String(value))
                : set(event.target.valueAsNumber),
          });
    return this.line(
      id,
      title,
      description,
      field,
      value !== setting.default,
      `default: ${told(setting.default)}`,
      () => set(setting.default),
    );
  }

  themeRow(/** @type {string} */ theme) {
    const id = "setting-theme";
    const change = (/** @type {string} */ name) => {
      setTheme(name);
      this.show();
    };
    const field = make(
      "select",
      { id, key: id, "aria-describedby": `${id}-about`, change: (event) => change(event.target.value) },
      ...Object.entries(THEMES).map(([name, title]) =>
        make("option", { value: name, selected: name === theme }, title),
      ),
    );
    return this.line(
      id,
      "Theme",
      "Of this browser; all else is kept with the session.",
      field,
      theme !== "",
      "as the system",
      () => change(""),
    );
  }

  /**
   * @param {string} id @param {string} title @param {string} description @param {HTMLElement} field
   * @param {boolean} changed @param {string} first @param {() => void} reset
   */
  line(id, title, description, field, changed, first, reset) {
    return [
      make("label", { for: id }, title),
      field,
      make(
        "span",
        changed &&
          make("button.button.small", {
            key: `${id}-reset`,
            tip: `Reset: ${first}`,
            label: `Reset ${title}`,
            click: reset,
            text: "Reset",
          }),
      ),
      make("p.note", { id: `${id}-about` }, description),
    ];
  }

  async showNumbers() {
    const box = byId("settings-numbers");
    if (box.childElementCount) return;
    const answer = await ask("/settings/numbers.json");
    if (!answer?.ok) return;
    /** @type {{ section: string; values: { name: string; about: string; value: unknown; default: unknown }[] }[]} */
    const sections = await answer.json();
    box.replaceChildren(
      ...sections.map(({ section, values }) =>
        make(
          "section",
          make("h3", section),
          make(
            "dl.values",
            ...values.flatMap((v) => [
              make("dt", { tip: v.about }, v.name.replaceAll("_", " ")),
              make("dd", { class: told(v.value) === told(v.default) ? "" : "changed" }, told(v.value)),
            ]),
          ),
        ),
      ),
    );
  }
}

/** @returns {string} */
function told(/** @type {unknown} */ value) {
  if (Array.isArray(value)) return value.map(told).join(", ");
  if (typeof value === "number")
    return number(value, Number.isInteger(value) ? 0 : Math.abs(value) >= 0.1 ? 2 : 5)
      .replace(/(\.\d*?)0+$/, "$1")
      .replace(/\.$/, "");
  return value === true ? "on" : value === false ? "off" : String(value);
}
