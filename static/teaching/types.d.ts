// The types of the teaching mode, known to its modules without an import: lessons as the server sends them, stages.

import type { Pane as PaneClass, Sheet as SheetClass } from "./draw.js";
import type { Teaching as TeachingClass } from "./teaching.js";

declare global {
  type Sheet = SheetClass;
  type Pane = PaneClass;
  type Teaching = TeachingClass;
  type NumberArray = Int8Array | Uint8Array | Int16Array | Uint16Array | Int32Array | Float32Array;
  type PartName = "flattening" | "start" | "planning" | "alignment" | "sides" | "garment" | "check" | "shape";
  type ParameterName = "sampling_interval_px" | "z_angle_limit_deg" | "overlap_cm2";
  type LessonParameters = Record<ParameterName, number>;

  type TextLook = {
    color?: string;
    size?: number;
    weight?: number;
    align?: "left" | "center" | "right";
    baseline?: CanvasTextBaseline;
    plate?: boolean;
  };
  /** The key of the pane, and labels; without one for x, that axis is not written. */
  type PlotOptions = {
    log?: boolean;
    key?: string;
    xLabel?: string;
    yLabel?: string;
    color?: string;
  };
  type PaneOptions = { margin?: number; stretch?: boolean; bar?: boolean };
  /** An arrow at a Z-angle, seen from above. */
  type Arrow = { deg: number; label: string; color: string; dash?: number[] };
  type Possibility = { name: string; probability: number; color?: string };

  type Fact = [name: string, value: string];
  /** What a stage draws, and its facts; what it says is in stages.html. */
  type StageCode<L> = {
    /** Draw where the learner points to, at a time of the animation; returns the facts. */
    draw: (sheet: Sheet, rect: Rect, lesson: L, ui: { at: UV; time: number }) => Fact[];
    /** The key of the pane that is probed, and where the probe begins. */
    probe?: string;
    start?: (lesson: L) => UV;
    /** The last time of its animation. */
    plays?: (lesson: L) => number;
  };
  type Stage = StageCode<any> & { about: HTMLElement; name: string; part: PartName; parameters: ParameterName[] };
  /** What is known of a part: the lesson, or why there is none, and what it was asked for with. */
  type KnownPart = { key: string; lesson: any; error: string | null };
  type Running = { part: PartName; key: string; abort: AbortController; since: number };
  type Lesson = {
    array: Record<string, Float32Array>;
    picture: Record<string, Drawable>;
    parameters: LessonParameters;
    defaults?: LessonParameters;
    angles_deg: number[];
    start_view: number;
    view_index: number;
  };
  /** What the page has of the session: its shape, and the joints that are in doubt. */
  type ShapeLesson = {
    picture: Record<string, Drawable>;
    grid: Grid;
    joints: import("../page/messages").Doubt[];
    seams: import("../page/messages").Doubt[];
    /** Of this side, and of the other one. */
    outlines: [this: UV[][], other: UV[][]];
    area_cm2: number;
    views: number;
  };
  /** A level of the minimisation: the states of its samples on the plane, and the pairs between them (metres). */
  type Course = { energy: Float32Array; states: Float32Array[]; pairs: Numbers; length: Float32Array };
  type FlatteningLesson = Lesson & { flat: Grid; area_cm2: number; folded_share: number; pixel_pitch_mm: number };
  type StartLesson = Lesson & { flat: Grid; tried: { view: number; part_cm2: number }[] };
  /** A curve over the columns; null where there is none. */
  type Curves = { u_m: number[]; column_count: number[]; column_mean_z_angle_deg: (number | null)[] };
  type PlannedSide = {
    side: "left" | "right";
    curves: Curves;
    a_0_deg: number | null;
    u_b_m: number | null;
    rotation_deg: number | null;
    occluding_edge_m: number;
  };
  type PlanningLesson = Lesson & {
    flat: Grid;
    plan: { view_index: number | null; side: "left" | "right" | null; reason: string; sides: PlannedSide[] };
    z_angle_colors: RGB[];
    z_angle_span_deg: number;
  };
  type LessonLine = { pixels_uv_m: UV[]; center_uv_m: UV; direction: UV; point_uv_m: UV };
  type AlignmentLesson = Lesson & {
    planned_view: number;
    current: Grid;
    new: Grid;
    renewed: Grid;
    current_cm2: number;
    renewed_cm2: number;
    initial_score: { total: number } | null;
    start_stands: boolean;
    /** The placements that the search led through. */
    motions: Motion[];
    search: {
      turns_rad: number[];
      shifts_m: number[];
      /** By turn, shift in u, and shift in v. */
      cost: number[][][];
      starts: XYZ[];
      path: XYZ[];
      tried: number;
      end_score: number;
    };
    lines: {
      current: LessonLine;
      new: LessonLine;
      current_curves: Curves;
      new_curves: Curves;
      a_m_deg: number;
      common_range_deg: UV;
      rotation_deg: number;
    } | null;
  };
  type SidesLesson = Lesson & {
    first: { rows: number; cols: number };
    n_alike: number;
    n_opposite: number;
    certainty: number;
    found_cm2: number;
    undecided_cm2: number;
  };
  type GarmentLesson = Lesson & {
    flat: Grid | null;
    edges_m: number;
    energy: number[][];
    kinds: { name: string; probability: number; below: number }[];
    none: number;
  };
  type CheckLesson = Lesson & {
    first: number;
    second: number;
    recorded_deg: number;
    seen_deg: number;
    std_deg: number;
    turn_deg: number[];
    share: number[];
  };
}
