// Made by flatcloth/viewer/protocol/typescript.py; not to be edited.

/** Perform a session action; ``view_index`` is the view the user means, if the action has one. */
export interface Do {
  type: "do";
  action: "accept" | "cancel" | "redo" | "reject" | "reopen" | "restart" | "skip" | "step" | "undo" | "view";
  view_index?: number | null;
  reason?: string | null;
}

/** Move the pending view: turn about its own centre, then shift on the plane. */
export interface Move {
  type: "move";
  view_index: number;
  theta_rad?: number;
  u_m?: number;
  v_m?: number;
}

/** Ask how the pending view would fit if it were moved so; ``id`` comes back with the answer. */
export interface Preview {
  type: "preview";
  view_index: number;
  theta_rad?: number;
  u_m?: number;
  v_m?: number;
  id: number;
}

/** Place another connected part of the pending view, the largest being 0. */
export interface TakePart {
  type: "take_part";
  view_index: number;
  component: number;
}

/** Refine the pending view from where it lies. */
export interface Refine {
  type: "refine";
  view_index: number;
}

/** Pairs of points: of the pending view, in its own plane, and of the shape; ``fit`` moves it so. */
export interface Pairs {
  type: "pairs";
  view_index: number;
  new_uv_m: [number, number][];
  shape_uv_m: [number, number][];
  fit?: boolean;
}

/** Ask for all attributes at a place of the plane; ``id`` comes back with the answer. */
export interface Hover {
  type: "hover";
  id: number;
  u_m: number;
  v_m: number;
  sheet?: "other" | "this";
  view?: number | null;
}

/** Ask what a ray of the eye (object frame) hits first in 3D, and where that lies on the plane. */
export interface HoverRay {
  type: "hover_ray";
  id: number;
  origin_m: [number, number, number];
  direction: [number, number, number];
}

/** Let the 3D camera look from where the real camera stood at a view. */
export interface TurnTo {
  type: "turn_to";
  view_index: number;
}

/** Ask for the distance between two places of the plane; ``id`` comes back with the answer. */
export interface Measure {
  type: "measure";
  id: number;
  from_u_m: number;
  from_v_m: number;
  to_u_m: number;
  to_v_m: number;
  sheet?: "other" | "this";
}

/** Pick the cloth at (or nearest to) a place of the plane. */
export interface PickAt {
  type: "pick";
  u_m: number;
  v_m: number;
  revision?: number | null;
  sheet?: "other" | "this";
}

/** Make a pick of the list the current one, and ``keep`` it there; None: none is current. */
export interface ShowPick {
  type: "show_pick";
  id?: number | null;
  keep?: boolean;
}

/** Give a pick of the list another name. */
export interface RenamePick {
  type: "rename_pick";
  id: number;
  name: string;
}

/** Delete a pick from the list. */
export interface DeletePick {
  type: "delete_pick";
  id: number;
}

/** Change how a pick is gripped: ``axis_deg`` on the plane (u towards v) or along the outline; opening. */
export interface SetGrip {
  type: "grip";
  id: number;
  axis_deg?: number | null;
  outline?: boolean | null;
  opening_m?: number | null;
}

/** Switch Auto on or off. */
export interface SetAuto {
  type: "auto";
  running: boolean;
}

/** Change settings of the page, see ``settings.Settings``; ``reset`` first restores all defaults. */
export interface Set {
  type: "set";
  reset?: boolean;
  values?: Record<string, boolean | number | string>;
}

/** Colour the 3D scene by a layer of the flattened view. */
export interface Look {
  type: "look";
  layer: "color" | "density" | "height" | "incidence" | "place" | "source" | "stretch" | "truth" | "z_angle";
}

/** Show the newest frame of the camera, or hold the present one. */
export interface Play {
  type: "play";
  playing: boolean;
}

/** The frame of a camera is drawn: the next one may come. */
export interface Drawn {
  type: "drawn";
  revision: number;
}

/** Guided capture: begin, keep, repeat, turned, aim (at ``angle_deg``) or finish. */
export interface Capture {
  type: "capture";
  action: "aim" | "begin" | "finish" | "keep" | "repeat" | "turned";
  angle_deg?: number | null;
}

/** Give an active loop another goal: shape, kind, or points:NAME,NAME. */
export interface Aim {
  type: "aim";
  goal: string;
}

