"""Both sides of a bundled garment: the other side is found, joined, scored and written."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import flatcloth
from flatcloth.api.integrating import integrate
from flatcloth.core.resources import sample_recordings
from flatcloth.engine.evaluation import OtherTruth, compare_sides
from flatcloth.engine.garment import GarmentService
from flatcloth.engine.integration import Integration
from flatcloth.export.by_name import made
from flatcloth.export.garment import garment_document, named_points
from flatcloth.export.history import read_history
from flatcloth.export.session import OpenedSession
from flatcloth.garments.distance import to_edges
from flatcloth.recordings import open_recording
from flatcloth.recordings.base import altered, images_of
from flatcloth.recordings.truth import Truth
from flatcloth.session.document import Document

NAME = "trousers-waist-d435"


class KeptTruth(Truth):
    """Reads each view once: a comparison asks for each seven times."""

    __getitem__ = cache(Truth.__getitem__)  # type: ignore[assignment]


@pytest.fixture(scope="module")
def place() -> str:
    """Return a recording with all of its views: with every second one the result depends on the processor."""
    return str(sample_recordings()[NAME])


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("both") / "session"


@pytest.fixture(scope="module")
def shape(place: str, session: Path):
    found = integrate(open_recording(place), session=session, sides="both", cores=1)
    found.write(session)
    return found


def test_the_other_side_lies_where_the_pattern_has_it(shape, place: str):
    sides = shape.data.sides
    found = compare_sides(shape.view, sides, KeptTruth(place), open_recording(place))
    assert sides.is_related
    assert found.other_seen > 0.25
    assert found.related_median_mm < 8.0
    assert found.related_far_share < 0.03  # and these are said to be unsure:
    assert found.related_within_3_std_share > 0.97
    assert found.other.wrong_side_share < 0.05


def test_a_place_on_a_seam_is_one_place_of_both_planes(shape):
    motion = shape.this_from_other
    assert np.linalg.det(motion[:2, :2]) == pytest.approx(-1.0)  # a mirror
    own, its = np.array(shape.view.origin_uv_m), np.array(shape.other.origin_uv_m)
    for seam in shape.seams:
        if seam.why or seam.this_piece or seam.other_piece:
            continue
        at = (seam.other_uv_m - its) @ motion[:2, :2].T + motion[:2, 2]
        off = np.linalg.norm(at - (seam.this_uv_m - own), axis=1)
        assert np.median(off) < 0.012


def test_what_run_writes_is_read_back(shape, tmp_path: Path):
    names = {file.name for file in shape.write(tmp_path)}
    assert {"flattened-other.npz", "flattened-other.png", "cloud-other.ply"} <= names
    other = flatcloth.read_shape(tmp_path / "flattened-other.npz")
    assert np.array_equal(other.valid, shape.other.valid)
    with np.load(tmp_path / "flattened-other.npz") as arrays:
        assert np.array_equal(arrays["this_from_other"], shape.this_from_other)
    report = json.loads((tmp_path / "outcome.json").read_text())["other_side"]
    assert report["is_related"]
    assert any(seam["joins"] and seam["length_mm"] > 150 for seam in report["seams"])
    assert any("Other side" in line for line in shape.lines())


def test_the_garment_is_exported_as_run_wrote_it(shape, session: Path):
    opened = OpenedSession(history=read_history(session), integration=shape.data.integration)
    assert shape.data.garment.sides is not None
    assert json.loads(made(opened, "garment.json")) == json.loads((session / "garment.json").read_text())


def test_one_outline_fits_the_edges_of_both_sides(shape):
    known = shape.data.garment
    main, alone = known.evidence[0], known.evidence[0].sheets[0]
    assert known.kind == "trousers"
    assert known.sides is not None
    assert len(main.edge_uv_m) > 1.3 * len(alone.edge_uv_m)
    one = GarmentService(shape.data.integration).of(shape.data.document)
    assert one.sides is None
    assert np.array_equal(one.evidence[0].edge_uv_m, alone.edge_uv_m)
    outline = known.found.outline_uv_m
    off_m = np.abs(to_edges(main.edge_uv_m, main.edge_normal, outline).distance)
    assert np.median(off_m) < 0.012


def test_with_one_side_nothing_of_the_other_is_left(shape, tmp_path: Path):
    shape.write(tmp_path)
    one = replace(shape, data=replace(shape.data, both=None))
    one.write(tmp_path)
    assert one.other is None
    assert not any("Other side" in line for line in one.lines())
    assert not list(tmp_path.glob("*other*"))
    assert "other_side" not in json.loads((tmp_path / "outcome.json").read_text())


def test_masks_that_name_both_sides_are_taken_as_they_are(place: str):
    recording, truth = open_recording(place), Truth(place)
    its = OtherTruth(truth, len(recording))

    def named(view: int):
        return images_of(recording[view])._replace(other_mask=its[view].outer_face)

    integration = Integration(altered(recording, read=named))
    mask_of = GarmentService(integration)._masks(Document(), lambda share, text: None)
    for view in (0, 9):
        assert np.array_equal(mask_of(integration.views.frame(view)), its[view].outer_face)


def test_a_named_point_that_only_the_other_side_shows_is_seen_there(shape):
    known, sides = shape.data.garment, shape.data.sides
    recognised = known.found
    hidden = {name: replace(point, pixel=None) for name, point in recognised.points.items()}
    fits = [replace(fit, points=hidden) if hasattr(fit, "points") else fit for fit in recognised.fits]
    blind = replace(known, found=replace(recognised, points=hidden, fits=tuple(fits)))
    points = {point.name: point for point in named_points(blind, sides)}
    assert points
    document = garment_document(blind, sides)["points"]
    for name, point in points.items():
        assert document[name]["side"] == "other"
        seen = recognised.points[name]
        if seen.pixel is not None:  # a corner is one place in space, whichever side shows it
            xyz_m = known.cloth_of(seen).xyz_m[seen.pixel]
            assert np.linalg.norm(point.position_held_m - xyz_m) < 0.04
    assert not named_points(blind, "no other side")
