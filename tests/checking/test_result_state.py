"""What a result says about its recording."""

import json
import math
from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

import flatcloth
from flatcloth.checking.check import checked, known_check
from flatcloth.checking.findings import Check, Finding
from flatcloth.checking.hypotheses import FOCAL_STD
from flatcloth.checking.result import LEAST_VIEWS, contradicting_views, is_hopeless, wrong_with
from flatcloth.core.errors import GarmentError
from flatcloth.core.geometry import object_from_camera
from flatcloth.engine.garment import GarmentService, KnownGarment
from flatcloth.engine.trust import Trust
from flatcloth.export.garment import lines_of
from flatcloth.garments.deciding import DecidedPieces
from flatcloth.garments.named_points import Measure, Point
from flatcloth.garments.recognition import NONE, Recognition
from flatcloth.recordings import open_recording
from flatcloth.recordings.mending import Mends, mended
from flatcloth.registration.cameras import register
from flatcloth.registration.pairwise import PairFit
from flatcloth.session.document import Document

RIGHT = "shirt-corner-d435"


def _registered(views=10, turned_deg=0.0, swung_deg=0.0, beside_m=0.0):
    """A registration of which one view was turned or swung, or whose axis was moved."""
    recording = open_recording(RIGHT)
    own = np.zeros((views, 3))
    own[-1] = np.radians([turned_deg, swung_deg, 0.0])
    begun = register([], recording.rotation_axis, recording.held_point_m)
    return replace(begun, features=(None,) * views, own=own, common=np.array([beside_m, 0.0, 0.0, 0.0, 0.0]))


def test_corrections_of_careless_recordings_are_no_doubt():
    careless = _registered(turned_deg=4.5, swung_deg=2.5, beside_m=0.018)
    assert wrong_with(None, careless, 0.3) == []
    assert not is_hopeless(None, careless)


@pytest.mark.parametrize(
    ("corrections", "word"),
    [({"turned_deg": -8.1}, "turns"), ({"swung_deg": 6.0}, "swings"), ({"beside_m": 0.03}, "axis")],
)
def test_corrections_that_no_recording_needs_are(corrections, word):
    (said,) = wrong_with(None, _registered(**corrections), 0.0)
    assert word in said
    assert is_hopeless(None, _registered(**corrections))
    assert wrong_with(None, _registered(LEAST_VIEWS - 1, **corrections), 0.0) == []


def _compared(views, off_m):
    """A registration of views each compared with its four neighbours; the last ones are off by so much."""
    registered = _registered(views)
    precision = np.diag([1e6] * 6 + [1.0])  # a millimetre, a milliradian, a pixel
    pairs = tuple(
        PairFit(
            first=one, second=other, center_m=np.zeros(3),
            twist=np.array([0.0, 0.0, 0.0, off_m.get((one, other), 0.0), 0.0, 0.0]), fattening_px=0.0,
            matrix=precision, gradient=np.zeros(7), count=100,
        )
        for one, other in combinations(range(views), 2)
        if other - one <= 2
    )  # fmt: skip
    features = tuple(SimpleNamespace(view_index=3 * n, angle_deg=10.0 * n) for n in range(views))
    known = tuple(object_from_camera(registered.axis, 10.0 * n) for n in range(views))
    return replace(registered, features=features, known=known, pairs=pairs)


_OFF_ONE = {(2, 4): 0.02, (3, 4): 0.02, (4, 5): 0.02, (4, 6): 0.02}
_OFF_TWO = {(0, 2): 0.02, (1, 2): 0.02, (2, 3): 0.02}


def test_surprise_counts_in_stated_deviations_and_by_what_an_item_bends():
    registered = _compared(8, {(2, 3): 0.003})
    surprise = 9.0 / (1.0 + 0.1**2)  # 3 mm, with deviations of 1 and 0.1 mm
    assert registered.surprises == pytest.approx(
        [surprise if (p.first, p.second) == (2, 3) else 0.0 for p in registered.pairs], abs=1e-6
    )


def test_what_a_swaying_item_bends_is_no_contradiction_however_exact_the_sensor_is():
    bent = _compared(8, {(2, 3): 0.0002, (3, 4): 0.0002, (3, 5): 0.0002})
    exact = np.diag([1e12] * 6 + [1.0])  # a micrometre
    pairs = tuple(replace(pair, matrix=exact) for pair in bent.pairs)
    assert wrong_with(None, replace(bent, pairs=pairs), 0.0) == []
    off = _compared(8, _OFF_ONE)
    pairs = tuple(replace(pair, matrix=exact) for pair in off.pairs)
    assert len(wrong_with(None, replace(off, pairs=pairs), 0.0)) == 1


def test_views_that_contradict_half_of_the_others_are_a_doubt():
    assert wrong_with(None, _compared(8, {}), 0.0) == []
    assert wrong_with(None, _compared(8, {(2, 3): 0.05}), 0.0) == []  # a sleeve that moved once
    assert wrong_with(None, _compared(8, {(2, 3): 0.006, (3, 4): 0.006}), 0.0) == []  # noise
    (said,) = wrong_with(None, _compared(8, {(2, 3): 0.05, (3, 4): 0.05}), 0.0)
    assert said.startswith("View 9 contradicts the others")
    (said,) = wrong_with(None, _compared(8, {(2, 4): 0.05, (3, 4): 0.05, (2, 3): 0.05}), 0.0)
    assert said.startswith("3 of 8 views contradict the others")


def test_a_shape_of_no_known_kind_is_no_doubt_alone_but_needs_less():
    assert wrong_with(None, _compared(8, {}), 0.0, fits_none=True) == []
    between = _compared(8, {(2, 3): 0.0066, (3, 4): 0.0066})  # 43.1, between the limits
    assert wrong_with(None, between, 0.0) == []
    assert wrong_with(None, between, 0.0, fits_none=True)[-1] == "no known kind of garment fits"


