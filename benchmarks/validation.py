"""How many markers of a printed kit are read, how exactly, and if any is wrong; of recordings with truth.

``flatcloth synthesize MESH --texture kit.json --sensor stereo --focal 615 --out DIR`` makes such a recording.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.output import Options, save, say
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import TrueView, Truth
from flatcloth.validation.kit import Kit, read_kit
from flatcloth.validation.markers import found_markers

MOST_FACING_DEG = 55.0
"""Markers that face the camera within this angle are asked for."""
NEAR_M, WRONG_PX = 0.0025, 6.0
"""A place is seen if a pixel's place on the cloth is as near; a marker further off than this is a wrong id.
Chosen: a pixel seen at 55 degrees, and a quarter of a cell of 30 mm at 0.85 m."""
GRID = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 5)] * 2), axis=-1).reshape(-1, 2)


def run(options: Options) -> None:
    rows, off_px = [], []
    for name in options.recordings:
        row, off = markers_of(name)
        rows.append(row)
        off_px.append(off)
        say(str(row))
    total = {key: sum(row[key] for row in rows) for key in ("facing", "read_of_facing", "found", "wrong")}
    total |= {"recording": "all", **spread(np.concatenate(off_px))}
    say(str(total))
    if not options.quick:
        save("validation", {"markers": [*rows, total]}, options.recordings)


def markers_of(name: str) -> tuple[dict[str, Any], np.ndarray]:
    """Return the figures of a recording, and by how many pixels the corners that face the camera are off."""
    recording, truth = open_recording(name), Truth(name)
    kit = read_kit(Path(recording.location) / "kit.json")
    row = dict.fromkeys(("facing", "read_of_facing", "found", "wrong"), 0)
    off_px = [np.zeros((0, 4))]
    for n in range(len(recording)):
        places = true_places(truth[n], kit)
        facing = {
            i for i, (_, angle_deg, is_whole) in places.items() if is_whole and angle_deg <= MOST_FACING_DEG
        }
        seen = found_markers(recording[n].color, kit)
        off = {
            i: np.linalg.norm(corners - places[i][0], axis=1) if i in places else np.full(4, np.inf)
            for i, corners in zip(seen.ids.tolist(), seen.corners_px, strict=True)
        }
        right = {i for i in off if np.median(off[i]) < WRONG_PX}
        row["facing"] += len(facing)
        row["read_of_facing"] += len(facing & right)
        row["found"] += len(off)
        row["wrong"] += len(off) - len(right)
        off_px += [off[i][None] for i in facing & right]
    return {"recording": Path(name).name, **row, **spread(np.concatenate(off_px))}, np.concatenate(off_px)


def spread(off_px: np.ndarray) -> dict[str, float]:
    rms = float(np.sqrt(np.mean(off_px**2)))
    return {"median_px": float(np.median(off_px)), "p95_px": float(np.percentile(off_px, 95)), "rms_px": rms}


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
            corners = kit.corners_m[i] - np.array(kit.size_m) / 2
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


def terms(at: np.ndarray) -> np.ndarray:
    u, v = at.T
    return np.stack([np.ones_like(u), u, v, u * v, u * u, v * v], axis=-1)
