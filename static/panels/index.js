// The panels beside the canvas and the scene, in the order in which they take a state. A new one gets a line here.

import { BothSides } from "/static/both/panel.js";
import { GarmentPanel } from "/static/garment/panel.js";
import { JointsPanel } from "/static/joints/panel.js";
import { ActivePanel } from "/static/active/panel.js";
import { CapturePanel } from "/static/panels/capture.js";
import { Diagnostics } from "/static/panels/diagnostics.js";
import { PicksPanel } from "/static/panels/picks.js";
import { PiecesPanel } from "/static/panels/pieces.js";
import { ProposalPanel } from "/static/panels/proposal.js";
import { Readout } from "/static/panels/readout.js";
import { SidesPanel } from "/static/panels/sides.js";
import { SettingsSheet } from "/static/panels/settings.js";
import { SourcePanel } from "/static/panels/sources.js";
import { AutoUntil } from "/static/review/auto_until.js";
import { CheckPanel } from "/static/review/check.js";
import { DonePanel } from "/static/review/done.js";

/** Each is made with the page (page/page.js: Page) and may have what its typedef Panel names. */
export const PANELS = [
  ActivePanel,
  CheckPanel,
  CapturePanel,
  ProposalPanel,
  PiecesPanel,
  GarmentPanel,
  BothSides,
  JointsPanel,
  PicksPanel,
  DonePanel,
  SidesPanel,
  SettingsSheet,
  AutoUntil,
  SourcePanel,
  Diagnostics,
  Readout,
];
