"""Integration by the public functions: what comes out, what is written, how it is stopped."""

import math
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported_sessions import write_cylinder
from scenes import Cylinder

import flatcloth
from flatcloth.core.errors import JournalError
from flatcloth.engine.integration import Integration
from flatcloth.session.kept import read_summary

ANGLES_DEG = (-25.0, 0.0, 25.0)


def cylinder(**changes: Any) -> Any:
    return Cylinder(angles_deg=ANGLES_DEG, span_deg=(-70.0, 70.0), **changes)


@pytest.fixture(scope="module")
def shape() -> flatcloth.Shape:
    return flatcloth.integrate(cylinder())


def test_a_view_is_flattened_as_in_the_integration() -> None:
    flat = flatcloth.flatten(cylinder(), 1)
    view = flat.view
    assert view.rgb.shape == (*view.valid.shape, 3)
    assert view.xyz_m.shape == view.rgb.shape
    used = Integration(cylinder()).views.flattening(1).view
    assert np.array_equal(view.xyz_m, used.xyz_m, equal_nan=True)
    with pytest.raises(IndexError, match="view 3 of 3"):
        flatcloth.flatten(cylinder(), 3)


def test_the_arrays_of_a_shape_fit_together(shape: flatcloth.Shape) -> None:
    rows, cols = shape.valid.shape
    assert shape.rgb.shape == (rows, cols, 3)
    assert shape.rgb.dtype == np.uint8
    for points in (shape.xyz_m, shape.normal):
        assert points.shape == (rows, cols, 3)
        assert np.isfinite(points[shape.valid]).all()
        assert np.isnan(points[~shape.valid]).all()
    assert shape.placement_std_m is not None
    assert np.isfinite(shape.placement_std_m[shape.valid]).all()
    radius = np.hypot(shape.xyz_m[..., 0], shape.xyz_m[..., 2] - 0.85)[shape.valid]
    assert abs(float(np.median(radius)) - 0.12) < 0.001
    assert shape.views == (0, 1, 2)
    assert shape.pieces == ()
    assert shape.pixel_size_m == shape.view.pixel_size_m
    assert shape.axis.direction.tolist() == [0.0, -1.0, 0.0]


def test_a_shape_tells_what_was_decided_and_how_long_it_took(shape: flatcloth.Shape) -> None:
    assert {d.view_index for d in shape.decisions if d.accepted} == {0, 2}
    assert set(shape.seconds) == {"opening", "integrating", "garment"}
    assert shape.report["start_view"] == 1
    assert str(shape).startswith("cylinder: 3 views integrated (0, 1, 2), ")


def test_points_and_grasps_of_a_garment_lie_on_its_cloth(shape: flatcloth.Shape) -> None:
    garment = shape.garment()
    assert 0.0 <= garment.probability <= 1.0
    assert sum(garment.probabilities.values()) == pytest.approx(1.0)
    points = shape.named_points()
    for name, point in points.items():
        assert (
            np.linalg.norm(shape.grasp_point(name).object_from_grasp.translation_m - point.position_held_m)
            < 1e-6
        )
    with pytest.raises(flatcloth.GarmentError, match="tail: no named point of this garment that was seen"):
        shape.grasp_point("tail")


def test_each_view_is_reported_with_the_shape_so_far_and_progress_is_told_until_it_is_cancelled() -> None:
    seen, told = [], list[tuple[float, str]]()
    flatcloth.integrate(
        cylinder(),
        on_view=lambda decision, so_far: seen.append((decision, so_far.views)),
        progress=lambda share, text: told.append((share, text)),
    )
    first, *others = seen
    assert math.isnan(first[0].score)
    assert first[1] == (1,)
    # All views are taken at once, each where it hangs.
    assert [decision.view_index for decision, _ in others] == [0, 2]
    assert all(decision.accepted and len(views) == 3 for decision, views in others)
    assert all(0.0 <= share <= 1.0 for share, _ in told)
    assert "choosing the rotation" in {text for _, text in told}
    stop = threading.Event()
    with pytest.raises(flatcloth.CancelledError):
        flatcloth.integrate(cylinder(), progress=lambda *_: stop.set(), cancel=stop.is_set)


def test_a_session_is_kept_continued_and_opened_again(tmp_path: Path) -> None:
    recording = flatcloth.open_recording(write_cylinder(tmp_path / "cylinder"))
    stop = threading.Event()
    with pytest.raises(flatcloth.CancelledError):
        flatcloth.integrate(
            recording, session=tmp_path / "session", on_view=lambda *_: stop.set(), cancel=stop.is_set
        )
    whole = flatcloth.integrate(recording, session=tmp_path / "session")
    summary = read_summary(tmp_path / "session")  # what the start screen's list says of it
    assert summary is not None
    assert summary.views == len(whole.views)
    assert summary.area_cm2 == pytest.approx(1e4 * whole.data.canonical.view.area_m2, abs=0.1)
    assert summary.ended
    assert whole.views == (0, 1, 2, 3)
    assert len(whole.decisions) == 3
    again = flatcloth.open_session(tmp_path / "session")
    assert again.views == whole.views
    assert np.array_equal(again.rgb, whole.rgb)
    assert again.decisions == ()
    with pytest.raises(JournalError, match="another recording"):
        flatcloth.integrate(cylinder(), session=tmp_path / "session")
    with pytest.raises(JournalError, match="not a session folder"):
        flatcloth.open_session(tmp_path)
    (tmp_path / "cylinder").rename(tmp_path / "moved")
    with pytest.raises(flatcloth.RecordingError, match="present location"):
        flatcloth.open_session(tmp_path / "session")
    assert flatcloth.open_session(tmp_path / "session", recording=tmp_path / "moved").views == whole.views


def test_a_session_is_continued_with_its_own_settings(tmp_path: Path) -> None:
    config = flatcloth.Config.from_dict({"flattening": {"pixel_size_m": 0.004}})
    flatcloth.integrate(cylinder(), config=config, session=tmp_path)
    assert flatcloth.integrate(cylinder(), session=tmp_path).pixel_size_m == 0.004


def test_the_files_are_those_of_run_and_can_be_read(shape: flatcloth.Shape, tmp_path: Path) -> None:
    files = shape.write(tmp_path / "new" / "result")
    assert [file.name for file in files][:4] == ["flattened.npz", "flattened.png", "cloud.ply", "grasps.json"]
    assert files[-1].name == "outcome.json"
    read = flatcloth.read_shape(files[0])
    assert np.array_equal(read.xyz_m, shape.xyz_m, equal_nan=True)
    (tmp_path / "file").write_text("")
    with pytest.raises(flatcloth.FlatclothError, match="cannot be written"):
        shape.write(tmp_path / "file")


def test_the_files_do_not_depend_on_the_number_of_cores(tmp_path: Path) -> None:
    written = []
    for cores in (1, 2):
        files = flatcloth.integrate(cylinder(), cores=cores).write(tmp_path / str(cores))
        written.append({file.name: file.read_bytes() for file in files})
    one, two = written
    assert {"flattened.npz", "cloud.ply", "grasps.json"} <= one.keys()
    assert one == two
