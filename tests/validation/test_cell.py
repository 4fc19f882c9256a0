"""Faults of a cell, made in exact sightings of a cylinder of cloth, are found with their sizes."""

import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from flatcloth.core.geometry import camera_from_object
from flatcloth.core.types import Intrinsics, RotationAxis
from flatcloth.validation.adjustment import adjusted
from flatcloth.validation.kit import grid_kit
from flatcloth.validation.markers import Sightings
from flatcloth.validation.validate import depth_by_incidence

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
    seen: Sightings | None = None,
) -> dict[str, dict]:
    seen = seen or replace(sightings(), corners_m=sightings().corners_m * scale)
    errors, _ = adjusted(seen, KIT, axis, None, angles_deg.tolist())
    return {error["name"]: error for error in errors}


@lru_cache(maxsize=1)
def of_a_right_cell() -> dict[str, dict]:
    return found()


def test_sway_is_found_beside_the_noise():
    seen = sightings()
    below_m = seen.corners_m[..., 1] - AXIS.point_m[1]
    swing = np.random.default_rng(4).normal(size=len(ANGLES_DEG)) * 0.005 / below_m.max()
    aside_m = np.dstack([swing[seen.view][:, None] * below_m, 0 * below_m, 0 * below_m])
    errors = found(seen=replace(seen, corners_m=seen.corners_m + aside_m))
    # To one side only, of two directions.
    assert errors["sway"]["size"] == pytest.approx(1e3 * below_m.max() * swing.std() / 2, rel=0.3)
    assert [name for name, error in errors.items() if error["is_fault"]] == ["sway"]


def test_depth_is_told_by_incidence():
    rows = depth_by_incidence(replace(sightings(), corners_m=1.02 * sightings().corners_m), KIT)
    assert [row["incidence_deg"] for row in rows] == ["0 to 20", "20 to 40", "40 to 60"]
    assert [row["noise_mm"] for row in rows] == pytest.approx([0.5] * 3)
    assert rows[0]["longer_percent"] == pytest.approx(2.0, abs=0.3)


def test_a_right_cell_has_no_errors_and_one_view_judges_nothing():
    errors = of_a_right_cell()
    assert list(errors) == ["depth", "focal length", "axis", "angles", "sway"]
    assert not [error["text"] for error in errors.values() if error["is_fault"]]
    assert all(abs(error["size"]) < 4 * error["std"] for error in errors.values())
    one_view = np.where(sightings().view < 1, 1.0, np.nan)[:, None, None] * sightings().corners_m
    assert adjusted(replace(sightings(), corners_m=one_view), KIT, AXIS, None, ANGLES_DEG.tolist())[0] == []


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
    if fault == "depth":  # the factor that is named mends it
        factor = float(re.search(r"--depth-factor ([\d.]+)", errors[fault]["text"])[1])
        assert factor == pytest.approx(1 / 0.98, abs=0.004)


def test_what_alignment_to_depth_moves_is_put_back_and_adds_no_error():
    seen, right = sightings(), of_a_right_cell()
    shift_px = 9.0 / seen.corners_m[..., 2]
    moved_px = np.stack([0 * shift_px, np.rint(shift_px) - shift_px], axis=-1)
    aside_m = np.dstack([moved_px / CAMERA.fx, 0 * shift_px]) * seen.corners_m[..., 2:]
    seen = replace(seen, corners_m=seen.corners_m + aside_m, corners_px=seen.corners_px + moved_px)
    errors, found_px = adjusted(seen, KIT, AXIS, None, ANGLES_DEG.tolist())
    assert np.median(np.abs(moved_px - found_px)) < 0.3 * np.median(np.abs(moved_px[..., 1]))
    for error in errors:
        assert error["size"] == pytest.approx(right[error["name"]]["size"], abs=0.3)
