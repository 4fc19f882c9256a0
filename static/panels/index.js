// The panels beside the canvas and the scene, in the order in which they take a state. A new one gets a line here.

import { BothSides } from "../both/panel.js";
import { GarmentPanel } from "../garment/panel.js";
import { DoubtsPanel } from "../doubts/panel.js";
import { ActivePanel } from "../active/panel.js";
import { CapturePanel } from "./capture.js";
import { Diagnostics } from "./diagnostics.js";
import { PicksPanel } from "./picks.js";
import { ProposalPanel } from "./proposal.js";
import { Readout } from "./readout.js";
import { SidesPanel } from "./sides.js";
import { SettingsSheet } from "./settings.js";
import { SourcePanel } from "./sources.js";
import { CheckPanel } from "../review/check.js";

/** Each is made with the page (page/page.js: Page) and may have what its typedef Panel names. */
export const PANELS = [
  ActivePanel,
  CheckPanel,
  CapturePanel,
  ProposalPanel,
  GarmentPanel,
  BothSides,
  DoubtsPanel,
  PicksPanel,
  SidesPanel,
  SettingsSheet,
  SourcePanel,
  Diagnostics,
  Readout,
];
