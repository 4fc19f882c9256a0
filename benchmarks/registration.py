"""How well wrong angles and a wrong axis are mended, how still exact poses stand, and what that costs.

The recorded angles and the axis of a recording whose poses are exact are spoiled by known amounts.
Measured is the slip: how far common cloth of two views lies off itself along the surface.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from benchmarks.inputs import sources
from benchmarks.output import Options, recordings_of, save, say
from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import Rigid3, object_from_camera, project, wrapped_deg
from flatcloth.core.types import Float64, RotationAxis
from flatcloth.engine.integration import Integration
from flatcloth.recordings import open_recording
from flatcloth.registration.cameras import register
from flatcloth.registration.registered import Registered
from flatcloth.registration.view_features import MOST_APART_DEG, ViewFeatures, extract_features

STEP_DEG = 30.0
SAME_CLOTH_M = 0.01
"""A view shows a point of another where its depth is the point's, but for this."""
LEAST_COMMON_POINTS = 20


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


@dataclass(frozen=True, kw_only=True)
class Row:
    """One recording, spoiled in one way; slips over pairs of views, errors in claimed deviations."""

    recording: str
    spoiling: str
    views: int
    slip_before_mm: float
    slip_mm: float
    slip_p90_mm: float
    error_in_stds: float
    scan_ms: float
    register_ms: float


def run(options: Options) -> None:
    """Measure, print and (unless quick) write ``results/registration.json``."""
    rows: list[dict[str, Any]] = []
    for source in sources(options.recordings):
        integration = Integration(open_recording(source))
        views = _views(integration)
        for spoiling in SPOILINGS:
            for seed in range(1 if options.quick or spoiling.name == "exact" else 3):
                row = measured(integration, views, spoiling, np.random.default_rng(seed))
                say(
                    f"{row.recording} {row.spoiling}: slip {row.slip_before_mm:.2f} -> {row.slip_mm:.2f} mm "
                    f"(p90 {row.slip_p90_mm:.2f}), errors {row.error_in_stds:.1f} times what is claimed, "
                    f"{row.scan_ms:.1f} + {row.register_ms:.1f} ms a view"
                )
                rows.append(asdict(row))
    if not options.quick:
        save("registration", rows, recordings_of(rows))


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
    return Row(
        recording=integration.recording.name,
        spoiling=spoiling.name,
        views=len(views),
        slip_before_mm=1e3 * float(np.median(before)),
        slip_mm=1e3 * float(np.median(after)),
        slip_p90_mm=1e3 * float(np.percentile(after, 90)),
        error_in_stds=_error_in_stds(found, true),
        scan_ms=1e3 * (scanned - started) / len(views),
        register_ms=1e3 * (ended - scanned) / len(views),
    )


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
    for n, view in enumerate(found.views):
        ends = [{pair.first, pair.second} for pair in found.pairs if n in (pair.first, pair.second)]
        if not ends:
            continue
        middle = found.known[n].apply(np.median(found.features[n].points_m, axis=0))
        off = {
            k: (found.object_from_camera[k] @ true[k].inverse()).apply(middle) - middle
            for k in set().union(*ends)
        }
        own = off.pop(n)
        errors.append((own - np.mean(list(off.values()), axis=0)) / view.std_m)
    return math.sqrt(float(np.square(errors).mean()))
