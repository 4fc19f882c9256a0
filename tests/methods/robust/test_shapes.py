"""The shape of a document: by the set of its views and what was decided, whatever came before."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from made_up_sheets import STEP_M, grid, observed, off_m, shape_of
from scenes import Cylinder

from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import Float64, RgbdFrame, Rigid2
from flatcloth.engine.integration import Integration
from flatcloth.methods.robust.method import RobustMethod
from flatcloth.session.document import NO_COMPONENT, Accepted, Document, Pending
from flatcloth.shape.observations import Observation
from flatcloth.shape.shape import Shape

STEPS = tuple(float(a) for a in range(0, 360, 20))
SHEET = {"angles_deg": STEPS, "span_deg": (-100.0, 100.0)}


def robust(made: Integration) -> RobustMethod:
    assert isinstance(made.algorithm, RobustMethod)
    return made.algorithm


def with_all(*views: int, start: int = 0) -> Document:
    """Views that were accepted where they hang, in this order."""
    return Document(
        start_view=start, accepted=tuple(Accepted(view, Rigid2(), component=NO_COMPONENT) for view in views)
    )


class Jolted(Cylinder):
    """A cylinder of which some views were taken at other angles than recorded."""

    def __getitem__(self, view_index: int) -> RgbdFrame:
        off = {1: 1.5, 17: -2.0}.get(view_index, 0.0)
        there = Cylinder(**{**SHEET, "angles_deg": tuple(a + off for a in STEPS)})  # type: ignore[arg-type]
        return replace(there[view_index], angle_deg=STEPS[view_index])


def drawn(made: Integration, document: Document) -> dict[str, bytes]:
    view = made.canonical(document).view
    assert view.placement_std_m is not None
    assert view.valid.any()
    arrays = {
        name: getattr(view, name)
        for name in ("rgb", "xyz_m", "normal", "valid", "view_index", "source_rc", "placement_std_m")
    }
    return {name: array.tobytes() for name, array in arrays.items()} | {
        "origin": str(view.origin_uv_m).encode()
    }


@pytest.mark.parametrize("item", [Cylinder, Jolted])
def test_views_in_any_order_give_the_same_bytes_whatever_was_asked_on_the_way(item: type[Cylinder]) -> None:
    found = []
    for order, looked_at in (((1, 2, 17), (1, 2)), ((17, 2, 1), ()), ((2, 17, 1), (1,))):
        made = Integration(item(**SHEET))  # type: ignore[arg-type]
        for count in looked_at:  # shapes before the last view was added
            made.canonical(with_all(*order[:count]))
        found.append(drawn(made, with_all(*order)))
    assert found[0] == found[1] == found[2]


@pytest.fixture(scope="module")
def sheet() -> Integration:
    return Integration(Cylinder(**SHEET))  # type: ignore[arg-type]


def test_a_decision_undone_leaves_no_trace(sheet: Integration) -> None:
    before = sheet.canonical(with_all(1, 2))
    with_more = sheet.canonical(with_all(1, 2, 3))
    assert with_more.view.area_m2 > before.view.area_m2
    assert sheet.canonical(with_all(1, 2)) is before
    bytes_before = drawn(sheet, with_all(1, 2))
    robust(sheet).release()
    sheet.canonical(with_all(3, 4))
    assert drawn(sheet, with_all(1, 2)) == bytes_before


def test_a_view_placed_where_its_cloth_hangs_anyway_changes_nothing(sheet: Integration) -> None:
    """To nudge a view by less than two rows of nodes, and to accept it, is no decision about its place."""
    free, shapes = with_all(1, 2), robust(sheet).shapes
    motion = robust(sheet).seen.current_from_component(shapes.of(free), 2, 0)
    assert motion is not None
    near = Rigid2(0.0, 0.003, 0.0) @ motion
    fixed = replace(free, accepted=(free.accepted[0], Accepted(2, near, fixed=True)))
    assert shapes.of(fixed) is shapes.of(free)


def test_another_start_view_turns_the_plane_and_leaves_the_cloth(sheet: Integration) -> None:
    shapes = robust(sheet).shapes
    one, other = shapes.of(with_all(1, 2)), shapes.of(with_all(0, 2, start=1))
    np.testing.assert_array_equal(one.piece, other.piece)
    assert off_m(one.uv_m[one.placed], other.uv_m[one.placed]) < 1e-9


def test_a_part_of_the_views_lies_where_the_whole_has_it(sheet: Integration) -> None:
    whole, earlier = with_all(1, 2), with_all(1)
    all_of_it, part = sheet.canonical(whole).view, robust(sheet).earlier(earlier, whole).view
    assert set(np.unique(part.view_index[part.valid])) <= {0, 1}
    assert 0.5 * all_of_it.area_m2 < part.area_m2 < all_of_it.area_m2
    shift = (np.subtract(part.origin_uv_m, all_of_it.origin_uv_m) / part.pixel_size_m)[::-1]
    row, col = (np.argwhere(part.valid) + np.rint(shift).astype(int)).T
    both = all_of_it.valid[row, col]
    off = np.linalg.norm(all_of_it.xyz_m[row, col] - part.xyz_m[part.valid], axis=1)[both]
    assert both.mean() > 0.95
    assert np.percentile(off, 95) < 0.001


GAP_DEG = (25.0, 40.0)


class Torn(Cylinder):
    """A cylinder without cloth between two angles: nothing joins the smaller part to the larger one."""

    def __getitem__(self, view_index: int) -> RgbdFrame:
        whole = super().__getitem__(view_index)
        _, around = self.surface(view_index)
        mask = whole.mask & ~((around > GAP_DEG[0]) & (around < GAP_DEG[1]))
        return replace(whole, mask=mask, depth_m=np.where(mask, whole.depth_m, np.float32(0.0)))


ANGLES = (0.0, -30.0, -50.0)
"""The last two views show the smaller part from the front."""


@pytest.fixture(scope="module")
def torn() -> Integration:
    return Integration(Torn(angles_deg=ANGLES, span_deg=(-80.0, 80.0)))


def part_of(made: Integration, view: int) -> tuple[int, Rigid2]:
    """The component of a view that shows the smaller part, and the motion from there to the cylinder's."""
    for number, component in enumerate(made.views.flattening(view).components):
        shown = component.view
        flat = Cylinder().flat_uv_m(shown.xyz_m[shown.valid].astype(float))
        if flat[:, 0].min() > np.radians(GAP_DEG[0] + 2.0) * 0.12:
            return number, fit_rigid2(shown.uv_from_rc(np.argwhere(shown.valid)), flat)
    raise AssertionError(f"view {view} does not show the smaller part")


