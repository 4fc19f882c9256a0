"""The sheet: floating pieces beside the shape, and the way between what is shown and what is meant."""

import math
from dataclasses import replace

import numpy as np
import pytest
from garment_evidence import blank_view

from flatcloth.core.types import FlattenedView, Rigid2
from flatcloth.engine.sheet import FLOATS, GAP_M, LOOSE, PLACED, lay_out, with_placed_pieces
from flatcloth.garments.deciding import DecidedPieces
from flatcloth.methods.answers import Canonical

PIXEL_M = 0.002


def patch(rows: int, cols: int, origin_uv_m: tuple[float, float], view_index: int = 0) -> FlattenedView:
    u, v = np.meshgrid(np.arange(cols) * PIXEL_M, np.arange(rows) * PIXEL_M)
    xyz = np.stack([u + origin_uv_m[0], v + origin_uv_m[1], np.ones_like(u)], axis=-1).astype(np.float32)
    return blank_view(
        np.ones((rows, cols), dtype=bool), PIXEL_M, xyz_m=xyz, origin_uv_m=origin_uv_m,
        rgb=np.full((rows, cols, 3), 10 * view_index + 5, dtype=np.uint8),
        view_index=np.full((rows, cols), view_index, dtype=np.int16),
    )  # fmt: skip


def canonical(*floating: FlattenedView) -> Canonical:
    return Canonical(view=patch(100, 60, (-0.1, 0.3)), current_from_view={}, floating=floating)


def test_far_pieces_come_beside_the_shape_the_largest_first_and_none_covers_another() -> None:
    small, large = patch(20, 30, (10.0003, -3.0), 2), patch(50, 40, (20.0, 7.0007), 1)
    sheet = lay_out(canonical(small, large))
    assert [p.label for p in sheet.pieces] == ["B", "C"]
    assert [p.views for p in sheet.pieces] == [(1,), (2,)]
    assert {p.reason for p in sheet.pieces} == {FLOATS}
    assert sheet.floating_m2 == pytest.approx((20 * 30 + 50 * 40) * PIXEL_M**2)
    assert [int((sheet.piece == n).sum()) for n in (0, 1, 2)] == [6000, 2000, 600]
    assert (sheet.view.valid == (sheet.piece >= 0)).all()
    left = sheet.pieces[0].view.origin_uv_m[0]
    edge = -0.1 + 59 * PIXEL_M
    assert edge + GAP_M - PIXEL_M <= left <= edge + GAP_M + PIXEL_M
    assert sheet.view.shape[1] * PIXEL_M < 0.5


def test_every_pixel_keeps_its_point_in_space() -> None:
    piece = patch(20, 30, (10.0003, -3.0), 2)
    sheet = lay_out(canonical(piece))
    shown = sheet.view.xyz_m[sheet.piece == 1].reshape(20, 30, 3)
    np.testing.assert_array_equal(shown, piece.xyz_m)
    rc = np.argwhere(sheet.piece == 1)[0]
    there = sheet.view.uv_from_rc(rc) - np.array(sheet.pieces[0].shift_m)
    np.testing.assert_allclose(there, piece.origin_uv_m, atol=1e-9)


def test_a_piece_whose_place_is_not_reliable_stays_there_and_the_shape_covers_it() -> None:
    sheet = lay_out(canonical(patch(20, 40, (-0.02, 0.4), 3)))
    (piece,) = sheet.pieces
    assert (piece.reason, piece.shift_m) == (LOOSE, (0.0, 0.0))
    assert int((sheet.piece == 0).sum()) == 6000
    assert 0 < int((sheet.piece == 1).sum()) < 800


def test_what_the_shape_does_not_know_of_a_piece_is_unknown_there() -> None:
    made = canonical(patch(20, 30, (10.0, 0.0)))
    std = np.full(made.view.shape, 0.001, dtype=np.float32)
    sheet = lay_out(replace(made, view=replace(made.view, placement_std_m=std)))
    assert np.isnan(sheet.view.placement_std_m[sheet.piece == 1]).all()
    assert (sheet.view.placement_std_m[sheet.piece == 0] == np.float32(0.001)).all()