/** Say which side the cloth under a stroke on the image of a view is; ``radius_m`` on the cloth. */
export interface StrokeImage {
  type: "stroke_image";
  side: "other" | "this";
  view_index: number;
  points_rc: [number, number][];
  radius_m: number;
}

/** Say which side the cloth under a stroke on the flattened shape is. */
export interface StrokeShape {
  type: "stroke_shape";
  side: "other" | "this";
  points_uv_m: [number, number][];
  radius_m: number;
  sheet?: "other" | "this";
}

/** Paint by clicks in the 3D scene as well, or (``side`` None) pick there again. */
export interface Brush {
  type: "brush";
  side?: "other" | "this" | null;
  radius_m?: number;
}

/** Ask where strokes would settle most: the best place (0), the next ones, or (negative) those before. */
export interface WhereToStroke {
  type: "where_to_stroke";
  number?: number;
}

/** Set the kind of the garment; None: the evidence decides. */
export interface SetKind {
  type: "garment_kind";
  kind?: string | null;
}

/** Hold a named point of the garment at a place of the plane; the rest refits. */
export interface HoldPoint {
  type: "hold_point";
  name: string;
  u_m: number;
  v_m: number;
}

/** Ask how the outline would lie if a point were held so; ``id`` comes back with the answer. */
export interface PreviewPoint {
  type: "preview_point";
  name: string;
  u_m: number;
  v_m: number;
  id: number;
}

/** Let a held point go, or all of them. */
export interface ReleasePoints {
  type: "release_points";
  name?: string | null;
}

/** Pick a named point of the garment as a grasp. */
export interface PickPoint {
  type: "pick_point";
  name: string;
}

/** Compute the other side of the item, if it is not known yet. */
export interface ShowOther {
  type: "other_side";
}

/** Decide about a hypothesis: ``index`` in the list of what is in doubt at this ``revision``. */
export interface Decide {
  type: "decide";
  revision: number;
  index: number;
  how: "cut" | "hand" | "keep" | "place";
  place?: [number, number, number];
}

/** Every message that the page sends. */
export type ClientMessage =
  | Do
  | Move
  | Preview
  | TakePart
  | Refine
  | Pairs
  | Hover
  | HoverRay
  | TurnTo
  | Measure
  | PickAt
  | ShowPick
  | RenamePick
  | DeletePick
  | SetGrip
  | SetAuto
  | Set
  | Look
  | Play
  | Drawn
  | Capture
  | Aim
  | StrokeImage
  | StrokeShape
  | Brush
  | WhereToStroke
  | SetKind
  | HoldPoint
  | PreviewPoint
  | ReleasePoints
  | PickPoint
  | ShowOther
  | Decide;

/** A notification for the operator; ``time_s`` counts from the epoch. */
export interface Note {
  type: "note";
  id: number;
  level: "error" | "info" | "warning";
  text: string;
  time_s: number;
}

/** The state of the page: what the mode does not have is None, or the default. */
export interface PageState {
  type: "state";
  revision: number;
  mode: "camera" | "session";
  phase: string;
  method: string;
  recording: RecordingInfo;
  notes: string[];
  auto: AutoInfo;
  layers: Layers | null;
  pick: PickInfo | null;
  picks: ListedPick[];
  lesson: Progress | null;
  log: Note[];
  settings: Settings;
  settings_rows: Setting[];
  present_view: number | null;
  angle_deg: number | null;
  views: ViewRow[];
  actions: Action[];
  reject_reasons: string[];
  step: number;
  start_view: number | null;
  finished: string | null;
  undo: string | null;
  redo: string | null;
  request: Request | null;
  progress: Progress | null;
  pending: PendingInfo | null;
  drawing: boolean;
  trouble: string;
  review: ReviewInfo | null;
  sides: SidesInfo | null;
  garment: GarmentInfo | null;
  other: OtherSideInfo | null;
  doubts: number | null;
  capture: CaptureStatus | null;
  active: ActiveStatus | null;
}

/** The recording that is open. */
export interface RecordingInfo {
  name: string;
  description: string;
  n_views: number;
}

/** Whether Auto decides; ``waits_for`` the operator, if it does; ``ended`` by choice, and why. */
export interface AutoInfo {
  running: boolean;
  waits_for: string;
  ended: string;
}

