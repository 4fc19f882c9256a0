"""How well wrong angles and a wrong axis are mended, how still exact poses stand, and what that costs.

The recorded angles and the axis of a recording whose poses are exact are spoiled by known amounts.
Measured is the slip: how far common cloth of two views lies off itself along the surface, in the median and
at 90 % of the pairs of views; the error of the poses in claimed deviations; and the time of a view.
Without its axis, the one that is estimated from the views is compared with the recorded one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.inputs import Remembered, measure_each
from benchmarks.output import Options, Row
from benchmarks.speed import best_s
from flatcloth.core.config import SurfaceConfig
from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import Rigid3, object_from_camera, project, wrapped_deg
from flatcloth.core.types import Float64, RgbdFrame, RotationAxis
from flatcloth.engine.integration import Integration
from flatcloth.recordings import open_recording
from flatcloth.recordings.base import altered
from flatcloth.registration.axis import resolve_axis
from flatcloth.registration.cameras import register
from flatcloth.registration.registered import Registered
from flatcloth.registration.view_features import MOST_APART_DEG, ViewFeatures, extract_features

STEP_DEG = 30.0
SAME_CLOTH_M = 0.01
"""A view shows a point of another where its depth is the point's, but for this."""
LEAST_COMMON_POINTS = 20
HALF_HEIGHT_M = 0.4
"""Axes are compared within this height of the held point: half a garment."""
SEEDS = 3


@dataclass(frozen=True, kw_only=True)
class Spoiling:
    """Standard deviations of the errors: recorded angles, place and direction of the axis."""

    name: str
    angle_deg: float = 0.0
    axis_m: float = 0.0
    tilt_deg: float = 0.0


SPOILINGS = (
    Spoiling(name="exact"),
    Spoiling(name="mild", angle_deg=0.3, axis_m=0.001, tilt_deg=0.1),
    Spoiling(name="loose", angle_deg=1.5, axis_m=0.006, tilt_deg=0.3),
)


def run(options: Options) -> None:
    """Measure and print; write ``results/registration.json`` unless ``quick``."""
    measure_each("registration", partial(rows_of, seeds=1 if options.quick else SEEDS), options)


def rows_of(source: str, seeds: int) -> list[Row]:
    """Return how a recording is registered, spoiled in each way, and without its axis."""
    recording = Remembered(open_recording(source))
    rows = []
    if recording.rotation_axis is not None:
        rows = [without_axis(recording, masks) for masks in sorted({recording.has_masks, False})]
    integration = Integration(recording)
    views = _views(integration)
    for spoiling in SPOILINGS:
        for seed in range(1 if spoiling.name == "exact" else seeds):
            rows.append(measured(integration, views, spoiling, np.random.default_rng(seed)))
    return rows


def without_axis(recording: Any, masks: bool) -> Row:
    """Estimate the axis from the views, with or without their masks, and compare it with the recorded one."""

    bare = altered(recording, rotation_axis=None, held_point_m=None)

    def read(view: int) -> RgbdFrame:
        frame: RgbdFrame = recording[view]
        return frame if masks else replace(frame, mask=None)

    def estimated() -> RotationAxis:
        return resolve_axis(bare, read, SurfaceConfig()).axis

    axis = estimated()  # once unmeasured: reads and compiles
    seconds = best_s(estimated, 1, time.process_time)
    error_m, error_deg = axis_errors(axis, recording.rotation_axis, HALF_HEIGHT_M)
    return {
        "recording": recording.name,
        "spoiling": "no axis",
        "masks": masks,
        "error_mm": round(1e3 * error_m, 2),
        "error_deg": round(error_deg, 3),
        "cpu_s": round(seconds, 2),
    }


def axis_errors(found: RotationAxis, true: RotationAxis, half_height_m: float = 0.15) -> tuple[float, float]:
    """Return the largest distance between two axes within a height (m), and their angle (deg)."""
    ends = []
    for height in (-half_height_m, half_height_m):
        at = true.point_m + height * true.direction
        along = (at - found.point_m) @ found.direction
        ends.append(float(np.linalg.norm(found.point_m + along * found.direction - at)))
    return max(ends), math.degrees(math.acos(min(1.0, float(found.direction @ true.direction))))


