"""What makes a shape less reliable: a wrong recording, an estimated scale, a kind that nobody knows."""

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from flatcloth.checking.hypotheses import FOCAL_STD
from flatcloth.core.types import Intrinsics, LaidPiece, Rigid2
from flatcloth.engine.trust import Trust
from flatcloth.garments.recognition import NONE, Recognition
from flatcloth.methods.answers import Canonical, JoinedSides
from flatcloth.recordings.mending import Mends
from flatcloth.recordings.writer import GrowingRecording, RecordingWriter
from flatcloth.session.document import Document
from flatcloth.session.garment import ClothPlaces, DecidedPart, GarmentDecisions

STD_M = 0.003
TWO = Document(start_view=0)
OUTLINES = {
    name: SimpleNamespace(
        kind=SimpleNamespace(name=name), outline=size_m * np.array([[0, 0], [3, 0], [3, 4], [0, 4]])
    )
    for name, size_m in (("towel", 0.1), ("skirt", 0.2))
}
APART_M = math.sqrt((0.3**2 + 0.4**2) / 6.0)
"""Of two places of the towel, which is half as long as the skirt, in the root mean square: a side of length L
has the variance L^2 / 12."""


@dataclass(frozen=True)
class Row:
    """Three pixels, 0.1 m apart, and their deviations."""

    valid: np.ndarray
    placement_std_m: np.ndarray | None
    area_m2: float = 0.1

    def uv_from_rc(self, rc):
        return 0.1 * rc[..., ::-1]


def _shape(std_m: float | None = STD_M) -> Canonical:
    std = None if std_m is None else np.full((1, 3), std_m)
    return Canonical(view=Row(np.ones((1, 3), bool), std), current_from_view={})  # type: ignore[arg-type]


def _of(probabilities: dict[str, float]) -> Recognition:
    return Recognition(
        probabilities=probabilities,
        fits=tuple(OUTLINES[name] for name in probabilities if name != NONE),  # type: ignore[misc]
        dimensions={},
        points={},
    )


def _trust(focal_factor: float = 1.0) -> Trust:
    return Trust(SimpleNamespace(mends=Mends(focal_factor=focal_factor), is_growing=False))  # type: ignore[arg-type]


def _std_m(shape: Canonical) -> np.ndarray:
    return shape.view.placement_std_m[0]


def test_a_shape_without_doubts_stays_the_same_object():
    shape = _shape()
    assert _trust().of(TWO, shape, None) is shape


def test_places_are_as_unsure_as_an_estimated_scale_far_from_the_middle():
    far = math.hypot(STD_M, 0.1 * FOCAL_STD)
    assert _std_m(_trust(0.8).of(TWO, _shape(), None)) == pytest.approx([far, STD_M, far])


def test_a_shape_of_no_known_kind_may_be_anywhere_on_the_item():
    trust, shape = _trust(), _shape()
    trust.recognised(TWO, _of({"towel": 0.2, NONE: 0.8}))
    doubted = trust.of(TWO, shape, None)
    assert _std_m(doubted) == pytest.approx(3 * [math.hypot(STD_M, math.sqrt(0.8) * APART_M)])
    assert trust.of(TWO, shape, None) is doubted  # or the garment is fitted anew
    assert trust.of(replace(TWO, start_view=1), shape, None) is shape
    trust.recognised(TWO, _of({"towel": 0.8, NONE: 0.2}))
    assert trust.of(TWO, shape, None) is shape


def test_a_shape_that_may_well_be_no_garment_is_doubted_once_all_views_were_looked_at():
    trust, shape, all_seen = _trust(), _shape(), replace(TWO, finished="All views were looked at.")
    doubtful = {"towel": 0.7, "skirt": 0.0, NONE: 0.3}
    trust.recognised(TWO, _of(doubtful))
    assert trust.of(TWO, shape, None) is shape
    far = math.hypot(STD_M, math.sqrt(0.3) * APART_M)
    assert _std_m(trust.of(all_seen, shape, None)) == pytest.approx(3 * [far])
    trust.recognised(TWO, _of({"towel": 0.5, "skirt": 0.4, NONE: 0.1}))
    assert trust.of(all_seen, shape, None) is shape  # either kind explains it


def test_the_kind_of_a_recording_that_still_grows_may_follow_from_further_views(tmp_path):
    all_seen = replace(TWO, finished="No view is left.")
    camera = Intrinsics(fx=100.0, fy=100.0, cx=1.0, cy=1.0, width=2, height=2)
    with RecordingWriter(tmp_path, name="grows", intrinsics=camera, depth_scale_m=0.001) as writer:
        trust, shape = Trust(GrowingRecording(writer)), _shape()
        trust.recognised(TWO, _of({"towel": 0.7, "skirt": 0.3}))
        assert trust.of(all_seen, shape, None) is shape
        assert trust.doubt_of_kind(all_seen) == 0.0
        trust.recognised(TWO, _of({"towel": 0.2, NONE: 0.8}))
        assert trust.doubt_of_kind(all_seen) == 0.8


def test_what_the_garment_says_of_a_shape_is_not_said_of_it_without_a_part():
    trust, cloth = _trust(), ClothPlaces(points_m=((0.0, 0.0, 1.0),), uv_m=((0.0, 0.0),))
    trust.recognised(TWO, _of({"towel": 0.2, NONE: 0.8}))
    assert _std_m(trust.of(TWO, _shape(), None)).min() > 0.1
    part = DecidedPart(taken_off=True, part=cloth, rest=cloth, probability=0.7)
    off = replace(TWO, garment=GarmentDecisions(parts=(part,)))
    assert _std_m(trust.of(off, _shape(), None)).max() == STD_M


def test_the_other_side_and_what_it_lays_is_as_unsure_as_this_one():
    trust, shape = _trust(), _shape()
    laid = (LaidPiece(index=0, shape_from_piece=Rigid2(0.0, 0.0, 0.0), std_m=STD_M),)
    sides = JoinedSides(other=_shape(), seams=(), is_related=True, laid=laid)
    assert trust.of_sides(TWO, shape, None, sides).laid == laid
    trust.recognised(TWO, _of({"towel": 0.2, NONE: 0.8}))
    doubted = trust.of_sides(TWO, shape, None, sides)
    far = math.hypot(STD_M, math.sqrt(0.8) * APART_M)
    assert _std_m(doubted.other) == pytest.approx(3 * [far])
    assert doubted.laid[0].std_m == pytest.approx(far)
    assert trust.of_sides(TWO, shape, None, sides) is doubted
    floating = replace(sides, other=_shape(None))
    assert trust.of_sides(TWO, shape, None, floating).other.view.placement_std_m is None