/** The pictures of the shape; ``revision`` is part of their addresses. */
export interface Layers {
  rows: number;
  cols: number;
  pixel_size_m: number;
  origin_uv_m: [number, number];
  revision: number;
  area_cm2: number;
  pieces: FloatingPiece[];
  legends: Record<string, Legend>;
  overlay: OverlayInfo | null;
}

/** A piece that is not joined to the shape yet; ``grid`` is its place on the sheet. */
export interface FloatingPiece {
  label: string;
  file: string;
  area_cm2: number;
  reason: string;
  color: string;
  placed: boolean;
  grid: Grid;
}

/** The size of a raster of the flattened plane, and where its first pixel lies. */
export interface Grid {
  rows: number;
  cols: number;
  pixel_size_m: number;
  origin_uv_m: [number, number];
}

/** The legend of a layer; ``map``, ``low``, ``high`` and ``colors`` belong to a ramp. */
export interface Legend {
  kind: "classes" | "none" | "ramp";
  title: string;
  classes: ColorClass[];
  map: string;
  low: number;
  high: number;
  colors: string[];
}

/** A color of a legend, and what it stands for. */
export interface ColorClass {
  label: string;
  color: string;
}

/** Where the proposal lies; ``placement`` maps its own plane to the shape's. */
export interface OverlayInfo {
  rows: number;
  cols: number;
  pixel_size_m: number;
  origin_uv_m: [number, number];
  revision: number;
  view_index: number;
  center_uv_m: [number, number];
  differences: Record<string, Legend>;
  placement: Rigid2;
}

/** A rigid motion of the plane (no mirror): ``p -> R(theta) p + (u, v)``. */
export interface Rigid2 {
  theta_rad: number;
  u_m: number;
  v_m: number;
}

/** All numbers of the current pick. */
export interface PickInfo {
  id: number;
  name: string;
  side: "other" | "this";
  view_index: number;
  position_held_m: [number, number, number];
  uv_m: [number, number] | null;
  kept: boolean;
  position_camera_m: [number, number, number];
  normal_held: [number | null, number | null, number | null];
  normal_camera: [number | null, number | null, number | null];
  angle_deg: number;
  source_rc: [number | null, number | null];
  miss_m: number;
  grip: GripInfo | null;
}

/** How a pick is gripped; ``axis_deg`` is its axis on the plane, ``gripper_m`` lines that draw it. */
export interface GripInfo {
  axis_from: string;
  axis_deg: number | null;
  axis_uv: [number, number] | null;
  axis_held: [number, number, number];
  approach_held: [number, number, number];
  opening_m: number;
  gripper_m: [[number, number, number], [number, number, number]][];
  outline_distance_m: number | null;
  position_std_m: number | null;
  normal_std_deg: number | null;
  axis_std_deg: number | null;
  placement_std_m: number | null;
}

/** A pick of the list; ``uv_m`` on the plane of its ``side``, None if that does not contain it. */
export interface ListedPick {
  id: number;
  name: string;
  side: "other" | "this";
  view_index: number;
  position_held_m: [number, number, number];
  uv_m: [number, number] | null;
  kept: boolean;
}

/** How much of a computation is done, of 1, and what it does. */
export interface Progress {
  share: number;
  text: string;
}

/** The operator's settings, in the order of their dialog, which :data:`_DIALOG` describes. */
export interface Settings {
  advance: boolean;
  auto_threshold: number;
  auto_until: "all" | "views";
  auto_views: number;
  step_mm: number;
  step_deg: number;
  follow: boolean;
  show_view: boolean;
  show_shape: boolean;
  show_new: boolean;
  show_all: boolean;
  show_axis: boolean;
  show_camera: boolean;
}

/** What the dialog shows of a setting; ``options`` are values and words, numbers have a range. */
export interface Setting {
  name: string;
  title: string;
  description: string;
  default: boolean | number | string;
  low: number | null;
  high: number | null;
  step: number | null;
  options: Record<string, string>;
}

/** A view on the timeline: what was decided about it, and what it added to the shape. */
export interface ViewRow {
  index: number;
  angle_deg: number;
  state: "accepted" | "fixed" | "pending" | "rejected" | "skipped" | "start" | "unused";
  detail: string;
  score: number | null;
  why_not: string | null;
  why_not_reopen: string | null;
  flagged: boolean;
  order: number | null;
  added_cm2: number | null;
  flags: string[];
}

