"""Both sides of a garment: one outline for the edges of both, and what may lie over what."""

import dataclasses

import cv2
import numpy as np
import pytest
from garment_evidence import at_mean, blank_view

from flatcloth.core.types import Rigid2
from flatcloth.engine.garment import _with_joined
from flatcloth.garments.distance import inside_outline, to_edges
from flatcloth.garments.evidence import PieceEvidence
from flatcloth.garments.example import seen_outline
from flatcloth.garments.fit import refine
from flatcloth.garments.kinds import kind_named
from flatcloth.garments.placing import contradiction
from flatcloth.methods.answers import Canonical, JoinedSides, Seam


def with_depth(outline: np.ndarray) -> PieceEvidence:
    """Return the evidence of a whole sheet, with how deep inside of its border its cloth lies."""
    pixel_m, first = 0.004, outline.min(axis=0)
    columns, rows = (np.arange(first[k], outline[:, k].max(), pixel_m) for k in (0, 1))
    at = np.stack(np.meshgrid(columns, rows), axis=-1)
    solid = inside_outline(at.reshape(-1, 2), outline).reshape(at.shape[:2])
    return dataclasses.replace(
        seen_outline([outline]),
        depth_m=(cv2.distanceTransform(solid.astype(np.uint8), cv2.DIST_L2, 5) * pixel_m).astype(np.float32),
        depth_origin_uv_m=first,
        depth_pixel_m=pixel_m,
    )


def test_seams_of_both_sides_are_one_outline_and_the_lower_neckline_is_left_out() -> None:
    kind = kind_named("tshirt")
    lower = kind.mean.copy()
    lower[[p.name for p in kind.parameters].index("neck_depth")] += 0.08
    front, back = (kind.outline(p[:, None])[:, :, 0] for p in (lower, kind.mean))
    off_center = np.array([0.1, 0.0])  # so that a mirror shows
    this, other = with_depth(front + off_center), with_depth((back + off_center)[::-1] * [-1.0, 1.0])
    both = this.with_other_side(other)
    assert both.sheets[0] is this
    assert this.sheets[0] is this
    off_m = to_edges(both.edge_uv_m, both.edge_normal, back + off_center).distance
    assert np.abs(off_m).max() < 0.021  # 5 standard deviations of the edges
    alone_m = to_edges(this.edge_uv_m, this.edge_normal, back + off_center).distance
    assert alone_m.min() < -0.06
    assert len(both.edge_uv_m) > 1.8 * (np.abs(alone_m) < 0.021).sum()
    neck = np.array([[0.1, back[0, 1] + 0.03]])  # behind the neck is the other side only
    behind = both.sheets[1]
    assert this.depth_at(neck) == 0.0
    assert behind.depth_at(neck)[0] == pytest.approx(other.depth_at(neck * [-1.0, 1.0])[0], abs=0.006)
    assert both.inside_stds(neck, 0.008) == pytest.approx(behind.inside_stds(neck, 0.008))
    assert both.inside_stds(neck, 0.008) > 2.0 > 0.0 > this.inside_stds(neck, 0.008)


def test_a_piece_may_lie_over_cloth_of_the_other_side_but_not_of_its_own() -> None:
    kind = kind_named("towel")
    outline = at_mean(kind.name)
    whole = with_depth(outline)
    left, right = (whole.inside_uv_m[:, 0] < 0.0, whole.inside_uv_m[:, 0] >= 0.0)

    def half(sheet: PieceEvidence, insides: np.ndarray, side: float) -> PieceEvidence:
        rows, cols = sheet.depth_m.shape
        shown = (sheet.depth_origin_uv_m[0] + np.arange(cols) * sheet.depth_pixel_m) * side > 0.0
        edges = sheet.edge_uv_m[:, 0] * side > 0.0
        return sheet.part(edges, insides, np.argwhere((sheet.depth_m > 0) & shown[None].repeat(rows, 0)))

    this, piece = half(whole, left, -1.0), half(whole, right, 1.0)
    both = this.with_other_side(with_depth(outline[::-1] * [-1.0, 1.0]))
    fit = refine(kind, (whole,), kind.mean, (Rigid2(),))
    there = dataclasses.replace(fit, garment_from_piece=(Rigid2(), Rigid2()))
    on_itself = dataclasses.replace(fit, garment_from_piece=(Rigid2(), Rigid2(0.0, -0.2, 0.0)))
    assert contradiction(there, both, piece) == pytest.approx(contradiction(there, this, piece))
    assert contradiction(on_itself, both, piece) > 10.0 + contradiction(there, both, piece)


