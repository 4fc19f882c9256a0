"""How many markers of a kit are read, how exactly, and if any is wrong; ``validate`` beside ``evaluate``.

Of recordings by ``flatcloth synthesize MESH --texture kit.json --out DIR``; faults are made in them.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.inputs import Remembered, measure_each
from benchmarks.output import Options, Row
from flatcloth.engine.evaluation import OtherTruth, compare
from flatcloth.recordings import open_recording
from flatcloth.recordings.base import altered, images_of
from flatcloth.recordings.truth import TrueView, Truth
from flatcloth.validation.adjustment import adjusted
from flatcloth.validation.kit import Kit, read_kit
from flatcloth.validation.markers import terms
from flatcloth.validation.validate import Validation, validate

MOST_FACING_DEG = 55.0
"""Markers that face the camera within this angle are asked for."""
NEAR_M, WRONG_PX = 0.0025, 6.0
"""A place is seen if a pixel's place on the cloth is as near; a marker further off than this is a wrong id.
Chosen: a pixel seen at 55 degrees, and a quarter of a cell of 30 mm at 0.85 m."""
FAULTS = (
    *(("none", 0.0), ("depth", -2.0), ("depth", 1.5), ("depth", -1.0), ("focal length", 3.0)),
    *(("focal length", -2.0), ("axis", 5.0), ("axis", 3.0), ("angles", 1.0), ("angles", 0.7)),
)
"""Faults that are made, by their names in ``adjusted``, and their sizes in its units."""
GRID = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 5)] * 2), axis=-1).reshape(-1, 2)


def run(options: Options) -> None:
    measure_each("validation", measured, options)


def measured(name: str) -> list[Row]:
    recording, truth = Remembered(open_recording(name)), Truth(name)
    kit = read_kit(Path(name) / "kit.json")
    found = validate(recording, kit, sides="both" if len({*kit.sheet.values()}) > 1 else "one")
    return [{"recording": recording.name} | markers_of(found, truth, kit) | compared(found, recording, truth)]


def markers_of(found: Validation, truth: Truth, kit: Kit) -> Row:
    """Return how many markers are read, and by how many pixels corners that face the camera are off."""
    row = dict.fromkeys(("facing", "read_of_facing", "found", "wrong"), 0)
    off_px = [np.zeros((0, 4))]
    for n in range(len(truth)):
        places = true_places(truth[n], kit)
        facing = {i for i, (_, angle, is_whole) in places.items() if is_whole and angle <= MOST_FACING_DEG}
        off = {
            i: np.linalg.norm(corners - places[i][0], axis=1) if i in places else np.full(4, np.inf)
            for i, corners in found.seen.of_view(n).items()
        }
        right = {i for i in off if np.median(off[i]) < WRONG_PX}
        row["facing"] += len(facing)
        row["read_of_facing"] += len(facing & right)
        row["found"] += len(off)
        row["wrong"] += len(off) - len(right)
        off_px += [off[i][None] for i in facing & right]
    every_px = np.concatenate(off_px)
    return row | {"median_px": float(np.median(every_px)), "rms_px": float(np.sqrt(np.mean(every_px**2)))}


def compared(found: Validation, recording: Any, truth: Truth) -> Row:
    """Return errors by the kit and by the truth, of the same pixels too, and the sizes found of faults."""
    row: Row = {"shown": found.document["shape"]["shown"]}
    unmasked = altered(recording, read=lambda n: images_of(recording[n])._replace(mask=None))
    for by_kit in found.document["pieces"]:
        side, _, piece = by_kit["piece"].partition(",")
        if not piece:
            its_truth = truth if side == "this side" else OtherTruth(truth, len(recording))
            view = found.shape[side]
            for of, valid in (("", view.valid), ("shown_", found.truth.compared(view)[0])):
                true = compare(replace(view, valid=valid), its_truth, unmasked)
                for key in ("median_mm", "p95_mm"):
                    row[f"{side} {of}{key}"] = [by_kit[of + key], getattr(true, f"absolute_{key}")]
    axis, angles = recording.rotation_axis, np.array(recording.angles_deg)
    for fault, size in FAULTS:
        factor = 1 + size / 100
        scales = {"depth": factor, "focal length": np.array([1 / factor, 1 / factor, 1.0])}
        seen = replace(found.seen, corners_m=found.seen.corners_m * scales.get(fault, 1.0))
        aside_m = (fault == "axis") * size * np.array([0.0006, 0.0, 0.0008])
        off_deg = (fault == "angles") * size * (-1.0) ** np.arange(len(angles))
        its_axis = replace(axis, point_m=axis.point_m + aside_m)
        cell = its_axis, recording.held_point_m, (angles + off_deg).tolist()
        errors, _ = adjusted(seen, found.truth.kit, *cell)
        row[f"{fault} {size:g}"] = {
            e["name"]: [round(e["size"], 2), round(e["std"], 2), e["is_fault"]] for e in errors
        }
    return row


def true_places(view: TrueView, kit: Kit) -> dict[int, tuple[np.ndarray, float, bool]]:
    """Return the true corners (4, 2) of markers in a view, their angles to the camera, and if all is seen.

    Around a marker, pixels are a function of second order of the places on the cloth. The singular values
    of its slope have the ratio of the cosine of the angle.
    """
    places: dict[int, tuple[np.ndarray, float, bool]] = {}
    for sheet in (1, 2):
        row, col = np.nonzero((view.panel == sheet) & view.outer_face)
        if len(row) < 6:
            continue
        uv = view.flat_uv_m[row, col].astype(float)
        tree = cKDTree(uv)
        for i in (i for i in kit.corners_m if kit.sheet[i] == sheet):
            corners = kit.corners_m[i] - np.array(kit.size_mm) / 2e3
            middle, sides = corners.mean(axis=0), corners[[1, 3]] - corners[0]
            own = np.array(tree.query_ball_point(middle, 0.75 * np.linalg.norm(sides[0])), dtype=int)
            if len(own) < 20:
                continue
            is_whole = bool((tree.query(corners[0] + GRID @ sides)[0] < NEAR_M).all())
            pixels = np.stack([col[own], row[own]], axis=1).astype(float)
            map_px = np.linalg.lstsq(terms(uv[own] - middle), pixels, rcond=None)[0]
            stretch = np.linalg.svd(map_px[1:3], compute_uv=False)
            angle_deg = float(np.degrees(np.arccos(stretch[1] / stretch[0])))
            places[i] = terms(corners - middle) @ map_px, angle_deg, is_whole
    return places
