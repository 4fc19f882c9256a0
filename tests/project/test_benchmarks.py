"""The benchmark's sheets are exact, and its rows complete; nothing here is timed."""

from __future__ import annotations

import importlib
import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from benchmarks import output
from benchmarks.__main__ import ON_ALL_CORES, ON_ONE_CORE
from benchmarks.developable import AXIS, NOISE_M, SheetView, depth_noise_m, sheets, view_of
from benchmarks.problems import problem_of, signed_areas
from benchmarks.reach import measured_shares, neighbouring_cells
from benchmarks.report import exponent
from benchmarks.shape import difference
from benchmarks.single_views import errors_mm, whole_frame
from flatcloth.core.geometry import back_project
from flatcloth.core.types import Float64, Intrinsics
from flatcloth.flattening.patches import STEP_RIGHT, STEPS_BOTH
from flatcloth.recordings.truth import TrueView

# The benchmark's camera, cropped to the sheets.
CAMERA = Intrinsics(width=340, height=420, fx=425.0, fy=425.0, cx=169.5, cy=209.5)
STEP_PX = 0.02


def test_what_programs_in_strings_import_is_there() -> None:
    # Lint and types do not see it.
    text = "".join(path.read_text() for path in Path(output.__file__).parent.glob("*.py"))
    found = set(re.findall(r"^ *from (flatcloth[\w.]*) import (\w+)", text, flags=re.MULTILINE))
    assert ("flatcloth.engine.integration", "Integration") in found
    for module, name in sorted(found):
        if not hasattr(importlib.import_module(module), name):
            importlib.import_module(f"{module}.{name}")


@pytest.mark.parametrize("name", sorted(sheets()))
def test_flat_distances_are_distances_along_the_surface(name: str) -> None:
    """Between rays a small part of a pixel apart, where the chord is as long as the arc."""
    here, k = view_of(sheets()[name], camera=CAMERA), CAMERA
    for camera in (replace(k, cx=k.cx - STEP_PX), replace(k, cy=k.cy - STEP_PX)):
        there = view_of(sheets()[name], camera=camera)
        flat = np.linalg.norm(here.flat_uv_m - there.flat_uv_m, axis=-1)
        chord = np.linalg.norm(cloud_of(here) - cloud_of(there), axis=-1)
        near = flat < 1.5e-4  # the others are seen at a grazing angle, or lie on another layer
        assert near.sum() > 0.95 * here.frame.mask.sum()
        np.testing.assert_allclose(chord[near], flat[near], rtol=1e-4)


def cloud_of(view: SheetView) -> Float64:
    k, depth = view.frame.intrinsics, view.exact_depth_m
    row, col = np.mgrid[0 : k.height, 0 : k.width]
    return np.stack([(col - k.cx) / k.fx * depth, (row - k.cy) / k.fy * depth, depth], axis=-1)


def test_depth_lies_on_the_cone() -> None:
    view = view_of(sheets()["cone"], camera=CAMERA)
    cloud = back_project(view.frame.depth_m, CAMERA)[view.frame.mask].astype(np.float64)
    from_apex = cloud - [0.0, -0.5, 0.85 + 0.15]
    radius = np.hypot(from_apex[:, 0], from_apex[:, 2])
    np.testing.assert_allclose(radius, from_apex[:, 1] * np.tan(np.radians(20.0)), atol=1e-6)


def test_a_pleat_hides_a_layer_and_the_mask_is_the_outer_face() -> None:
    view = view_of(sheets()["pleat"], camera=CAMERA)
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
    view = view_of(sheets()["S-curve"], camera=CAMERA)
    error, covered = errors_mm(whole_frame(view.frame, AXIS), view.flat_uv_m, view.frame.mask)
    assert np.sqrt(np.square(error).mean()) < 0.3
    assert covered > 0.9