def measured(
    integration: Integration, views: Sequence[int], spoiling: Spoiling, random: np.random.Generator
) -> Row:
    """Spoil what is known of a recording with exact poses, register its views, and compare."""
    true = [object_from_camera(integration.axis, integration.recording.angles_deg[view]) for view in views]
    axis = _spoiled_axis(integration.axis, spoiling, random)
    surfaces = []
    for view in views:
        surface = integration.views.flattening(view).surface
        angle = surface.frame.angle_deg + random.normal(0.0, spoiling.angle_deg)
        surfaces.append(replace(surface, frame=replace(surface.frame, angle_deg=angle)))
    features = [extract_features(surface) for surface in surfaces]  # once unmeasured: compiles
    held_point_m = integration.views.held_point_m
    register(features[:3], axis, held_point_m)
    started = time.perf_counter()
    features = [extract_features(surface) for surface in surfaces]
    scanned = time.perf_counter()
    found = register(features, axis, held_point_m)
    ended = time.perf_counter()
    before, after = _slips_m(features, found.known, true), _slips_m(features, found.object_from_camera, true)
    figures = {
        "slip_before_mm": 1e3 * float(np.median(before)),
        "slip_mm": 1e3 * float(np.median(after)),
        "slip_p90_mm": 1e3 * float(np.percentile(after, 90)),
        "error_in_stds": _error_in_stds(found, true),
        "scan_ms": 1e3 * (scanned - started) / len(views),
        "register_ms": 1e3 * (ended - scanned) / len(views),
    }
    row: Row = {"recording": integration.recording.name, "spoiling": spoiling.name, "views": len(views)}
    return row | {key: round(value, 3) for key, value in figures.items()}


def _views(integration: Integration) -> list[int]:
    """Views in steps from the best one on."""
    angles = np.array(integration.recording.angles_deg)
    start = int(np.argmax(integration.views.observed_areas_m2()))
    wanted = [angles[start] + sign * step for step in np.arange(0.0, 181.0, STEP_DEG) for sign in (1, -1)]
    found = [int(np.abs(wrapped_deg(angles - angle)).argmin()) for angle in wanted]
    views = []
    for view in dict.fromkeys(found):
        try:
            integration.views.flattening(view)
        except FlatclothError:
            continue
        views.append(view)
    return sorted(views)


def _spoiled_axis(axis: RotationAxis, spoiling: Spoiling, random: np.random.Generator) -> RotationAxis:
    off = random.normal(size=4) * np.array([spoiling.axis_m] * 2 + [math.radians(spoiling.tilt_deg)] * 2)
    direction = axis.direction + np.array([off[2], 0.0, off[3]])
    return replace(
        axis,
        point_m=axis.point_m + np.array([off[0], 0.0, off[1]]),
        direction=direction / np.linalg.norm(direction),
    )


def _slips_m(features: Sequence[ViewFeatures], poses: Sequence[Rigid3], true: Sequence[Rigid3]) -> Float64:
    """Root mean square slip of the common cloth of each pair of views."""
    slips = []
    nearest = math.cos(math.radians(MOST_APART_DEG))
    for i in range(len(features)):
        for j in range(i):
            if true[i].rotation[:, 2] @ true[j].rotation[:, 2] < nearest:
                continue
            points, normals = true[i].apply_with_normal(features[i].points_m, features[i].normal)
            common = _seen(points, features[j], true[j])
            if common.sum() < LEAST_COMMON_POINTS:
                continue
            moved = true[j] @ poses[j].inverse() @ poses[i] @ true[i].inverse()
            off = moved.apply(points[common]) - points[common]
            along = off - (off * normals[common]).sum(axis=1)[:, None] * normals[common]
            slips.append(math.sqrt(float(np.square(along).sum(axis=1).mean())))
    return np.array(slips)


def _seen(points: Float64, by: ViewFeatures, held: Rigid3) -> np.ndarray:
    """Return which points (N, 3), object frame, a view shows."""
    local = held.inverse().apply(points)
    rc = project(local, by.intrinsics)
    shape = np.array(by.usable.shape)
    inside = np.isfinite(rc).all(axis=1) & (rc > -0.5).all(axis=1) & (rc < shape - 0.5).all(axis=1)
    pixel = np.rint(np.where(inside[:, None], rc, 0.0)).astype(int)
    depth = by.depth_m[pixel[:, 0], pixel[:, 1]]
    with np.errstate(invalid="ignore"):
        return inside & (np.abs(depth - local[:, 2]) < SAME_CLOTH_M)


def _error_in_stds(found: Registered, true: Sequence[Rigid3]) -> float:
    """Root mean square of the errors of place, against the views compared with, by what is claimed."""
    errors = []
    for n, std_m in enumerate(found.stds[:, 3:]):
        ends = [{pair.first, pair.second} for pair in found.pairs if n in (pair.first, pair.second)]
        if not ends:
            continue
        middle = found.known[n].apply(np.median(found.features[n].points_m, axis=0))
        off = {
            k: (found.object_from_camera[k] @ true[k].inverse()).apply(middle) - middle
            for k in set().union(*ends)
        }
        own = off.pop(n)
        errors.append((own - np.mean(list(off.values()), axis=0)) / std_m)
    return math.sqrt(float(np.square(errors).mean()))