def by_hand(made: Integration, free: Document, view: int, shift_m: float) -> Document:
    """The document with the smaller part of a view laid so far to the left of where it truly lies."""
    shape = robust(made).shapes.of(free)
    flat = Cylinder().flat_uv_m(shape.nodes.xyz_m)
    plane_from_flat = fit_rigid2(flat[shape.placed], shape.uv_m[shape.placed])
    component, flat_from_own = part_of(made, view)
    motion = plane_from_flat @ Rigid2(0.0, -shift_m, 0.0) @ flat_from_own
    rest = tuple(added for added in free.accepted if added.view_index != view)
    return replace(free, accepted=(*rest, Accepted(view, motion, fixed=True, component=component)))


GAP_M = float(np.radians(GAP_DEG[1] - GAP_DEG[0])) * 0.12
LAID_M = GAP_M + 0.02
"""So far to the left the parts overlap by 20 mm."""


def places(shape: Shape, own: np.ndarray) -> tuple[Float64, Float64]:
    return shape.all_uv_m[own], Cylinder().flat_uv_m(shape.nodes.xyz_m[own])


@pytest.mark.parametrize("over_m", [0.02, 0.004])
def test_what_floats_is_joined_where_the_operator_lays_it_and_keeps_its_layout(
    torn: Integration, over_m: float
) -> None:
    free, laid_m = with_all(1, 2), GAP_M + over_m
    before = robust(torn).shapes.of(free)
    assert set(before.piece) >= {0, 1}
    after = robust(torn).shapes.of(by_hand(torn, free, 1, laid_m))
    right = Cylinder().flat_uv_m(after.nodes.xyz_m)[:, 0] > np.radians(GAP_DEG[0] + 2.0) * 0.12
    alone = right & (after.nodes.xyz_m[:, 0] > np.quantile(after.nodes.xyz_m[right, 0], 0.4))
    joined = right & after.placed
    assert joined[right].mean() > 0.9
    assert (after.piece[~right & after.has_place] == 0).all()
    # Both parts are as they were, and lie where they were laid.
    found, true = places(after, ~right & after.placed)
    assert off_m(found, true) < 0.004
    plane_from_flat = fit_rigid2(true, found)
    found, true = places(after, joined & alone)
    assert off_m(found, true) < 0.004
    laid = plane_from_flat.inverse().apply(found) - true
    np.testing.assert_allclose(np.median(laid, axis=0), [-laid_m, 0.0], atol=0.004)
    assert after.vouched.any()


