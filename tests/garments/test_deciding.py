"""Decisions about a garment: applied to what the evidence says, and tied to cloth."""

import dataclasses

import numpy as np
import pytest
from garment_evidence import at_mean, blank_view, evidence_from

from flatcloth.core.types import FlattenedView, Rigid2
from flatcloth.flattening.resampling import place
from flatcloth.garments.deciding import (
    DecidedPieces,
    decided,
    decided_pieces,
    held_point,
    placed_piece,
    pulls_of,
    with_placed_cloth,
)
from flatcloth.garments.evidence import PieceEvidence
from flatcloth.garments.fit import Pull
from flatcloth.garments.recognition import NONE, Recognition, recognise
from flatcloth.session.garment import GarmentDecisions

Skirt = tuple[PieceEvidence, FlattenedView, Recognition]
MOVED = Rigid2(0.6, 0.25, -0.4)


@pytest.fixture(scope="module")
def skirt() -> Skirt:
    """The evidence of a skirt's cloth, its view, and what the evidence says."""
    evidence = evidence_from(at_mean("skirt"))
    view = dataclasses.replace(blank_view(np.ones((40, 40), dtype=bool)), origin_uv_m=(-0.04, -0.04))
    return evidence, view, recognise(view, [evidence])


def test_a_held_point_is_where_it_was_put_and_the_rest_follows_the_edges(skirt: Skirt) -> None:
    evidence, view, found = skirt
    corner = found.points["hem_left"].uv_m
    there = corner + np.array([0.03, 0.0])
    changed = decided(found, [evidence], view, None, [Pull(name="hem_left", uv_m=there)])
    np.testing.assert_allclose(changed.points["hem_left"].uv_m, there)
    assert changed.held == {"hem_left"}
    assert changed.kind == found.kind == "skirt"
    nearest = np.linalg.norm(changed.outline_uv_m - there, axis=1).min()
    assert nearest < 0.006
    # The waist is far from it: its edges were seen, and hold it.
    assert np.linalg.norm(changed.points["waist_left"].uv_m - found.points["waist_left"].uv_m) < 0.012


def test_a_kind_set_by_hand_is_the_answer_and_brings_its_own_points(skirt: Skirt) -> None:
    evidence, view, found = skirt
    changed = decided(found, [evidence], view, "towel", [Pull(name="hem_left", uv_m=np.zeros(2))])
    assert changed.kind == "towel"
    assert changed.by_hand == "towel"
    assert sorted(changed.points) == [f"corner_{n}" for n in range(4)]
    assert changed.held == frozenset()
    assert changed.probabilities == found.probabilities


def sheet_view(valid: np.ndarray) -> FlattenedView:
    sheet: FlattenedView = blank_view(valid, 0.004)
    return sheet


def test_a_held_point_moves_with_the_cloth_when_the_plane_turns() -> None:
    view = sheet_view(np.ones((60, 80), dtype=bool))
    at = np.array([0.35, 0.1])  # beside the cloth
    decisions = GarmentDecisions(held=(held_point("neck_left", at, view),))
    (pull,) = pulls_of(decisions, place([(view, MOVED)]))
    assert pull.name == "neck_left"
    np.testing.assert_allclose(pull.uv_m, MOVED.apply(at), atol=0.004)
    elsewhere = dataclasses.replace(view, xyz_m=view.xyz_m + 0.5)
    assert pulls_of(decisions, elsewhere) == ()


def test_a_placed_piece_stays_on_its_place_when_both_planes_turn_and_the_last_decision_counts() -> None:
    left, right = np.zeros((60, 90), dtype=bool), np.zeros((60, 90), dtype=bool)
    left[:, :40], right[:, 50:] = True, True
    shape, piece = sheet_view(left), sheet_view(right)
    laid = Rigid2(0.1, 0.02, 0.03)
    decision = placed_piece(piece, shape, laid, 0.97, 0.02, accepted=True)
    turned = Rigid2(-1.0, 3.0, 4.0)
    found = decided_pieces(
        GarmentDecisions(pieces=(decision,)), place([(shape, MOVED)]), (place([(piece, turned)]),)
    )
    assert found.refused == frozenset()
    assert found.std_m == {0: 0.02}
    expected = MOVED @ laid @ turned.inverse()
    corner = turned.apply(np.array([0.3, 0.1]))
    np.testing.assert_allclose(found.shape_from_piece[0].apply(corner), expected.apply(corner), atol=0.006)
    refused = dataclasses.replace(decision, accepted=False)
    after = decided_pieces(GarmentDecisions(pieces=(decision, refused)), shape, (piece,))
    assert after.shape_from_piece == {}
    assert after.refused == {0}
    # Once a view joins it to the shape, it floats no more.
    assert decided_pieces(GarmentDecisions(pieces=(decision,)), shape, ()).shape_from_piece == {}


def test_a_point_on_a_placed_piece_is_seen_there(skirt: Skirt) -> None:
    _, view, found = skirt
    name, point = next((n, p) for n, p in found.points.items() if p.pixel is None)
    piece = dataclasses.replace(view, origin_uv_m=(3.0, 4.0))
    pieces = DecidedPieces(
        shape_from_piece={0: Rigid2(0.0, float(point.uv_m[0]) - 3.04, float(point.uv_m[1]) - 4.04)},
        refused=frozenset(),
    )
    seen = with_placed_cloth(found, pieces, (piece,)).points[name]
    assert (seen.pixel, seen.piece) == ((20, 20), 0)
    others = with_placed_cloth(found, DecidedPieces(shape_from_piece={}, refused=frozenset()), (piece,))
    assert others.points[name].pixel is None


def test_an_operator_may_say_that_an_item_is_none_of_the_known_kinds(skirt: Skirt) -> None:
    evidence, view, found = skirt
    changed = decided(found, [evidence], view, NONE)
    assert (changed.kind, changed.by_hand) == (NONE, NONE)
    assert changed.fits == found.fits
