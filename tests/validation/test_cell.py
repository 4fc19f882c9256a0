"""Faults of a cell, made in exact sightings of a cylinder of cloth, are found with their sizes."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from flatcloth.core.geometry import camera_from_object
from flatcloth.core.types import Intrinsics, RotationAxis
from flatcloth.validation.kit import grid_kit
from flatcloth.validation.markers import KitTruth, Sightings
from flatcloth.validation.validate import cell_errors, depth_by_incidence

KIT = grid_kit((0.48, 0.42), 0.03, 1)
CAMERA = Intrinsics(width=640, height=640, fx=600.0, fy=600.0, cx=319.5, cy=319.5)
AXIS = RotationAxis(point_m=np.array([0.0, -0.25, 0.85]), direction=np.array([0.0, -1.0, 0.0]))
BESIDE_M = np.array([0.06, 0.0, 0.03])
RADIUS_M, ANGLES_DEG = 0.15, np.arange(-75.0, 76.0, 15.0) + 75.0


@lru_cache(maxsize=1)
def sightings() -> Sightings:
    """Markers on a cylinder beside the axis that faces the camera at 75 degrees, with a sensor's noise."""
    random, rows = np.random.default_rng(0), []
    for n, angle_deg in enumerate(ANGLES_DEG):
        turned = camera_from_object(AXIS, angle_deg)
        for marker, corners in KIT.corners_m.items():
            u, v = (corners - np.array(KIT.size_mm) / 2e3).T
            bend = u / RADIUS_M - np.radians(75.0)
            outward = np.stack([np.sin(bend), 0 * bend, -np.cos(bend)], axis=1)
            points = turned.apply(
                BESIDE_M + AXIS.point_m + RADIUS_M * outward + np.stack([0 * v, v + 0.25, 0 * v], axis=1)
            )
            normal = turned.turn(outward).mean(axis=0)
            mean = points.mean(axis=0)
            incidence = np.degrees(np.arccos(-normal @ mean / np.linalg.norm(mean) / np.linalg.norm(normal)))
            if incidence < 55:
                px = points[:, :2] / points[:, 2:] * CAMERA.fx + CAMERA.cx + random.normal(0, 0.15, (4, 2))
                rays = np.column_stack([(px - CAMERA.cx) / CAMERA.fx, np.ones(4)])
                noise = random.normal(0, 5e-4) + random.normal(0, 2e-4, 4)
                rows.append((n, marker, px, rays * (points[:, 2] + noise)[:, None], 5e-4))
    view, markers, corners_px, corners_m, noise_m = map(np.array, zip(*rows, strict=True))
    return Sightings(view=view, marker=markers, corners_px=corners_px, corners_m=corners_m, noise_m=noise_m)


def found(
    scale: tuple[float, ...] = (1.0, 1.0, 1.0),
    axis: RotationAxis = AXIS,
    angles_deg: np.ndarray = ANGLES_DEG,
) -> dict[str, dict]:
    seen = replace(sightings(), corners_m=sightings().corners_m * scale)
    return {error["name"]: error for error in cell_errors(seen, KIT, axis, None, angles_deg.tolist())}


def test_sway_is_found_beside_the_noise():
    seen = sightings()
    below_m = seen.corners_m[..., 1] - AXIS.point_m[1]
    swing = np.random.default_rng(4).normal(size=len(ANGLES_DEG)) * 0.005 / below_m.max()
    aside_m = np.dstack([swing[seen.view][:, None] * below_m, 0 * below_m, 0 * below_m])
    errors = cell_errors(
        replace(seen, corners_m=seen.corners_m + aside_m), KIT, AXIS, AXIS.point_m, ANGLES_DEG.tolist()
    )
    # To one side only, of two directions.
    assert errors[-1]["size"] == pytest.approx(1e3 * below_m.max() * swing.std() / 2, rel=0.3)
    assert [error["name"] for error in errors if error["is_fault"]] == ["sway"]


def test_depth_is_told_by_incidence():
    rows = depth_by_incidence(replace(sightings(), corners_m=1.02 * sightings().corners_m), KIT)
    assert [row["incidence_deg"] for row in rows] == ["0 to 20", "20 to 40", "40 to 60"]
    assert [row["noise_mm"] for row in rows] == pytest.approx([0.5] * 3)
    assert rows[0]["longer_percent"] == pytest.approx(2.0, abs=0.3)


def test_a_right_cell_has_no_errors_and_one_view_judges_nothing():
    errors = found()
    assert list(errors) == ["depth", "focal length", "axis", "angles", "sway"]
    assert not [error["text"] for error in errors.values() if error["is_fault"]]
    assert all(abs(error["size"]) < 4 * error["std"] for error in errors.values())
    few = replace(sightings(), noise_m=np.where(sightings().view < 1, 5e-4, np.nan))
    assert cell_errors(few, KIT, AXIS, None, ANGLES_DEG.tolist()) == []


RANDOM_DEG = np.random.default_rng(3).normal(size=len(ANGLES_DEG))
FAULTS = {
    "depth": (-2.0, {"scale": (0.98, 0.98, 0.98)}),
    "focal length": (3.0, {"scale": (600 / 618, 600 / 618, 1.0)}),
    "axis": (5.0, {"axis": replace(AXIS, point_m=AXIS.point_m + np.array([0.003, 0.0, -0.004]))}),
    "angles": (1.0, {"angles_deg": ANGLES_DEG + RANDOM_DEG / RANDOM_DEG.std()}),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_with_its_size_to_a_fifth_and_no_other(fault):
    size, faulty = FAULTS[fault]
    errors = found(**faulty)
    assert errors[fault]["size"] == pytest.approx(size, rel=0.2)
    assert {name for name, error in errors.items() if error["is_fault"]} == {fault}
    assert f"{errors[fault]['size']:.1f}" in errors[fault]["text"]


def test_the_factor_that_is_named_mends_the_depth():
    factor = float(re.search(r"--depth-factor ([\d.]+)", found((0.98,) * 3)["depth"]["text"])[1])
    assert not found((0.98 * factor,) * 3)["depth"]["is_fault"]


def test_markers_give_the_place_of_the_pixels_between_them():
    seen, middle = sightings(), int(np.flatnonzero(ANGLES_DEG == 75.0)[0])
    pixels = np.stack(np.meshgrid(*[np.arange(640.0)] * 2), axis=-1).reshape(-1, 2)
    found = KitTruth(KIT, seen.of_view).places(middle, pixels)
    known = np.isfinite(found[:, 0])
    assert known.sum() > 45_000
    x, y = ((pixels[known] - (CAMERA.cx, CAMERA.cy)) / (CAMERA.fx, CAMERA.fy)).T
    cx, _, cz = camera_from_object(AXIS, 75.0).apply((BESIDE_M + AXIS.point_m)[None])[0]
    half = (x * cx + cz) / (1 + x**2)
    z = half - np.sqrt(half**2 - (cx**2 + cz**2 - RADIUS_M**2) / (1 + x**2))
    places = (
        np.stack([RADIUS_M * np.arctan2(x * z - cx, cz - z), y * z], axis=1) + np.array(KIT.size_mm) / 2e3
    )
    off_mm = 1e3 * np.linalg.norm(found[known] - places, axis=1)
    assert np.median(off_mm) < 0.3
    assert off_mm.max() < 1.5