def test_a_sheet_on_another_plane_is_evidence_where_its_motion_leads() -> None:
    outline = np.array([[0.0, 0.0], [0.3, 0.0], [0.3, 0.2], [0.0, 0.2]])
    this, moved = with_depth(outline), Rigid2(2.0, 0.4, -0.3)
    mirrored = moved.inverse().apply(outline)
    other = with_depth(mirrored[::-1] * [-1.0, 1.0])
    both = this.with_other_side(other, moved)
    assert len(both.edge_uv_m) > 1.5 * len(this.edge_uv_m)  # but for some at the other's edges
    off = to_edges(both.edge_uv_m, both.edge_normal, outline)
    assert np.abs(off.distance).max() < 0.021  # 5 standard deviations of the edges
    assert np.median((off.away * both.edge_normal).sum(axis=1)) > 0.9
    for place in ([[0.15, 0.1]], [[0.02, 0.1]], [[0.28, 0.15]]):
        at_other = moved.inverse().apply(np.array(place)) * [-1.0, 1.0]
        found = both.sheets[1].depth_at(np.array(place))[0]
        assert found == pytest.approx(other.depth_at(at_other)[0], abs=0.006)
        assert found > 0.01


def test_a_piece_whose_other_side_lies_over_cloth_of_this_one_is_as_probable_there() -> None:
    kind = kind_named("towel")
    outline = at_mean(kind.name)
    main = with_depth(outline)
    away = with_depth(outline + np.array([2.0, 0.0]))
    joined = away.with_other_side(with_depth(outline[::-1] * [-1.0, 1.0]))
    fit = refine(kind, (main,), kind.mean, (Rigid2(),))
    there = dataclasses.replace(fit, garment_from_piece=(Rigid2(), Rigid2()))
    assert contradiction(there, main, joined) == pytest.approx(contradiction(there, main, away))
    assert contradiction(there, main, main) > 10.0 + contradiction(there, main, joined)


def test_what_seams_join_to_a_floating_piece_is_evidence_of_its_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    outline = np.array([[0.0, 0.0], [0.3, 0.0], [0.3, 0.2], [0.0, 0.2]])
    piece, moved = with_depth(outline), Rigid2(2.0, 0.4, -0.3)
    its_uv_m = moved.inverse().apply(outline) * [-1.0, 1.0]
    other = with_depth(its_uv_m[::-1])
    views = [blank_view(np.ones((3, 3), dtype=np.bool_)) for _ in range(3)]
    asked: list[object] = []

    def evidence(*of: object) -> PieceEvidence:
        asked.append(of)
        return other

    monkeypatch.setattr("flatcloth.engine.garment.evidence_of", evidence)
    seam = Seam(
        this_piece=2, other_piece=2, this_uv_m=outline, other_uv_m=its_uv_m, xyz_m=np.zeros((4, 3)),
        views=np.zeros((4, 2), dtype=np.int16), residual_m=np.zeros(4), why="",
    )  # fmt: skip
    canonical = Canonical(view=views[0], current_from_view={}, floating=tuple(views[1:]))
    joined = JoinedSides(other=canonical, seams=(seam,), is_related=True)
    cut = dataclasses.replace(joined, seams=(dataclasses.replace(seam, why="too few places meet"),))
    assert _with_joined(piece, 1, joined, []) is _with_joined(piece, 2, cut, []) is piece
    found = _with_joined(piece, 2, joined, [])
    assert asked == [(views[2], [], [views[0], views[1]])]
    np.testing.assert_allclose(found.edge_uv_m, piece.with_other_side(other, moved).edge_uv_m, atol=1e-9)


@pytest.mark.parametrize("name", ["skirt", "towel"])
def test_sides_that_do_not_bulge_are_straight_between_the_corners(name: str) -> None:
    kind = kind_named(name)
    curved = ["bulge" in each.name or "curve" in each.name for each in kind.parameters]
    straight = np.where(curved, 0.0, kind.mean)[:, None]
    outline = kind.outline(straight)[:, :, 0].astype(np.float32)
    corners = cv2.convexHull(np.array([at[:, 0] for at in kind.named(straight).values()], np.float32))
    assert len(corners) == 4
    off = [abs(cv2.pointPolygonTest(corners, tuple(map(float, at)), True)) for at in outline]
    assert max(off) < 1e-5
    assert cv2.contourArea(outline) == pytest.approx(cv2.contourArea(corners), rel=1e-5)
