// The settings: one door, made from the server's table, each with a reset.

import { PagePart } from "../page/page.js";
import { byId, choice, make, numberBox, rebuild, smallButton, tickBox } from "../page/dom.js";
import { number } from "../page/format.js";

/** @typedef {import("../page/messages").Setting} Setting */

const OF_LOOK = /^show_|^follow$/;

export class SettingsSheet extends PagePart {
  actions = { settings: () => this.open() };

  constructor(/** @type {Page} */ page) {
    super(page);
    byId("settings-reset").addEventListener("click", () => {
      page.send({ type: "set", reset: true });
    });
  }

  update() {
    if (byId("settings").open) this.show();
  }

  open() {
    this.show();
    byId("settings").showModal();
  }

  show() {
    const { settings_rows } = this.page.state;
    /** @type {Record<string, unknown>} */
    const settings = { ...this.page.state.settings };
    const rows = settings_rows.filter(
      ({ name }) => !OF_LOOK.test(name) && (name !== "auto_views" || settings.auto_until === "views"),
    );
    const isUsual = settings_rows.every(({ name, default: usual }) => settings[name] === usual);
    byId("settings-reset").setAttribute("aria-disabled", String(isUsual));
    rebuild(byId("settings-body"), [rows, settings], () => [
      ...rows.map((row) =>
        this.row(row, settings[row.name], (next) => this.page.send({ type: "set", values: { [row.name]: next } })),
      ),
    ]);
  }

  /** @param {Setting} row @param {unknown} value @param {(next: boolean | number | string) => unknown} set */
  row(row, value, set) {
    const { name, title, description, options, default: usual } = row;
    const id = `setting-${name}`;
    const tip = `Reset: default: ${options[String(usual)] ?? textOf(usual)}`;
    return [
      make("label", { for: id }, title),
      control(row, value, set),
      make(
        "span",
        value !== usual &&
          smallButton("Reset", () => set(usual), { key: `${id}-reset`, tip, label: `Reset ${title}` }),
      ),
      make("p.note", { id: `${id}-about` }, description),
    ];
  }
}

/**
 * What a setting is changed by.
 * @param {Setting} row @param {unknown} value @param {(next: boolean | number | string) => unknown} set
 */
function control(row, value, set) {
  const id = `setting-${row.name}`;
  const about = { id, key: id, "aria-describedby": `${id}-about` };
  if (typeof value === "boolean") return tickBox(value, set, about);
  if (typeof value === "string")
    return choice(Object.entries(row.options), value, { ...about, change: ({ target }) => set(target.value) });
  return numberBox(row, Number(value), {
    ...about,
    change: ({ target: box }) =>
      box.validity.rangeOverflow || box.validity.rangeUnderflow || !box.value
        ? (box.value = String(value))
        : set(box.valueAsNumber),
  });
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