/** An action of the operator; ``why_not`` is the reason if it is not allowed now. */
export interface Action {
  name: string;
  title: string;
  keys: string[];
  description: string;
  group: string;
  mode: string;
  why_not: string | null;
}

/** Work that the session waits for. */
export interface Request {
  token: number;
  kind: string;
  view_index: number | null;
}

/** The proposal. What the method computes with it has a default while it is being drawn. */
export interface PendingInfo {
  view_index: number;
  side: string | null;
  score: number | null;
  why: string;
  nudge: Motion;
  pieces: PendingPart[];
  also: PlacedPartInfo[];
  extends: string | null;
  brings: JoinedPieceInfo | null;
  foreseen: Foreseen | null;
  checks: Check[];
  joins: boolean | null;
}

/** A rigid motion of the plane for reading. */
export interface Motion {
  theta_deg: number;
  u_mm: number;
  v_mm: number;
}

/** A connected part of the proposed view; ``waits``: the method found no place for it. */
export interface PendingPart {
  component: number;
  area_cm2: number;
  waits: boolean;
  chosen: boolean;
}

/** A further component that is placed with the proposal: its area, and a place on the sheet. */
export interface PlacedPartInfo {
  view_index: number;
  component: number;
  area_cm2: number;
  place_uv_m: [number, number];
}

/** The floating piece that the proposal joins to the shape, and its motion on the sheet. */
export interface JoinedPieceInfo {
  label: string;
  placement: Rigid2;
}

/** What accepting the proposal would add, and join. */
export interface Foreseen {
  added_cm2: number;
  joins: string[];
  moved_mm: number | null;
  contradicted: number | null;
}

/** A check of the proposal; ``passed`` is None if the common cloth does not decide it. */
export interface Check {
  name: string;
  title: string;
  value: number | null;
  limit: number;
  unit: string;
  passed: boolean | null;
  place_uv_m: [number, number] | null;
}

/** ``token`` changes when the pictures of the views do; ``flags`` are the texts of the views' flags. */
export interface ReviewInfo {
  token: string;
  flags: Record<string, string>;
}

/** What is known of the side of interest; ``revision`` grows with every change of the labels. */
export interface SidesInfo {
  revision: number;
  token: string;
  text: string;
  n_strokes: number;
  certainty: number | null;
  undecided_cm2: number | null;
  conflicts: string[];
  pixels_per_m: number;
}

/** What is known of the garment; ``revision`` grows with each answer, ``text`` says why there is none. */
export interface GarmentInfo {
  revision: number;
  working: boolean;
  text: string;
  kinds: string[];
  found: FoundGarment | null;
}

/** The garment: its kind (None: of no known kind), dimensions, outline and named points. */
export interface FoundGarment {
  kind: string | null;
  likeliest: string;
  by_hand: boolean;
  doubted: boolean;
  probabilities: [string, number][];
  dimensions: Dimension[];
  outline_uv_m: [number, number][];
  points: GarmentPointInfo[];
  upright_rad: number;
}

/** A dimension of the garment and its standard deviation. */
export interface Dimension {
  name: string;
  mm: number;
  std_mm: number;
}

/** A named point of the garment; ``xyz_m`` is None if no view saw its cloth. */
export interface GarmentPointInfo {
  name: string;
  uv_m: [number, number];
  std_mm: number;
  seen: boolean;
  held: boolean;
  xyz_m: [number | null, number | null, number | null] | null;
}

/** The other side of the item; ``layers`` None: it is not computed, ``text`` says why. */
export interface OtherSideInfo {
  revision: number;
  working: boolean;
  progress: Progress | null;
  text: string;
  layers: Layers | null;
  is_related: boolean;
  reliable_share: number | null;
}

/** The status of the camera and of a guided capture. */
export interface CaptureStatus {
  camera: string;
  camera_fps: number;
  playing: boolean;
  ended: string | null;
  warnings: string[];
  folder: string;
  phase: string;
  step_deg: number;
  hold_s: number;
  frames: number;
  target_deg: number;
  turn_by_deg: number;
  taken: number;
  still_s: number;
  speed_px_s: number | null;
  announced: boolean;
  kept_deg: number[];
  view: CapturedView | null;
}

