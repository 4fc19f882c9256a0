"""How many markers of a kit are read, how exactly, and if any is wrong; ``validate`` beside ``evaluate``.

Of recordings by ``flatcloth synthesize MESH --texture kit.json --out DIR``; faults are made in them.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.inputs import Remembered
from benchmarks.output import Options, save, say
from flatcloth.engine.evaluation import compare
from flatcloth.engine.results.sides_truth import OtherTruth
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
GRID = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 5)] * 2), axis=-1).reshape(-1, 2)


def run(options: Options) -> None:
    rows, off_px, errors = [], [], []
    for name in options.recordings:
        recording, truth = Remembered(open_recording(name)), Truth(name)
        kit = read_kit(Path(name) / "kit.json")
        found = validate(recording, kit, sides="both" if len({*kit.sheet.values()}) > 1 else "one")
        row, off = markers_of(found, truth, kit)
        rows.append({"recording": recording.name} | row)
        off_px.append(off)
        errors.append({"recording": recording.name} | compared(found, recording, truth))
        say(f"{rows[-1]} {errors[-1]}")
    total = {key: sum(row[key] for row in rows) for key in ("facing", "read_of_facing", "found", "wrong")}
    total |= {"recording": "all", **spread(np.concatenate(off_px))}
    say(str(total))
    if not options.quick:
        save("validation", {"markers": [*rows, total], "compared": errors}, options.recordings)


def markers_of(found: Validation, truth: Truth, kit: Kit) -> tuple[dict[str, Any], np.ndarray]:
    """Return the figures of a recording, and by how many pixels the corners that face the camera are off."""
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
    return row | spread(np.concatenate(off_px)), np.concatenate(off_px)


def compared(found: Validation, recording: Any, truth: Truth) -> dict[str, Any]:
    """Return the errors by the kit and by the truth, those of the cell, and the size found of faults."""
    row: dict[str, Any] = {"compared_share": found.document["shape"]["compared_share"]}
    unmasked = altered(recording, read=lambda n: images_of(recording[n])._replace(mask=None))
    for by_kit in found.document["pieces"]:
        side, _, piece = by_kit["piece"].partition(",")
        if not piece:
            its_truth = truth if side == "this side" else OtherTruth(truth, len(recording))
            true = compare(found.shape[side], its_truth, unmasked).evaluation
            for key in ("median_mm", "p95_mm"):
                row[f"{side} {key}"] = [by_kit[key], getattr(true, f"absolute_{key}")]
    axis, angles = recording.rotation_axis, np.array(recording.angles_deg)
    for fault, scale, its_axis, its_angles in (
        ("none", 1.0, axis, angles),
        ("depth 2 % short", 0.98, axis, angles),
        ("focal length 3 % large", (1 / 1.03, 1 / 1.03, 1.0), axis, angles),
        ("axis 5 mm off", 1.0, replace(axis, point_m=axis.point_m + np.array([0.003, 0, 0.004])), angles),
        ("angles 1 degree off", 1.0, axis, angles + (-1.0) ** np.arange(len(angles))),
    ):
        seen = replace(found.seen, corners_m=found.seen.corners_m * scale)
        errors, _ = adjusted(seen, found.truth.kit, its_axis, recording.held_point_m, its_angles.tolist())
        row[fault] = {e["name"]: [round(e["size"], 2), round(e["std"], 2), e["is_fault"]] for e in errors}
    return row


def spread(off_px: np.ndarray) -> dict[str, float]:
    median, p95 = np.percentile(off_px, (50, 95)).tolist()
    return {"median_px": median, "p95_px": p95, "rms_px": float(np.sqrt(np.mean(off_px**2)))}


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
