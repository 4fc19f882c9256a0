// How far Auto runs, as one choice: all views, until a view adds little, or this many; under the button of Auto.

import { PagePart } from "../page/page.js";
import { buttonOf, byId, find, make, placeBeside, rebuild, staysIn, taken } from "../page/dom.js";
import { control } from "../panels/settings.js";

export class AutoUntil extends PagePart {
  name = "autoUntil";
  menu = byId("auto-until");
  actions = { auto_until: () => (this.menu.hidden ? this.open() : this.close()) };

  constructor(/** @type {Page} */ page) {
    super(page);
    this.menu.addEventListener("submit", (event) => {
      event.preventDefault();
      this.close();
      if (!page.state.auto.running) page.run("auto");
    });
    this.menu.addEventListener("keydown", (event) => this.key(event));
    this.menu.addEventListener("focusout", (event) => {
      if (event.relatedTarget && !staysIn(this.menu, event)) this.close();
    });
  }

  update(/** @type {State} */ state) {
    const { auto_until: until, auto_least_cm2: least, auto_views: views } = state.settings;
    rebuild(this.menu, [until, least, views, state.auto.running], () => [
      make("p.note", "Auto goes on"),
      this.row("all", "until no view adds cloth"),
      this.row("area", "until a view adds less than", this.box("auto_least_cm2", "area"), "cm²"),
      this.row("views", "until the shape has", this.box("auto_views", "views"), "views"),
      make("button.button.primary", { type: "submit", key: "auto-run" }, state.auto.running ? "Close" : "Run"),
    ]);
  }

  /** @param {"all" | "area" | "views"} value @param {...Child} words */
  row(value, ...words) {
    const set = () => this.page.send({ type: "set", values: { auto_until: value } });
    const checked = this.page.state.settings.auto_until === value;
    return make(
      "label.field",
      make("input", { type: "radio", name: "auto-until", value, checked, key: `until-${value}`, change: set }),
      make("span", ...words),
    );
  }

  /** @param {"auto_least_cm2" | "auto_views"} name @param {string} until what it belongs to */
  box(name, until) {
    const { settings, settings_rows: rows } = this.page.state;
    const row = /** @type {import("../page/messages").Setting} */ (rows.find((one) => one.name === name));
    const set = (/** @type {unknown} */ next) =>
      this.page.send({ type: "set", values: { auto_until: until, [name]: Number(next) } });
    return control(row, settings[name], set, { key: name, label: row.title });
  }

  open() {
    this.menu.hidden = false;
    placeBeside(this.menu, buttonOf("auto").getBoundingClientRect(), true);
    find("input:checked", this.menu).focus();
  }

  close() {
    if (this.menu.contains(document.activeElement)) buttonOf("auto").focus();
    this.menu.hidden = true;
  }

  escape() {
    const was = !this.menu.hidden;
    this.close();
    return was;
  }

  key(/** @type {KeyboardEvent} */ event) {
    if (event.key !== "Escape") return event.stopPropagation();
    this.close();
    taken(event);
  }
}
