"""Where a part hangs on little evidence is found, how surely, and which views hold it."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from garment_evidence import evidence_from, weakly_joined

from flatcloth.core.types import MIRROR, Rigid2
from flatcloth.engine.joints import Alternative, alternatives, joints_of, with_places
from flatcloth.engine.outcome import lines_of
from flatcloth.flattening.cloth import Cloth
from flatcloth.garments.deciding import decided_part
from flatcloth.methods.answers import Seam
from flatcloth.shape.joints import false_share

WEAK, OFF_M = 0.05, 0.004


@pytest.fixture
def cloth() -> Cloth:
    """A sheet of samples 12 mm apart whose left third hangs on by pairs that view 7 saw 4 mm too long."""
    made = weakly_joined(20, 30, weak_after=9, weak=WEAK)
    is_weak = made.evidence == WEAK
    return replace(
        made,
        length_m=made.length_m + np.where(is_weak, OFF_M, 0.0),
        view_index=np.where(is_weak, 7, 2).astype(np.int32),
        is_noisy=True,
    )


def test_a_weakly_joined_part_is_found_with_the_view_the_pairs_and_the_residuals_that_hold_it(cloth) -> None:
    (joint,) = joints_of(cloth)
    assert (joint.part == (cloth.uv_m[:, 0] < 0.114)).all()
    assert joint.share == pytest.approx(1 / 3)
    (held,) = joint.views
    assert (held.view_index, held.pairs) == (7, 20 + 2 * 19)
    assert joint.evidence == pytest.approx(WEAK * held.pairs)
    assert held.residual_m == pytest.approx((OFF_M, OFF_M))
    assert np.allclose(joint.seam_uv_m[:, 0], 9.5 * 0.012)
    even = replace(cloth, evidence=np.ones(len(cloth.edges)))
    assert joints_of(even) == []


def test_a_joint_is_as_probable_as_its_evidence_says_and_certain_without_noise(cloth) -> None:
    (joint,) = joints_of(cloth)
    assert joint.probability == pytest.approx(1.0 - float(false_share(np.array(joint.evidence))))
    right, wrong = alternatives([joint])
    assert (right.joint, wrong.joint, wrong.place) == (None, joint, None)
    assert (right.probability, wrong.probability) == pytest.approx((joint.probability, 1 - joint.probability))
    (certain,) = joints_of(replace(cloth, is_noisy=False))
    assert certain.probability == 1.0
    assert alternatives([certain]) == [Alternative(1.0)]


def test_a_part_that_the_operator_keeps_is_joined_rightly(cloth) -> None:
    (found,) = joints_of(cloth)
    assert not found.is_kept
    (joint,) = joints_of(cloth, [decided_part(cloth, found.part, 0.1, taken_off=False)])
    assert (joint.probability, joint.is_kept) == (1.0, True)


def test_a_part_in_doubt_has_the_places_that_garment_and_seams_know_for_it(cloth, monkeypatch) -> None:
    (found,) = joints_of(cloth)
    there, along = Rigid2(0.3, 0.1, 0.0), Rigid2(0.0, 0.0, 0.2)
    monkeypatch.setattr("flatcloth.engine.joints.place_elsewhere", lambda *_: (there, 0.4))
    doubted = replace(found, probability=0.1)
    rim = cloth.uv_m[doubted.part][:20]
    seam = Seam(
        this_piece=0, other_piece=0, this_uv_m=rim, other_uv_m=along.apply(rim) * MIRROR,
        xyz_m=np.zeros((20, 3)), views=np.zeros((20, 2), dtype=np.int16), residual_m=np.zeros(20),
        why="it contradicts a surer one", probability=0.3,
    )  # fmt: skip
    known: Any = SimpleNamespace(
        evidence=[evidence_from(np.array([(0.0, 0.0), (0.35, 0.0), (0.35, 0.23), (0.0, 0.23)]))],
        found=SimpleNamespace(fit=None),
        sides=SimpleNamespace(seams=[seam]),
    )
    (joint,) = with_places([doubted], cloth, known)
    by_seams, by_garment = joint.places
    assert (by_seams.by, by_garment.by) == ("seams", "garment")
    np.testing.assert_allclose(by_seams.shape_from_part.apply(rim), along.apply(rim), atol=1e-9)
    assert by_garment.shape_from_part == there
    assert (by_seams.probability, by_garment.probability) == pytest.approx((0.3, 0.4 * (0.9 - 0.3)))
    listed = alternatives([joint])
    # Lying anywhere else has the rest, .36; then come the places by seams, by the garment, and as it is.
    assert [a.place and a.place.by for a in listed] == [None, "seams", "garment", None]
    assert listed[-1].joint is None
    assert sum(a.probability for a in listed) == pytest.approx(1.0)
    assert with_places([replace(doubted, probability=1.0)], cloth, known)[0].places == ()
    assert with_places([doubted], cloth, "No garment.") == [doubted]


def test_the_report_names_the_joint_that_most_doubtful_cloth_hangs_on() -> None:
    joint = {"area_cm2": 740.0, "share": 0.37, "probability": 0.71, "evidence": 0.9, "views": [3]}
    report = {
        "recording": "shirt", "start_view": 0, "accepted": [], "left": [], "ended": "No view is left.",
        "area_cm2": 2000.0, "floating_cm2": [], "wrong": [], "joints": [joint],
    }  # fmt: skip
    assert (
        "740 cm2, 37% of the cloth, hang on one joint that is right with a probability of 71.0%."
        in lines_of(report)
    )
    certain = {**report, "joints": [{**joint, "probability": 1.0}]}
    assert not any("joint" in line for line in lines_of(certain))
