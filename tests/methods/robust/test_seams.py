"""Seams of a flat tube."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_sheets import STEP_M, observed, shape_of
from made_up_tube import (
    COLUMN,
    EVERYTHING,
    OTHER,
    THIS,
    UV,
    Known,
    border_uv,
    bordered,
    in_space,
    joined,
    raster,
    seams,
    side,
)

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import MIRROR, FlattenedView, Float64, LaidPiece, Rigid2
from flatcloth.methods.answers import Seam
from flatcloth.methods.robust.seams.joining import join_sides, other_of, seams_of
from flatcloth.methods.robust.seams.links import (
    motion_onto,
)
from flatcloth.methods.robust.seams.rims import meeting, rim_of
from flatcloth.session.garment import DecidedSeam
from flatcloth.shape.joints import LEAST_PIECE
from flatcloth.shape.observations import Nodes
from flatcloth.shape.shape import PIECES_APART_M, Shape

VIEWS = [raster(THIS, UV, is_other=False)], [raster(OTHER, UV, is_other=True)]


def test_rims_of_both_sides_meet_along_the_whole_seam_at_equal_places():
    own, its = map(rim_of, VIEWS, bordered(VIEWS))
    a, b = meeting(own, its)
    assert a.size > 0.9 * len(own)
    assert np.linalg.norm(own.xyz_m[a, :2] - its.xyz_m[b, :2], axis=1).max() < 0.009
    assert set(own.view_index) == {1}


def test_rims_meet_only_where_both_sheets_were_seen_to_end():
    (own_ends,), (its_ends,) = bordered(VIEWS)
    own = rim_of(VIEWS[0], [Known(own_ends.edge_uv_m[own_ends.edge_uv_m[:, 1] < 0.06])])
    a, _ = meeting(own, rim_of(VIEWS[1], [its_ends]))
    assert a.size > 20
    assert own.uv_m[a, 1].max() < 0.08
    its_ends.edge_trust[:] = 0.4  # hardly anybody saw it
    assert not len(rim_of(VIEWS[1], [its_ends]))


def test_cloth_that_lies_on_other_cloth_and_faces_the_same_way_has_no_seam_with_it():
    own = rim_of(VIEWS[0], bordered(VIEWS)[0])
    a, b = meeting(own, own)  # a copy of this side: the same rims, run in the same direction
    assert a.size == b.size == 0


def test_a_side_without_cloth_meets_nothing():
    (view,), (ends,) = VIEWS[0], bordered(VIEWS)[0]
    empty = replace(view, valid=np.zeros_like(view.valid))
    a, _ = meeting(rim_of([view], [ends]), rim_of([empty], [ends]))
    assert a.size == 0


def test_both_sides_lie_on_each_other_wherever_the_other_one_lay_before():
    shift = np.array([0.7, -0.2])
    moved = replace(OTHER, all_uv_m=OTHER.all_uv_m + shift)
    found = joined(THIS, moved)
    assert found.is_related
    assert np.linalg.norm(found.shape.all_uv_m * MIRROR - UV, axis=1).max() < 0.004
    assert (found.shape.std_m < 0.02).all()
    (seam,) = seams(found)
    assert seam.why == ""
    assert seam.length_m == pytest.approx(2 * (0.24 + 0.20), rel=0.1)
    assert set(seam.views[:, 0]) == {1}
    assert set(seam.views[:, 1]) == {3}


SPLIT = (COLUMN < 11) | (COLUMN > 18)
ON_RIGHT = COLUMN[SPLIT] > 18


def falsely_joined(*, is_other: bool, strength: float) -> tuple[Shape, FlattenedView, Float64]:
    """A side whose halves are joined 64 mm too near, over a fold that hides the cloth; and its pattern."""
    pattern = UV[SPLIT]
    false = pattern - np.outer(ON_RIGHT * 8 * STEP_M, [1.0, 0.0])
    own = false * (MIRROR if is_other else 1.0)
    everything = np.ones(len(own), dtype=bool)
    shape = shape_of(own, [observed(own, everything, 0, evidence=strength)])
    xyz, normal = in_space(pattern, is_other=is_other)
    shape = replace(shape, nodes=Nodes(xyz_m=xyz, normal=normal, weight=np.ones(len(own))))
    flat = raster(shape, false, is_other=is_other)  # where the cloth is in space is set apart again
    at = flat.uv_from_rc(np.argwhere(np.ones(flat.shape, dtype=bool))) * (MIRROR if is_other else 1.0)
    to_right = at[:, 0] > 10.5 * STEP_M
    xyz_m = flat.xyz_m + to_right.reshape(*flat.shape, 1) * np.float32([8 * STEP_M, 0.0, 0.0])
    return shape, replace(flat, xyz_m=xyz_m), pattern


def test_a_false_link_of_the_other_side_is_cut_and_its_parts_lie_where_seams_say():
    shape, flat, pattern = falsely_joined(is_other=True, strength=0.5)
    pieces = [raster(THIS, UV, is_other=False)], [flat]
    found = other_of(join_sides(THIS, shape, pieces, bordered(pieces)))
    placed = found.shape.placed
    assert placed.mean() > 0.9
    assert np.linalg.norm(found.shape.all_uv_m[placed] * MIRROR - pattern[placed], axis=1).max() < 0.006


@pytest.mark.parametrize(("strength", "is_torn"), [(0.05, True), (200.0, False)])
def test_a_seam_that_needs_a_false_link_of_this_side_joins_nothing(strength, is_torn):
    """It needs one if hardly any cloth joins that: then a sure seam contradicts it."""
    shape, flat, _ = falsely_joined(is_other=False, strength=strength)
    believed = side(EVERYTHING, is_other=True, strength=40.0)
    pieces = [flat], [raster(believed, UV, is_other=True)]
    found = join_sides(shape, believed, pieces, bordered(pieces))
    assert any("this side" in link.why for link in found.links) == is_torn


def test_places_of_another_rim_hardly_turn_a_seam():
    along = np.linspace(0.0, 0.18, 30)
    seam = np.stack([along, 0.01 * np.sin(20.0 * along)], axis=1)
    motion = Rigid2(theta_rad=0.3, u_m=0.2, v_m=-0.1)
    seen = motion.apply(seam)
    seen[-6:, 1] += 0.011
    found = motion_onto(seam, seen)
    assert np.abs(found.apply(seam) - motion.apply(seam)).max() < 0.001
    assert np.abs(fit_rigid2(seam, seen).apply(seam) - motion.apply(seam)).max() > 0.004


def test_few_places_join_nothing_and_the_other_side_keeps_its_largest_piece():
    small = UV[:, 0] < 4 * STEP_M
    small &= UV[:, 1] < 4 * STEP_M
    found = joined(THIS, side(small, is_other=True), other_at=UV[small])
    assert not found.is_related
    assert (found.shape.piece == 0).any()
    assert np.isnan(found.shape.std_m).all()  # nothing says where it lies
    for seam in seams(found):
        assert seam.probability < 0.5
        assert "too few" in seam.why


def decision(seam: Seam, *, kept: bool) -> DecidedSeam:
    """What an operator decides about a seam: some of its places, which shake a little until it is asked."""
    shaken = seam.xyz_m[::3] + np.random.default_rng(0).normal(0.0, 0.003, (len(seam.xyz_m[::3]), 3))
    return DecidedSeam(kept=kept, points_m=tuple(map(tuple, shaken.tolist())))


def test_a_seam_that_the_operator_cut_joins_nothing_until_it_is_kept():
    (seam,) = seams(joined(THIS, OTHER))
    cut = decision(seam, kept=False)
    without = joined(THIS, OTHER, decided=(cut,))
    assert not without.is_related
    assert [(s.why, s.decided) for s in seams(without)] == [("cut by the operator", "cut")]
    again = joined(THIS, OTHER, decided=(cut, decision(seam, kept=True)))  # the last one counts
    assert again.is_related
    assert [(s.why, s.decided) for s in seams(again)] == [("", "keep")]


def test_a_small_seam_that_lays_true_edges_on_the_other_sheet_joins_nothing_unless_it_is_kept():
    small = (UV[:, 0] < 7 * STEP_M) & (UV[:, 1] < 7 * STEP_M)
    other, at = side(small, is_other=True), UV[small]
    hem = UV.mean(axis=0) + np.stack([np.linspace(-0.05, 0.05, 1000), np.zeros(1000)], axis=1)
    own, its = border_uv(VIEWS[0][0]), border_uv(raster(other, at, is_other=True))
    with_hem = [Known(own, half_m=0.1)], [Known(np.concatenate([its, hem * MIRROR]))]
    (seam,) = seams(joined(THIS, other, other_at=at, ends=with_hem))
    assert "true edges" in seam.why
    kept = joined(THIS, other, decided=(decision(seam, kept=True),), other_at=at, ends=with_hem)
    assert kept.is_related
    assert np.linalg.norm(kept.shape.all_uv_m * MIRROR - at, axis=1).max() < 0.004
    (seam,) = seams(joined(THIS, other, other_at=at))
    assert seam.why == ""
    few, at_rim = hem[:10] * MIRROR, UV[COLUMN == 0] * MIRROR
    for edges, lower in ((few, 0.02), (at_rim, 0.0)):
        edges = np.concatenate([its, edges])
        (again,) = seams(joined(THIS, other, other_at=at, ends=(with_hem[0], [Known(edges)])))
        assert (seam.probability - again.probability > lower) == (lower > 0.0)


def test_a_floating_piece_of_this_side_and_its_back_are_one_piece():
    """Two halves that nothing joins: the back of each lies on its half, and only one is the shape."""
    left, right = COLUMN < 13, COLUMN > 19
    seen = left | right
    pattern, is_right = UV[seen], right[seen]
    shift = np.outer(np.where(is_right, PIECES_APART_M, 0.0), [1.0, 0.0])

    def halves(*, is_other: bool) -> Shape:
        whole = side(seen, is_other=is_other)
        return replace(
            whole,
            all_uv_m=(pattern * MIRROR if is_other else pattern) + shift,
            piece=is_right.astype(np.int32),
        )

    found = joined(halves(is_other=False), halves(is_other=True), pattern, pattern)
    assert found.is_related
    assert (found.shape.piece[~is_right] == 0).all()
    assert (found.shape.piece[is_right] > 0).all()
    off = found.shape.all_uv_m[is_right] * MIRROR - pattern[is_right]
    assert np.ptp(off, axis=0).max() < 0.004  # rigidly beside its half, on the plane of both
    assert off[:, 0].mean() > 0.5 * PIECES_APART_M
    assert {(seam.this_piece, seam.other_piece) for seam in seams(found) if not seam.why} == {(0, 0), (1, 1)}
    without_right = [raster(found.shape, found.shape.all_uv_m * MIRROR, 0, is_other=True)]
    assert {(seam.this_piece, seam.other_piece) for seam in seams_of(found, without_right)} == {(0, 0)}


def test_pairs_that_a_side_cut_stay_cut_where_seams_lead_past_them():
    row = np.rint(UV[:, 1] / STEP_M)
    lower = row > 9
    shift = np.outer(np.where(lower, PIECES_APART_M, 0.0), [1.0, 0.0])
    whole = side(EVERYTHING, is_other=False)
    joins = lower[whole.graph.pairs[:, 0]] == lower[whole.graph.pairs[:, 1]]
    this = replace(whole, holds=joins, all_uv_m=UV + shift, piece=lower.astype(np.int32))
    far = (row < 9) | (row > 10)
    its_lower = lower[far]
    other = side(far, is_other=True)
    other = replace(other, all_uv_m=UV[far] * MIRROR + shift[far], piece=its_lower.astype(np.int32))
    found = joined(this, other, UV, UV[far])
    np.testing.assert_array_equal(found.shape.piece > 0, its_lower)


def test_a_floating_piece_takes_with_it_what_lies_on_the_same_back():
    """The right half of this side floats in two pieces; one has a known place, their back joins them."""
    left, upper = COLUMN < 10, UV[:, 1] < 9 * STEP_M
    right, lower = COLUMN > 15, UV[:, 1] > 14 * STEP_M
    seen = left | (right & (upper | lower))
    number = np.where(left, 0, np.where(upper, 1, 2))[seen].astype(np.int32)
    pattern = UV[seen]
    whole = side(seen, is_other=False)
    this = replace(whole, all_uv_m=pattern + np.outer(number * PIECES_APART_M, [1.0, 0.0]), piece=number)
    back = side(left | right, is_other=True, strength=200.0)
    at = UV[left | right]
    its = np.where(at[:, 0] > 12 * STEP_M, 1, 0).astype(np.int32)
    other = replace(back, all_uv_m=at * MIRROR - np.outer(its * PIECES_APART_M, [1.0, 0.0]), piece=its)
    known = LaidPiece(index=0, shape_from_piece=Rigid2(0.0, -PIECES_APART_M, 0.0), std_m=0.02)
    found = joined(this, other, pattern, at, laid=(known,))
    (follows,) = found.laid
    assert follows.index == 1
    there = follows.shape_from_piece.apply(this.all_uv_m[number == 2])
    assert np.linalg.norm(there - pattern[number == 2], axis=1).max() < 0.006
    assert follows.std_m >= known.std_m
    assert (found.shape.std_m[its == 1] >= known.std_m).all()


@pytest.mark.parametrize(("strength", "is_known"), [(0.05, False), (200.0, True)])
def test_pieces_that_cloth_of_the_other_side_joins_are_as_unsure_as_it_is(strength, is_known):
    """The two halves of this side hang together by their back alone."""
    left, right = COLUMN < 13, COLUMN > 16
    seen = left | right
    pattern, number = UV[seen], right[seen].astype(np.int32)
    whole = noisy(side(seen, is_other=False))
    this = replace(whole, all_uv_m=pattern + np.outer(number * PIECES_APART_M, [1.0, 0.0]), piece=number)
    found = joined(this, side(EVERYTHING, is_other=True, strength=strength), pattern)
    assert all(not seam.why for seam in seams(found))
    assert found.is_related
    (piece,) = found.laid
    there = piece.shape_from_piece.apply(this.all_uv_m[number == 1])
    assert np.linalg.norm(there - pattern[number == 1], axis=1).max() < 0.006
    assert (piece.std_m < 0.02) == is_known
    assert (piece.std_m > 0.05) != is_known, "it may be anywhere"


def noisy(shape: Shape) -> Shape:
    return replace(shape, observations=tuple(replace(view, is_noisy=True) for view in shape.observations))


def test_another_side_of_a_few_places_only_is_refused_in_words():
    few = (COLUMN < 3) & (UV[:, 1] < 2.5 * STEP_M)
    other = side(few, is_other=True)
    assert 1 < few.sum() < LEAST_PIECE
    with pytest.raises(FlatclothError, match="too little cloth of the other side"):
        joined(THIS, replace(other, piece=np.zeros_like(other.piece)), other_at=UV[few])


def test_a_piece_is_counted_as_it_is_drawn_where_smaller_ones_are_not():
    left, small, lower = COLUMN < 10, UV[:, 1] < 3 * STEP_M, UV[:, 1] > 6 * STEP_M
    seen = left | ((COLUMN > 15) & (small | lower))
    number, at = np.where(left, 0, np.where(small, 1, 2))[seen].astype(np.int32), UV[seen]
    own = at + np.outer(number * PIECES_APART_M, [1.0, 0.0])
    this = replace(side(seen, is_other=False), all_uv_m=own, piece=number)
    back = side(EVERYTHING, is_other=True, strength=200.0)
    pieces = [raster(this, at, n, is_other=False) for n in (0, 2)], [raster(back, UV, is_other=True)]
    (laid,) = other_of(join_sides(this, back, pieces, bordered(pieces))).laid
    assert laid.index == 0
    there = laid.shape_from_piece.apply(own[number == 2])
    assert np.linalg.norm(there - at[number == 2], axis=1).max() < 0.006


def test_the_shape_stays_the_main_piece_when_the_other_side_floats_and_is_larger():
    left = COLUMN < 12
    this = side(left, is_other=False)
    found = joined(this, OTHER, UV[left])
    (seam, *_) = seams(found)
    apart = joined(this, OTHER, UV[left], decided=(decision(seam, kept=False),))
    assert found.is_related
    assert not apart.is_related
