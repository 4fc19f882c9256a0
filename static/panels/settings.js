// The settings: one door, made from the server's table, each with a reset; and the numbers of the method, to read.

import { byId, make, rebuild } from "/static/page/dom.js";
import { number } from "/static/page/format.js";
import { chosenTheme, setTheme } from "/static/page/theme.js";

const THEMES = { "": "As the system", light: "Light", dark: "Dark" };

export class SettingsSheet {
  name = "settings";

  constructor(page) {
    this.page = page;
    this.actions = { settings: () => this.open() };
    byId("settings-reset").addEventListener("click", () => {
      page.send({ type: "set", reset: true });
      setTheme("");
      this.show();
    });
  }

  update(state) {
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

  row(setting) {
    const { name, title, description, value } = setting;
    const set = (next) => this.page.send({ type: "set", [name]: next });
    const id = `setting-${name}`;
    const field =
      setting.low === null
        ? make("input", {
            type: "checkbox",
            id,
            checked: value,
            data: { id },
            "aria-describedby": `${id}-about`,
            on: { change: (event) => set(event.target.checked) },
          })
        : make("input", {
            type: "number",
            id,
            min: setting.low,
            max: setting.high,
            step: setting.step,
            value,
            data: { id },
            "aria-describedby": `${id}-about`,
            on: {
              change: (event) =>
                event.target.validity.rangeOverflow || event.target.validity.rangeUnderflow || !event.target.value
                  ? (event.target.value = value)
                  : set(event.target.valueAsNumber),
            },
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

  themeRow(theme) {
    const id = "setting-theme";
    const change = (name) => {
      setTheme(name);
      this.show();
    };
    const field = make(
      "select",
      { id, data: { id }, "aria-describedby": `${id}-about`, on: { change: (event) => change(event.target.value) } },
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

  line(id, title, description, field, changed, first, reset) {
    return [
      make("label", { for: id }, title),
      field,
      make(
        "span",
        {},
        changed
          ? make(
              "button",
              {
                type: "button",
                class: "button small",
                data: { id: `${id}-reset`, tip: `Reset: ${first}` },
                "aria-label": `Reset ${title}`,
                on: { click: reset },
              },
              "Reset",
            )
          : null,
      ),
      make("p", { id: `${id}-about`, class: "note" }, description),
    ];
  }

  async showNumbers() {
    const box = byId("settings-numbers");
    if (box.childElementCount) return;
    const answer = await fetch("/settings/numbers.json").catch(() => null);
    if (!answer?.ok) return;
    const sections = await answer.json();
    box.replaceChildren(
      ...sections.map(({ section, values }) =>
        make(
          "section",
          {},
          make("h3", {}, section),
          make(
            "dl",
            { class: "values" },
            ...values.flatMap((v) => [
              make("dt", { data: { tip: v.about } }, v.name.replaceAll("_", " ")),
              make("dd", { class: told(v.value) === told(v.default) ? "" : "changed" }, told(v.value)),
            ]),
          ),
        ),
      ),
    );
  }
}

function told(value) {
  if (Array.isArray(value)) return value.map(told).join(", ");
  if (typeof value === "number")
    return number(value, Number.isInteger(value) ? 0 : Math.abs(value) >= 0.1 ? 2 : 5)
      .replace(/(\.\d*?)0+$/, "$1")
      .replace(/\.$/, "");
  return value === true ? "on" : value === false ? "off" : String(value);
}