/** The view that was captured last. */
export interface CapturedView {
  number: number;
  angle_deg: number;
  frames: number;
  noise_mm: number;
  warnings: string[];
}

/** The state of an active loop; ``angle_deg`` is the next one, None at the ``end`` or while it waits. */
export interface ActiveStatus {
  goal: string;
  budget: string;
  folder: string;
  views: number;
  knows: string;
  angle_deg: number | null;
  turn_deg: number | null;
  why: string;
  end: string | null;
  waiting: string;
  turning: boolean;
  is_simulated: boolean;
  steps: Record<string, any>[];
}

/** The values under the pointer, of the shape and of the proposal, and the place in a source image. */
export interface HoverAnswer {
  type: "hover";
  id: number;
  shape: PixelValues | null;
  proposal: PixelValues | null;
  source: SourcePlace | null;
}

/** All values of a pixel of the flattened view. */
export interface PixelValues {
  rc: [number, number];
  uv_mm: [number, number];
  rgb: [number, number, number];
  xyz_mm: [number, number, number];
  height_mm: number;
  normal: [number | null, number | null, number | null];
  z_angle_deg: number | null;
  z_angle_now_deg: number | null;
  view_index: number;
  source_rc: [number | null, number | null];
  density_px_cm2: number | null;
  incidence_deg: number | null;
  stretch: number | null;
  placement_std_mm: number | null;
  error_mm: number | null;
}

/** A pixel of the source image of a view. */
export interface SourcePlace {
  view_index: number;
  rc: [number | null, number | null];
}

/** What a ray of the 3D scene hits first, and where that lies on the plane of a side; None: nothing. */
export interface RayAnswer {
  type: "hover_ray";
  id: number;
  xyz_m: [number, number, number] | null;
  uv_m: [number, number] | null;
  sheet: "other" | "this";
}

/** A new pick is stored, on a side of the item and its plane; its numbers follow with the state. */
export interface Picked {
  type: "picked";
  id: number;
  position_held_m: [number, number, number];
  side: "other" | "this";
  uv_m: [number, number];
}

/** A distance: on the plane, along the cloth and through the air. ``path_uv_m`` follows the cloth. */
export interface Measured {
  type: "measured";
  id: number;
  flat_mm: number;
  cloth_mm: number | null;
  air_mm: number | null;
  path_uv_m: [number, number][];
}

/** The score of a moved proposal, and that after refinement; ``why`` says why there is none. */
export interface PreviewAnswer {
  type: "preview";
  id: number;
  why: string;
  score: number | null;
  apart_mm: number | null;
  refined_score: number | null;
  refined_apart_mm: number | null;
}

/** The residuals of pairs of points, before and after the motion that fits them. */
export interface PairsAnswer {
  type: "pairs";
  residual_mm: number[];
  fitted_mm: number[];
  rms_mm: number;
}

/** The outline and the named points of the garment while a point is dragged. */
export interface GarmentPreview {
  type: "garment_preview";
  id: number;
  outline_uv_m: [number, number][];
  points: GarmentPointInfo[];
}

/** The view and the pixel where the next stroke settles most; None: nowhere, ``text`` says why. */
export interface StrokeAdvice {
  type: "where_to_stroke";
  view_index: number | null;
  rc: [number, number] | null;
  text: string;
  number: number;
}

/** Another recording was opened; the tab connects again. */
export interface Switched {
  type: "switched";
}

/** The result of a session; ``revision`` 0: there is none yet, ``trouble`` says what failed. */
export interface ResultInfo {
  revision: number;
  trouble: string;
  result: Result | null;
}

/** The result of an integration; ``uncertainty`` and ``wrong`` as in ``outcome.json``. */
export interface Result {
  uncertainty: Record<string, number>;
  left_out: LeftOut[];
  more: More;
  wrong: string[];
}

/** Visible cloth that is neither in the shape nor in a floating piece, with the reason. */
export interface LeftOut {
  view_index: number;
  area_m2: number;
  reason: string;
}

/** The expected gain of further views. */
export interface More {
  reason: string;
  expected: [number, number][];
  share: number | null;
}

/** What speaks for and against a proposal. */
export interface DiagnosticsInfo {
  reasons: Reasons;
  pairs: ShownPairs | null;
}

