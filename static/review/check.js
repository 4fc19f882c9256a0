// What is wrong with the recording: a card a finding, with the picture that shows why and a button that mends it.

import { PagePart } from "../page/page.js";
import { askJson, post } from "../page/connection.js";
import { byId, closeButton, heading, make } from "../page/dom.js";

const LEAST_VIEWS = 4;
const AGAIN = "Opens the recording again with this setting";
const SHOWN = "Two views on each other, as recorded and as mended";

/**
 * @typedef {object} Finding
 * @property {string} name
 * @property {string} text
 * @property {number} probability
 * @property {boolean} certain
 * @property {({ options: string } & Record<string, unknown>)[]} mends
 * @property {number[] | null} views
 */

export class CheckPanel extends PagePart {
  checked = /** @type {string | null} */ (null);
  panel = byId("check");

  update(/** @type {State} */ state) {
    const { name, n_views: views } = state.recording;
    const checked = `${name} ${Math.floor(Math.log2(views / LEAST_VIEWS))}`; // again once it has doubled
    // The first picture comes first: both take all processors.
    if (!this.page.isSettled || state.capture || views < LEAST_VIEWS || checked === this.checked) return;
    this.checked = checked;
    void this.ask();
  }

  async ask() {
    /** @type {{ as_recorded: boolean; findings: Finding[] } | null} */
    const checked = await askJson("check.json");
    if (!checked?.findings.length || checked.as_recorded) return;
    // What is certain is shown; doubts wait until somebody wants to know.
    const certain = (this.page.recordingIsWrong = checked.findings.some((finding) => finding.certain));
    this.panel.replaceChildren(
      heading(
        certain ? "Something about this recording is wrong" : "Is this recording right?",
        closeButton("Go on as recorded", () => this.show(false)),
      ),
      ...checked.findings.map((finding, n) => this.card(finding, n)),
    );
    this.show(true);
  }

  show(/** @type {boolean} */ on) {
    this.panel.hidden = !on;
    this.page.changed();
  }

  card(/** @type {Finding} */ finding, /** @type {number} */ n) {
    const sure = `${Math.min(99.9, 100 * finding.probability).toFixed(finding.certain ? 1 : 0)} % sure`;
    const buttons = finding.mends.map(({ options, ...mends }) =>
      make("button.button", { click: () => this.mend(mends), tip: AGAIN }, `Open with ${options}`),
    );
    return make(
      "article",
      make("p", `${finding.text} (${sure}).`),
      buttons.length ? make("div.group", ...buttons) : make("p.soft", "No setting mends this; record it again."),
      finding.views && make("img", { src: `check/${n}.png`, alt: SHOWN }),
    );
  }

  async mend(/** @type {Record<string, unknown>} */ mends) {
    this.panel.setAttribute("aria-busy", "true");
    const answer = await post("start/mend", { mends });
    const body = await answer?.json().catch(() => null);
    this.panel.removeAttribute("aria-busy");
    if (!answer?.ok) this.page.notify("error", body?.error ?? "There is no connection to flatcloth.");
  }
}