def test_a_placement_on_a_piece_is_shown_there_and_meant_where_it_is_put() -> None:
    sheet = lay_out(canonical(patch(50, 40, (10.0, 7.0), 1)))
    center = np.array([0.03, 0.02])
    on_piece = Rigid2(0.3, 10.0, 7.03)
    shown = sheet.shown(on_piece, center)
    assert sheet.piece_on_plane(on_piece.apply(center)) == 1
    assert math.dist(shown.apply(center), sheet.pieces[0].view.origin_uv_m) < 0.12
    back = sheet.meant(shown, center)
    np.testing.assert_allclose((back.theta_rad, back.u_m, back.v_m), (0.3, 10.0, 7.03), atol=1e-12)
    # Dragged onto the shape, it is meant there: no far shift is left.
    dragged = Rigid2(0.3, -0.05, 0.4)
    assert sheet.meant(dragged, center) == dragged
    assert sheet.shown(dragged, center) == dragged
    # Far from all cloth, it is shown beside the shape.
    alone = lay_out(canonical())
    far = alone.shown(Rigid2(0.0, 10.0, 0.0), center)
    assert alone.view.origin_uv_m[0] < far.apply(center)[0] < 0.3
    assert alone.meant(far, center) == far


def test_a_piece_placed_by_the_garment_lies_on_the_shape_and_is_found_there() -> None:
    piece = patch(30, 20, (10.0, -3.0), 2)
    # A quarter turn, to the right of the shape: its pixels meet those of the shape's raster.
    motion = Rigid2(math.pi / 2, 0.05, 0.4).about((10.0, -3.0)) @ Rigid2()
    motion = Rigid2(0.0, -9.95, 3.35) @ motion
    sheet = lay_out(canonical(piece), {0: motion})
    (shown,) = sheet.pieces
    assert (shown.label, shown.reason, shown.placed) == ("B", PLACED, motion)
    assert sheet.floating_m2 == 0.0
    assert sheet.shape_m2 == pytest.approx((6000 + 600) * PIXEL_M**2, rel=0.1)
    assert sheet.placed == {0: motion}
    # Each pixel of it is the point of cloth that the motion leads there.
    rows, cols = np.nonzero(sheet.piece == 1)
    assert len(rows) > 400
    there = sheet.view.uv_from_rc(np.stack([rows, cols], axis=1))
    cloth = motion.apply(sheet.view.xyz_m[rows, cols, :2].astype(np.float64))
    np.testing.assert_allclose(cloth, there, atol=PIXEL_M)
    assert (sheet.view.view_index[rows, cols] == 2).all()
    assert sheet.piece_at(there[0]) == 1
    center = np.array([10.02, -2.97])
    own = Rigid2(0.3, 0.001, 0.002).about((10.02, -2.97))
    back = sheet.meant(sheet.shown(own, center), center)
    np.testing.assert_allclose(back.apply(center), own.apply(center), atol=1e-9)


@pytest.mark.parametrize("is_trusted", [True, False])
def test_a_placed_piece_is_written_with_the_shape_as_sure_as_its_place_is(is_trusted: bool) -> None:
    main = patch(20, 30, (0.0, 0.0))
    std = np.where(main.valid, 0.002 if is_trusted else np.nan, np.nan).astype(np.float32)
    made = canonical(patch(10, 10, (5.0, 5.0), view_index=3))
    made = replace(made, view=replace(main, placement_std_m=std))
    pieces = DecidedPieces(
        shape_from_piece={0: Rigid2(0.0, -5.1, -5.0)}, refused=frozenset(), std_m={0: 0.02}
    )
    whole = with_placed_pieces(made, pieces).view
    added = whole.valid & (whole.view_index == 3)
    assert added.sum() == 100
    assert whole.valid.sum() == 700
    own = whole.placement_std_m
    known = np.unique(own[added])
    np.testing.assert_allclose(known, [0.02 if is_trusted else np.nan], rtol=1e-6)
    assert with_placed_pieces(made, DecidedPieces(shape_from_piece={}, refused=frozenset())) is made