def test_the_page_is_told_which_piece_a_view_would_join_where_it_is_moved(torn: Integration) -> None:
    free = with_all(2)
    moved = by_hand(torn, with_all(1, 2), 1, LAID_M).accepted[-1]
    pending = Pending(1, Rigid2(), nudge=moved.current_from_new, component=moved.component)
    found = robust(torn).joined_piece(replace(free, pending=pending))
    shape = robust(torn).shapes.of(free)
    own = shape.piece == found.piece
    assert found.piece > 0
    laid, true = found.target_from_piece.apply(shape.all_uv_m[own]), places(shape, own)[1]
    main = places(shape, shape.placed)
    there = fit_rigid2(main[1], main[0]).apply(true - (LAID_M, 0.0))
    assert np.linalg.norm(laid - there, axis=1).max() < 0.004
    unmoved = Pending(1, moved.current_from_new, component=moved.component)
    assert robust(torn).joined_piece(replace(free, pending=unmoved)) is None


def test_the_order_of_other_views_changes_nothing_about_what_was_laid_by_hand(torn: Integration) -> None:
    shapes = robust(torn).shapes
    one = by_hand(torn, with_all(1, 2), 1, LAID_M)
    other = replace(one, accepted=one.accepted[::-1])
    first = shapes.of(one)
    again = robust(Integration(Torn(angles_deg=ANGLES, span_deg=(-80.0, 80.0)))).shapes.of(other)
    np.testing.assert_array_equal(again.all_uv_m, first.all_uv_m)
    np.testing.assert_array_equal(again.std_m, first.std_m)


UV = grid(10, 24)
EVERYTHING = np.ones(len(UV), dtype=bool)


def views_of_the_sheet(share: float) -> Sequence[Observation]:
    """Two right views, and one that takes a share of the nodes that it sees for nodes elsewhere."""
    column = np.rint(UV[:, 0] / STEP_M).astype(int)
    views = [observed(UV, EVERYTHING, 4), observed(UV, EVERYTHING, 5)]
    seen = observed(UV, column < 6, 6)
    node, random = seen.node.copy(), np.random.default_rng(1)
    wrong = random.permutation(len(node))[: round(share * len(node))]
    node[wrong] = random.permutation(np.flatnonzero(column >= 12))[: len(wrong)]
    return [*views, replace(seen, node=node)]


def test_the_share_is_that_of_the_pairs_that_others_contradict() -> None:
    shape = shape_of(UV, views_of_the_sheet(0.1))
    seen = shape.observations[2]
    lengths = np.linalg.norm(np.diff(UV[seen.node[seen.edges]], axis=1)[:, 0], axis=1)
    wrong = np.abs(lengths - seen.edge_length_m) > 0.03
    assert shape.contradictions == pytest.approx({4: 0.0, 5: 0.0, 6: wrong.mean()}, abs=0.02)
    assert off_m(shape.uv_m, UV) < 1e-4


def test_cloth_that_no_view_joins_to_the_rest_contradicts_nothing() -> None:
    views = [observed(UV, UV[:, 0] < 0.08, 4), observed(UV, UV[:, 0] > 0.1, 5)]
    shape = shape_of(UV, views)
    assert set(shape.piece) >= {0, 1}
    assert shape.contradictions == {4: 0.0, 5: 0.0}
