// The types of the exported page, known to its modules without an import.

import type { Cloth } from "./data.js";
import type { OfflinePage as OfflinePageClass } from "./offline.js";

declare global {
  type OfflinePage = OfflinePageClass;
  type OfflineLayer = { name: string; title: string; about: string; legend: Legend; start: number; count: number };
  type OfflinePick = Omit<ListedPick, "id" | "uv_m" | "kept"> & {
    id: number | null;
    uv_m: UV | null;
    rc: UV | null;
    normal_held: number[];
    z_angle_deg: number | null;
    source_rc: number[];
    miss_m?: number;
    grip: CurrentPick["grip"];
  };
  type OfflineStep = {
    order: number;
    view_index: number;
    angle_deg: number;
    added_cm2: number;
    area_cm2: number;
    floating_cm2: number;
    told: string;
    camera_m: XYZ;
  };
  /** A side of the item: the part of its grid that has cloth, and how many pixels. */
  type OfflineSide = { grid: Grid & { corner_rc: [number, number] }; count: number; layers: OfflineLayer[]; pieces: Piece[] };
  /** The texts and numbers of the page. */
  type OfflineHistory = OfflineSide & {
    recording: { name: string; description: string; angles_deg: number[] };
    method: string;
    finished: string | null;
    bounds: { low: XYZ; step: number };
    extent: { low: XYZ; high: XYZ };
    half_extents_m: [number, number];
    axis: { line: [XYZ, XYZ]; direction: XYZ; across: [XYZ, XYZ] };
    around: { start: number; count: number }[];
    around_spacing_m: number;
    steps: OfflineStep[];
    other: (OfflineSide & { is_related: boolean; area_cm2: number }) | null;
    picks: OfflinePick[];
    decisions: { view_index: number; angle_deg: number; verdict: string; told: string; stands: boolean; step: number }[];
    garment: { text: string; found: FoundGarment | null };
    arrays: Record<string, { kind: string; start: number; count: number }>;
  };
  /** What a parcel holds, by name. */
  type Parts = { arrays: Record<string, NumberArray>; pictures: Record<string, Blob> };
  type Around = { xyz: Float32Array; rgb: Uint8Array };
  type OfflineData = {
    history: OfflineHistory;
    layers: Record<string, OfflineLayer & { pixels: Uint8ClampedArray }>;
    cloth: Cloth;
    other: { layers: OfflineData["layers"]; cloth: Cloth } | null;
    around: Around[];
  };
  type CloudScene = {
    cloth: Cloth;
    around: Around[];
    axis: { direction: XYZ; line: [XYZ, XYZ] };
    cameras: XYZ[];
    center: number[];
    halfExtents: [number, number];
    spacing: number;
    start: number;
  };
  type CloudMark = { point: XYZ; gripper: [XYZ, XYZ][] | null } | null;
  type Eye = Record<"x" | "y" | "z" | "yaw" | "pitch" | "distance" | "zoom", number>;
}
