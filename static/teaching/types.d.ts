// The types of the teaching mode, known to its modules without an import: lessons as the server sends them, stages.

import type { PaneMap as PaneMapClass, Sheet as SheetClass } from "./draw.js";
import type { Plot as PlotClass } from "./plot.js";
import type { Teaching as TeachingClass } from "./teaching.js";

declare global {
  type Sheet = SheetClass;
  type Plot = PlotClass;
  type Teaching = TeachingClass;
  type NumberArray = Int8Array | Uint8Array | Int16Array | Uint16Array | Int32Array | Float32Array;
  type PartName = "flattening" | "start" | "planning" | "alignment" | "sides" | "garment" | "seams" | "check" | "shape";
  type ParameterName = "sampling_interval_px" | "z_angle_limit_deg" | "overlap_cm2";

  /** From a pane's own units to CSS pixels. */
  type PictureMap = { at(u: number, v: number): UV };
  type PaneMap = PaneMapClass;
  type SheetHandlers = { redraw: () => void; probe: (pane: string, at: UV) => void };
  type TextLook = {
    color?: string;
    size?: number;
    weight?: number;
    align?: "left" | "center" | "right";
    baseline?: CanvasTextBaseline;
    plate?: boolean;
  };
  type PlotOptions = {
    x: UV;
    y: UV;
    /** A second scale at the right. */
    y2?: UV | null;
    log?: boolean;
    xLabel?: string;
    yLabel?: string;
    y2Label?: string;
    yColor?: string;
    y2Color?: string;
    yTicks?: number[];
    xAxis?: boolean;
  };
  /** An arrow at a Z-angle, seen from above. */
  type Arrow = { deg: number; label: string; color: string; dash?: number[] };

  /** What the learner has chosen: place, layer, time of the animation, parameters. */
  type Ui = { at: UV; layer: string; time: number; parameters: Record<ParameterName, number> };
  type Fact = [name: string, value: string];
  type StageDrawing = (sheet: Sheet, rect: Rect, lessons: Lessons, ui: Ui) => void;
  /** What a stage draws and tells of the lesson; what it says is in paper.html or beyond.html. */
  type StageCode = {
    facts: (lessons: Lessons, ui: Ui) => (Fact | null)[];
    draw: StageDrawing;
    layers?: Record<string, string>;
    /** The key of the pane that is probed, and where the probe begins. */
    probe?: string;
    start?: (lessons: Lessons) => UV;
    /** The last time of its animation. */
    plays?: (lessons: Lessons) => number;
    /** What its formulas take from the lesson, by data-value. */
    values?: (lessons: Lessons) => Record<string, string>;
  };
  type Stage = StageCode & { about: HTMLElement; name: string; part: PartName; parameters: ParameterName[] };
  /** What is known of a part: the lesson, or why there is none; `abort` while it is being made. */
  type Entry = {
    /** The parameters it was asked for with. */
    key: string | null;
    lesson: Lesson | null;
    error: string | null;
    abort: AbortController | null;
    promise?: Promise<void>;
    since?: number;
  };
  /** What the teaching mode asks of the page; `garment` and `other` are the revisions of what is known of them. */
  type Session = {
    actions: () => ActionRow[];
    name: () => string;
    startView: () => number | null;
    views: () => number;
    progress: () => State["lesson"];
    garment: () => number;
    other: () => number;
    findOther: () => unknown;
    /** Null until it is known. */
    shape: () => ShapeLesson | null;
    run: (name: string) => void;
  };
  type Lessons = {
    flattening: FlatteningLesson;
    start: StartLesson;
    planning: PlanningLesson;
    alignment: AlignmentLesson;
    sides: SidesLesson;
    garment: GarmentLesson;
    seams: SeamsLesson;
    check: CheckLesson;
    shape: ShapeLesson;
  };
  /** What the page has of the session: its shape, and the joints that are in doubt. */
  type ShapeLesson = Lesson & {
    grid: Grid;
    joints: import("../page/messages").JointInfo[];
    area_cm2: number;
    views: number;
  };
  type CheckLesson = Lesson & { other_view: number; recorded_deg: number; seen_deg: number; std_deg: number };
  type Lesson = {
    array: Record<string, Float32Array>;
    picture: Record<string, Drawable>;
    parameters: Record<ParameterName, number>;
    defaults: Record<ParameterName, number>;
    sliders: Record<ParameterName, { low: number; high: number; step: number }>;
    view_index: number;
    side?: "left" | "right" | null;
  };
  /** A level of the minimisation: its samples, and their states on the plane. */
  type Level = {
    name: string;
    points: number;
    main_points: number;
    pairs: number;
    unused: number;
    parts: number;
    interval_px: number;
    mean_length_mm: number | null;
    energy_mm2: number[];
    state_iterations: number[];
    xy: Float32Array;
    edges: Numbers;
    unusedPairs: Numbers;
    members: Numbers;
    mainEdges: Int32Array;
    mainLength: Float32Array;
    states: Float32Array[];
    local: Int32Array;
  };
  type FlatteningLesson = Lesson & {
    angles_deg: number[];
    levels: Level[];
    flat: Grid;
    area_cm2: number;
    depth_mm: number;
    folded_share: number;
    parts_cm2: number[];
    pixel_pitch_mm: number;
    surface_px: number;
    triangles: number;
  };
  type StartLesson = Lesson & {
    angles_deg: number[];
    flat: Grid;
    session_view: number | null;
    tried: { view: number; part_cm2: number }[];
  };
  type PlannedSide = {
    side: "left" | "right";
    a_0_deg: number | null;
    u_b_mm: number | null;
    rotation_deg: number | null;
    view_index: number | null;
    occluding_edge_mm: number;
  };
  type PlanningLesson = Lesson & {
    flat: Grid;
    angles_deg: number[];
    next_view: number | null;
    reason: string;
    sides: PlannedSide[];
    z_angle_colors: RGB[];
    z_angle_span_deg: number;
  };
  type LessonLine = { center_uv_m: UV; direction: UV; point_uv_m: UV };
  type AlignmentLesson = Lesson & {
    angles_deg: number[];
    start_view: number;
    planned_view: number;
    current: Grid;
    new: Grid;
    renewed: Grid;
    current_cm2: number;
    new_cm2: number;
    renewed_cm2: number;
    placed_with: number;
    initial: Motion;
    found: Motion;
    initial_score: number;
    score_parts: { height_rms_mm: number; overlap_cm2: number };
    search: {
      turns_deg: number[];
      shifts_mm: number[];
      motions: Motion[];
      tried: number;
      start_stands: boolean;
      end_score: number;
    };
    lines: {
      current: LessonLine;
      new: LessonLine;
      a_m_deg: number;
      common_range_deg: UV;
      height_mm: number;
      rotation_deg: number;
    } | null;
  };
  type SidesLesson = Lesson & {
    first: { rows: number; cols: number };
    n_alike: number;
    n_opposite: number;
    samples: number;
    certainty: number;
    found_cm2: number;
    undecided_cm2: number;
  };
  type SeamsLesson = Lesson & {
    this_cm2: number;
    other_cm2: number;
    this_floating: number;
    other_floating: number;
    residual_mm: number | null;
    seams: { start: number; places: number; why: string }[];
  };
  type GarmentLesson = Lesson & {
    flat: Grid | null;
    area_cm2: number;
    edges_m: number;
    unseen_m: number;
    trust: number | null;
    energy: number[][];
    widened: number[];
    state_shape: [steps: number, starts: number, vertices: number];
    kinds: { name: string; probability: number; below: number | null; parameters: number }[];
    none: number;
    misfit: number;
    misfit_limit: number;
    temperature: number;
  };
}
