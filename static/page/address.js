// The address of the page: the place that is open, the view that is looked at, the pick; it can be sent.
//
// It is the part after "#": KIND/NAME, then view and pick as in a query; the server never sees it.

import { PagePart } from "./page.js";
import { askJson, post } from "./connection.js";

/**
 * @typedef {{ kind: string; name: string }} Place
 * @typedef {{ place: Place | null; view: number | null; pick: number | null }} Address
 */

/** Read the part of an address after "#". @returns {Address} */
export function readAddress(/** @type {string} */ hash) {
  const [path, query] = hash.replace(/^#/, "").split("?");
  const [kind, ...name] = path.split("/").map(decoded);
  const asked = new URLSearchParams(query);
  const count = (/** @type {string} */ key) =>
    /^\d{1,9}$/.test(asked.get(key) ?? "") ? Number(asked.get(key)) : null;
  return { place: kind ? { kind, name: name.join("/") } : null, view: count("view"), pick: count("pick") };
}

/** Write it. @returns {string} */
export function writeAddress(/** @type {Address} */ { place, view, pick }) {
  const query = new URLSearchParams();
  if (view !== null) query.set("view", String(view));
  if (pick !== null) query.set("pick", String(pick));
  const path = place ? [place.kind, ...place.name.split("/")].map(encodeURIComponent).join("/") : "";
  return `#${path}${query.size ? `?${query}` : ""}`;
}

function decoded(/** @type {string} */ text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}

export class PageAddress extends PagePart {
  name = "address";
  asked = readAddress(location.hash);
  place = /** @type {Place | null} */ (null);
  known = false; // what is open
  applied = false;

  constructor(/** @type {Page} */ page) {
    super(page);
    addEventListener("hashchange", () => this.go());
    this.begin();
  }

  /** Learn what is open; an address of another place opens that. */
  async begin() {
    const here = /** @type {{ place: Place | null } | null} */ (await askJson("start/here.json"));
    this.place = here?.place ?? null;
    if (!this.asked.place || same(this.asked.place, this.place)) {
      this.known = true;
      return this.page.changed();
    }
    const answer = await post("start/open", this.asked.place);
    if (answer?.ok) return location.reload();
    const body = /** @type {{ error?: string } | null} */ ((await answer?.json().catch(() => null)) ?? null);
    this.page.notify("warning", `This address cannot be opened here. ${body?.error ?? ""}`);
    this.asked.place = null;
    this.known = true;
    this.page.changed();
  }

  update(/** @type {State} */ state) {
    if (!this.known || state.mode === "camera" || !state.layers) return;
    if (!this.applied) {
      this.applied = true;
      this.apply(this.asked);
    }
    // Kept up to date, so that it can be copied and loaded again; the browser's history has one entry.
    const text = writeAddress(this.now);
    if (text !== location.hash && text !== "#") history.replaceState(null, "", text);
  }

  /** What the page shows, as an address. @returns {Address} */
  get now() {
    const { picks, pick } = this.page.state;
    const kept = picks.some(({ id, kept }) => kept && id === pick?.id); // another goes with the next click
    return { place: this.place, view: this.page.lookedAt, pick: (kept && pick?.id) || null };
  }

  /** An address was typed. */
  go() {
    if (!this.known || !this.page.state) return;
    const asked = readAddress(location.hash);
    if (asked.place && !same(asked.place, this.place)) return location.reload();
    this.apply(asked);
  }

  apply(/** @type {Address} */ { view, pick }) {
    const { state } = this.page;
    if (view !== this.page.lookedAt) this.page.each("goToView", view);
    if (pick === null || pick === (state.pick?.id ?? null)) return;
    if (state.picks.some(({ id }) => id === pick)) this.page.send({ type: "show_pick", id: pick });
    else this.page.notify("info", `The pick ${pick} of this address is not there any more.`);
  }
}

const same = (/** @type {Place} */ a, /** @type {Place | null} */ b) =>
  b !== null && a.kind === b.kind && a.name === b.name;