def test_a_run_ends_once_two_views_contradict_or_one_of_a_doubted_recording():
    one, two = _compared(8, _OFF_ONE), _compared(8, _OFF_ONE | _OFF_TWO)
    assert contradicting_views(one) == [12]
    assert contradicting_views(two) == [6, 9, 12]
    doubted = Check(findings=(Finding(name="rotated", text="It hangs upside down", probability=0.9),))
    assert [is_hopeless(Check(), found) for found in (one, two)] == [False, True]
    assert is_hopeless(doubted, one)


def test_cloth_most_of_which_floats_is():
    assert "floats" in wrong_with(None, _registered(), 0.8)[0]
    assert not is_hopeless(None, _registered())


def service_of(found, monkeypatch, wrong=(), focal_factor=1.0):
    """Return a service that recognises a given garment."""
    shape = SimpleNamespace(view=SimpleNamespace(valid=np.ones((2, 2), bool)), taken_off=frozenset())
    none = DecidedPieces(shape_from_piece={}, refused=frozenset())
    known = KnownGarment(canonical=shape, evidence=(), by_evidence=found, found=found, pieces=none)
    recording = SimpleNamespace(mends=Mends(focal_factor=focal_factor), is_growing=False)
    integration = SimpleNamespace(
        recording=recording,
        is_unattended=False,
        laid_out=lambda _: shape,
        wrong=lambda _: wrong,
        trust=Trust(recording),
    )
    service = GarmentService(integration)
    monkeypatch.setattr(service, "_recognised", lambda *_: known)
    monkeypatch.setattr(service, "_decided", lambda *_: known)
    return service


def recognition(probabilities, **more):
    side_m = math.sqrt(0.12)
    outline = side_m * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    square = SimpleNamespace(kind=SimpleNamespace(name="towel"), outline=outline)
    return Recognition(
        probabilities=probabilities, fits=(square,), **{"dimensions": {}, "points": {}, **more}
    )


@pytest.mark.parametrize(
    ("wrong", "focal_factor", "std_m"),
    [([], 1.0, 0.01), ([], 0.8, math.hypot(0.01, 0.5 * FOCAL_STD)), (["views contradict"], 1.0, None)],
)
def test_a_wrong_result_has_no_lengths_and_an_estimated_camera_unsure_ones(
    wrong, focal_factor, std_m, monkeypatch
):
    found = recognition({"towel": 0.9, NONE: 0.1}, dimensions={"width": Measure(value_m=0.5, std_m=0.01)})
    service = service_of(found, monkeypatch, wrong, focal_factor)
    lengths = service.of(Document()).found.dimensions
    assert [length.std_m for length in lengths.values()] == pytest.approx([] if wrong else [std_m])
    assert service.of(Document()).is_wrong == bool(wrong)


@pytest.mark.parametrize(
    ("none", "towel", "by_hand", "growing", "finished"),
    [
        (0.3, 0.35, None, 0.0, 0.3),  # further views may tell whether it is one
        (0.05, 0.77, None, 0.0, 0.0),
        (0.4, 0.35, None, 0.4, 0.4),
        (0.4, 0.35, NONE, 0.0, 0.0),
        (0.3, 0.35, "towel", 0.0, 0.0),
    ],
)
def test_a_shape_is_doubted_of_no_kind_or_finished_of_none_that_is_sure_unless_somebody_names_one(
    none, towel, by_hand, growing, finished, monkeypatch
):
    shares = {"towel": towel, "skirt": 1.0 - none - towel, NONE: none}
    width, point = Measure(value_m=0.5, std_m=0.01), Point(uv_m=np.zeros(2), std_m=0.004, pixel=(0, 0))
    found = recognition(shares, by_hand=by_hand, dimensions={"width": width}, points={"neck": point})
    service = service_of(found, monkeypatch)
    for document, doubt in ((Document(), growing), (Document(finished="All views."), finished)):
        known = service.of(document)
        assert known.doubt == pytest.approx(doubt)
        away_m = math.sqrt(doubt * 0.04)  # of two places of the outline, in the root mean square 0.2 m apart
        assert known.found.dimensions["width"].std_m == pytest.approx(math.hypot(0.01, away_m))
        assert known.found.points["neck"].std_m == pytest.approx(math.hypot(0.004, away_m))


def test_a_finished_run_says_that_it_may_be_none_of_the_kinds(monkeypatch):
    shares = {"towel": 0.5, "skirt": 0.2, NONE: 0.3}
    service = service_of(recognition(shares), monkeypatch)
    assert len(lines_of(service.of(Document()))) == 2
    assert "nothing is called reliable" in lines_of(service.of(Document(finished="All views.")))[1]


def test_a_result_of_a_wrong_recording_calls_nothing_reliable():
    two_of_three = tuple(n for n in range(36) if n % 3)
    wrong = mended(open_recording(RIGHT), Mends(reverse=True, leave_out=two_of_three))
    assert known_check(wrong) is None
    checked(wrong)
    shape = flatcloth.integrate(wrong, cores=1)
    assert shape.report["firm_share"] == 0.0
    assert np.isnan(shape.placement_std_m).all()
    integration, document = shape.data.integration, shape.data.document
    assert integration.canonical(document) is integration.canonical(document)  # or the garment is fitted anew
    assert "the other way" in shape.report["wrong"][0]
    assert "Nothing of the result is reliable" in str(shape)
    with pytest.raises(GarmentError, match="No garment is recognised"):
        shape.garment()
    assert "placement_std_median_mm" not in json.loads(json.dumps(shape.report, allow_nan=False))