def test_a_problem_is_one_mesh_of_all_its_points() -> None:
    view = view_of(sheets()["T shape"], camera=CAMERA)
    problem = problem_of("T shape", view.frame, AXIS, view.flat_uv_m, 12)
    assert (np.unique(problem.triangles) == np.arange(problem.size)).all()
    assert (signed_areas(problem.start_uv_m, problem.triangles) > 0).all()
    sides = np.sort(problem.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    pairs = {tuple(pair) for pair in np.sort(problem.edges, axis=1).tolist()}
    assert {tuple(side) for side in sides.tolist()} <= pairs
    assert np.unique(sides, axis=0, return_counts=True)[1].max() <= 2


def test_the_exponent_is_that_of_a_power() -> None:
    rows = [{"n_points": n, "ms": 0.01 * n**1.3} for n in (100, 400, 2000, 9000)]
    assert exponent(rows) == pytest.approx(1.3)
    assert exponent(rows[:2]) is None


def test_reach_follows_neighbours_that_no_jump_divides_and_stops_at_layers() -> None:
    # A strip of 6 cells of 5 mm, two pixels a cell; a jump after the third, another layer after the fifth.
    flat = np.zeros((2, 12, 2))
    flat[..., 0] = 0.0025 * (np.arange(12) + 0.5)
    flat[..., 1] = 0.002
    flat[:, 10:, 0] += 0.05
    steps = np.full((2, 12), STEPS_BOTH, dtype=np.uint8)
    steps[:, 5] &= ~np.uint8(STEP_RIGHT)
    surface = SimpleNamespace(
        frame=SimpleNamespace(offset_rc=(0, 0)), usable=np.ones((2, 12), dtype=bool), steps=steps
    )
    pairs = neighbouring_cells(cast(Any, surface), flat, (1, 16), np.zeros(2))
    joined = {tuple(p) for p in pairs.tolist() if p[0] != p[1]}
    assert joined == {(0, 1), (1, 2), (3, 4)}


def test_cloth_is_measured_where_the_depth_of_some_view_is_right() -> None:
    flat = np.zeros((2, 4, 2), dtype=np.float32)
    flat[..., 0] = 0.005 * (np.arange(4) + 0.5)
    panel = np.repeat(np.uint8([[1], [2]]), 4, axis=1)
    true = TrueView(panel=panel, outer_face=np.ones((2, 4), dtype=bool), flat_uv_m=flat)
    exact = np.full((2, 4), 0.9, dtype=np.float32)
    first, second = exact.copy(), exact.copy()
    first[:, 1:] = 0.0  # not measured
    second[0, :3], second[1] = 1.2, 1.2  # the depth of the background

    class Views(list[Any]):
        panel_of_interest = 1

    recording, without_noise = (
        Views(SimpleNamespace(depth_m=depth_m) for depth_m in depths)
        for depths in ((first, second), (exact, exact))
    )
    truth = Views([true, true])
    shares = measured_shares(cast(Any, recording), cast(Any, truth), cast(Any, without_noise))
    assert shares == {"measured": 0.5, "other_measured": 0.25}


def test_a_shape_is_compared_with_itself_moved_and_with_a_node_of_another_piece() -> None:
    uv = np.random.default_rng(0).uniform(0.0, 0.3, (50, 2))
    added = SimpleNamespace(
        view_index=2, node=np.arange(50), is_new=np.ones(50, dtype=bool), rc=np.arange(100.0).reshape(50, 2)
    )
    one = SimpleNamespace(nodes=uv, observations=(added,), piece=np.zeros(50, dtype=int), all_uv_m=uv)
    moved = SimpleNamespace(**{**vars(one), "all_uv_m": uv[:, ::-1] * [1.0, -1.0] + 0.2})
    found = difference(cast(Any, one), cast(Any, moved))
    assert found["other_nodes_share"] == 0.0
    assert found["moved_most_mm"] < 1e-9
    moved.all_uv_m[7] += [0.003, 0.0]
    moved.piece = np.where(np.arange(50) == 9, -1, 0)
    found = difference(cast(Any, one), cast(Any, moved))
    assert (found["other_nodes_share"], found["other_piece_share"]) == (0.0, pytest.approx(0.02))
    assert found["moved_most_mm"] == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize("name", [*ON_ALL_CORES, *ON_ONE_CORE])
def test_every_benchmark_that_can_be_named_is_there(name: str) -> None:
    module = Path(__file__).parents[2] / "benchmarks" / f"{name}.py"
    assert "\ndef run(" in module.read_text()


def test_a_result_says_where_it_comes_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output, "RESULTS", tmp_path / "results")
    output.save("made", [{"recording": "a", "mm": 1.5}], ["folder/a", "b", "a"])
    written = json.loads((tmp_path / "results" / "made.json").read_text())
    assert written["figures"] == [{"recording": "a", "mm": 1.5}]
    assert written["provenance"]["recordings"] == ["a", "b"]
    assert {"commit", "date", "machine"} <= written["provenance"].keys()


@pytest.mark.parametrize("file", sorted(output.RESULTS.glob("*.json")), ids=lambda file: file.stem)
def test_the_results_that_are_kept_say_where_they_come_from(file: Path) -> None:
    origin = json.loads(file.read_text())["provenance"]
    assert all(origin[key] for key in ("commit", "date", "machine"))
