"""The benchmark's sheets are exact, and its rows complete; nothing here is timed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.developable import AXIS, CAMERA, NOISE_M, depth_noise_m, sheets, view_of
from benchmarks.flattening import Row
from benchmarks.problems import problem_of, signed_areas
from benchmarks.report import exponent
from benchmarks.single_views import errors_mm, whole_frame
from flatcloth.geometry import back_project
from flatcloth.types import Intrinsics

# Four times as sharp: the chord between neighbours is then as long as the arc to 1e-4 even in folds.
SHARP = Intrinsics(width=240, height=160, fx=1700.0, fy=1700.0, cx=119.5, cy=79.5)


@pytest.mark.parametrize("name", sorted(sheets()))
def test_flat_distances_are_distances_along_the_surface(name: str) -> None:
    view = view_of(sheets()[name], camera=SHARP)
    cloud = exact_cloud(view.exact_depth_m)
    worst = []
    for one, other in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1])):
        flat = np.linalg.norm(view.flat_uv_m[one] - view.flat_uv_m[other], axis=-1)
        chord = np.linalg.norm(cloud[one] - cloud[other], axis=-1)
        # Neighbours of one layer, not seen at a grazing angle (their arc is long and bent).
        near = flat < 0.0012
        assert near.sum() > 1000
        worst.append(np.abs(chord[near] / flat[near] - 1).max())
    assert max(worst) < 1e-4


def exact_cloud(depth_m: np.ndarray) -> np.ndarray:
    row, col = np.mgrid[0 : SHARP.height, 0 : SHARP.width]
    ray = np.stack([(col - SHARP.cx) / SHARP.fx, (row - SHARP.cy) / SHARP.fy, np.ones(row.shape)], axis=-1)
    return ray * depth_m[..., None]


def test_depth_lies_on_the_cone() -> None:
    view = view_of(sheets()["cone"])
    cloud = back_project(view.frame.depth_m, CAMERA)[view.frame.mask].astype(np.float64)
    from_apex = cloud - [0.0, -0.5, 0.85 + 0.15]
    radius = np.hypot(from_apex[:, 0], from_apex[:, 2])
    np.testing.assert_allclose(radius, from_apex[:, 1] * np.tan(np.radians(20.0)), atol=1e-6)


def test_a_pleat_hides_a_layer_and_the_mask_is_the_outer_face() -> None:
    view = view_of(sheets()["pleat"])
    u = view.flat_uv_m[..., 0]
    jump = np.abs(np.diff(u, axis=1))
    assert np.nanmax(jump) > 0.03
    assert (view.frame.mask == np.isfinite(u)).all()


def test_noise_is_correlated_as_a_stereo_sensors() -> None:
    noise = depth_noise_m((400, 400), 7)
    assert noise.std() == pytest.approx(NOISE_M, rel=1e-3)
    for shift, expected in ((2, 0.97), (8, 0.6)):
        found = np.corrcoef(noise[:, shift:].ravel(), noise[:, :-shift].ravel())[0, 1]
        assert found == pytest.approx(expected, abs=0.05)


def test_a_clean_sheet_comes_out_flat() -> None:
    view = view_of(sheets()["S-curve"])
    error, covered = errors_mm(whole_frame(view.frame, AXIS), view.flat_uv_m, view.frame.mask)
    assert np.sqrt(np.square(error).mean()) < 0.3
    assert covered > 0.9


def test_a_problem_is_one_mesh_of_all_its_points() -> None:
    view = view_of(sheets()["T shape"])
    problem = problem_of("T shape", view.frame, AXIS, view.flat_uv_m, 12)
    assert (np.unique(problem.triangles) == np.arange(problem.size)).all()
    assert (signed_areas(problem.start_uv_m, problem.triangles) > 0).all()
    sides = np.sort(problem.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    pairs = {tuple(pair) for pair in np.sort(problem.edges, axis=1).tolist()}
    assert {tuple(side) for side in sides.tolist()} <= pairs
    assert np.unique(sides, axis=0, return_counts=True)[1].max() <= 2


def test_rows_have_the_fields_that_were_promised() -> None:
    names = {field.name for field in dataclasses.fields(Row)}
    assert names >= {"method", "surface", "sampling_interval_px", "n_points", "ms", "rms_mm", "flips"}


def test_the_exponent_is_that_of_a_power() -> None:
    rows = [{"n_points": n, "ms": 0.01 * n**1.3} for n in (100, 400, 2000, 9000)]
    assert exponent(rows) == pytest.approx(1.3)
    assert exponent(rows[:2]) is None