/** The quantities of the paper's section 4 for a pending view. */
export interface Reasons {
  view_index: number;
  side: "left" | "right";
  front_view: number;
  turn_deg: number;
  correspondence: Correspondence | null;
  trouble: string;
  current_from_new: Rigid2;
  pairs: ClothPairs | null;
}

/** The initial estimate and its derivation (paper, Fig. 4d, e). */
export interface Correspondence {
  rotation_deg: number;
  current_curves: ColumnCurves;
  new_curves: ColumnCurves;
  common_range_deg: [number, number];
  a_m_deg: number;
  current: ZAngleLine;
  new: ZAngleLine;
  height_m: number;
}

/** The curves over the columns of a flattened view (paper, Fig. 4a). */
export interface ColumnCurves {
  u_m: any[];
  column_count: any[];
  column_mean_z_angle_deg: any[];
  pixel_size_m: number;
}

/** Pixels of one Z-angle in a flattened view and their principal axis. */
export interface ZAngleLine {
  z_angle_deg: number;
  pixels_uv_m: any[];
  center_uv_m: any[];
  direction: any[];
  point_uv_m: any[];
}

/** The same cloth in a component of a view and in the shape: what fixes the component's place. */
export interface ClothPairs {
  shape_uv_m: any[];
  new_uv_m: any[];
  shape_xyz_m: any[];
  new_xyz_m: any[];
}

/** Pairs of the same cloth, evenly chosen, and the statistics of all pairs. */
export interface ShownPairs {
  total: number;
  median_mm: number;
  nine_tenths_mm: number;
  beyond_share: number;
  limit_mm: number;
  apart_median_mm: number;
  shape_uv_m: [number, number][];
  placed_uv_m: [number, number][];
  shape_xyz_m: [number, number, number][];
  new_xyz_m: [number, number, number][];
  residual_mm: number[];
  apart_mm: number[];
}

/** The views that saw a pick, and how many of the others did not, by the reason. */
export interface SeenViews {
  seen: SeenView[];
  n_views: number;
  hidden: Record<string, number>;
}

/** A view that saw a pick: the pixel, and the image around it as a data URL. */
export interface SeenView {
  view_index: number;
  angle_deg: number;
  rc: [number, number];
  thumb: string;
}

/** The part of an image that shows the item, pixels, also where its side is not decided. */
export interface ItemBox {
  top: number;
  left: number;
  height: number;
  width: number;
}

/** The answer of ``/doubts/REVISION.json``: the joints first, the weakest before the others. */
export interface DoubtsInfo {
  revision: number;
  trouble: string;
  doubts: Doubt[];
  this_outline_uv_m: [number, number][][];
  other_outline_uv_m: [number, number][][];
}

/** A hypothesis about the shape: a joint that holds a part, a floating piece, or a seam of both sides. */
export interface Doubt {
  kind: "joint" | "piece" | "seam";
  title: string;
  said: string;
  note: string;
  views: HeldByView[];
  choices: Choice[];
  area_cm2: number;
  length_mm: number;
  probability: number;
  side: "other" | "this";
  weak: boolean;
  is_apart: boolean;
  outline_uv_m: [number, number][][];
  pivot_uv_m: [number, number];
  arm_uv_m: [number, number];
  ends_uv_m: [[number, number], [number, number]][];
  length_m: number[];
  this_uv_m: [number, number][];
  other_uv_m: [number, number][];
  seam_xyz_m: [number, number, number][];
  part_xyz_m: [number, number, number][];
}

/** What a view sees of what holds cloth: places, median residual (None: unknown), their pixels. */
export interface HeldByView {
  view_index: number;
  angle_deg: number;
  places: number;
  residual_mm: number | null;
  rc: [number, number][];
}

/** How a hypothesis can be decided: what is true then, what deciding it does, and where its cloth lies. */
export interface Choice {
  how: "cut" | "hand" | "keep" | "place";
  title: string;
  decide: string;
  probability: number | null;
  placement: Rigid2;
  std_mm: number | null;
}

/** Every message that the server sends as text. */
export type ServerMessage =
  | Note
  | PageState
  | HoverAnswer
  | RayAnswer
  | Picked
  | Measured
  | PreviewAnswer
  | PairsAnswer
  | GarmentPreview
  | StrokeAdvice
  | Switched;
