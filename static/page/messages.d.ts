// Made by flatcloth/viewer/protocol/typescript.py from messages.py; not to be edited.

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

/** Lay the pending view where one of its hypotheses says; ``index`` 0 is the best. */
export interface Choose {
  type: "choose";
  view_index: number;
  index: number;
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

/** Refine the pending view from where it lies. */
export interface Refine {
  type: "refine";
  view_index: number;
}

/** Place a floating piece by hand: the view that shows most of it becomes the proposal, where it lies. */
export interface PlacePiece {
  type: "place_piece";
  label: string;
}

/** Place another connected part of the pending view, the largest being 0. */
export interface TakePart {
  type: "take_part";
  view_index: number;
  component: number;
}

/** Leave out a part that would be placed with the pending view: a component of ``part_view``. */
export interface LeaveOut {
  type: "leave_out";
  view_index: number;
  part_view: number;
  component: number;
}

/** Pairs of points: of the pending view, in its own plane, and of the shape; ``fit`` moves it so. */
export interface Pairs {
  type: "pairs";
  view_index: number;
  new_uv_m: [number, number][];
  shape_uv_m: [number, number][];
  weights: number[];
  fit?: boolean;
}

/** Ask for all attributes at a place of the plane; ``id`` comes back with the answer. */
export interface Hover {
  type: "hover";
  id: number;
  u_m: number;
  v_m: number;
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
}

/** Pick the cloth at (or nearest to) a place of the plane. */
export interface PickAt {
  type: "pick";
  u_m: number;
  v_m: number;
  revision?: number | null;
}

/** Make a pick of the list the current one; None: none is current. */
export interface ShowPick {
  type: "show_pick";
  id?: number | null;
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

/** Change settings of the page, see ``settings.SETTINGS``; ``reset`` first restores all defaults. */
export interface Set {
  type: "set";
  reset?: boolean;
  auto_threshold?: number | null;
  advance?: boolean | null;
  follow?: boolean | null;
  turn_to_pick?: boolean | null;
  step_mm?: number | null;
  step_deg?: number | null;
}

/** Draw the edges that the flattening strained in the 3D scene as well, or not. */
export interface ShowEdges {
  type: "edges";
  show: boolean;
}

/** Colour the 3D scene by a layer of the flattened view, with its colour map and window. */
export interface Look {
  type: "look";
  layer: "color" | "density" | "height" | "incidence" | "place" | "source" | "stretch" | "z_angle";
  map?: string | null;
  low?: number;
  high?: number;
}

/** Live mode: play or pause, turn round, change the rate, or show a frame by hand. */
export interface Play {
  type: "play";
  playing?: boolean | null;
  forward?: boolean | null;
  fps?: number | null;
  frame?: number | null;
  step?: number | null;
}

/** Live mode: the tab has drawn what it was sent, and takes the next frame with this layer. */
export interface Ready {
  type: "ready";
  layer: string;
}

/** Guided capture: begin, keep, repeat, turned, aim (at ``angle_deg``) or finish. */
export interface Capture {
  type: "capture";
  action: "aim" | "begin" | "finish" | "keep" | "repeat" | "turned";
  angle_deg?: number | null;
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
}

/** Say that the cloth beyond a line on the flattened shape is not of interest. */
export interface CutShape {
  type: "cut_shape";
  points_uv_m: [number, number][];
  beyond_uv_m: [number, number];
}

/** Paint by clicks in the 3D scene as well, or (``side`` None) pick there again. */
export interface Brush {
  type: "brush";
  side?: "other" | "this" | null;
  radius_m?: number;
}

/** Ask where the next stroke tells most. */
export interface WhereToStroke {
  type: "where_to_stroke";
}

/** Say which kind the garment is; None: let the evidence say. */
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

/** Let a held point go, or all of them. */
export interface ReleasePoints {
  type: "release_points";
  name?: string | null;
}

/** Lay a floating piece where the garment has a place for it, or refuse that place. */
export interface DecidePiece {
  type: "decide_piece";
  label: string;
  accepted: boolean;
}

/** Take a part off, or keep it: ``index`` in the list of doubted links at this ``revision``. */
export interface DecideLink {
  type: "decide_link";
  revision: number;
  index: number;
  taken_off: boolean;
}

/** Ask how the outline would lie if a point were held so; ``id`` comes back with the answer. */
export interface PreviewPoint {
  type: "preview_point";
  name: string;
  u_m: number;
  v_m: number;
  id: number;
}

/** Pick a named point of the garment as a grasp. */
export interface PickPoint {
  type: "pick_point";
  name: string;
}

/** All that the page may say to the server. */
export type ClientMessage = Do
  | Move
  | Choose
  | Preview
  | Refine
  | PlacePiece
  | TakePart
  | LeaveOut
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
  | ShowEdges
  | Look
  | Play
  | Ready
  | Capture
  | StrokeImage
  | StrokeShape
  | CutShape
  | Brush
  | WhereToStroke
  | SetKind
  | HoldPoint
  | ReleasePoints
  | DecidePiece
  | DecideLink
  | PreviewPoint
  | PickPoint;
