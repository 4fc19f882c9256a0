import numpy as np
from scenes import Cylinder, placement_error_m, sheet, views

from flatcloth.core.types import FlattenedView, Rigid2
from flatcloth.methods.paper.merging import Parts, Renewed, begin, covered_share, lay_over, renew
from flatcloth.session.document import PlacedPart, Side


def parts_of(sources: dict[int, FlattenedView]) -> Parts:
    """Views of one component each."""
    return lambda view_index, _component: sources[view_index]


def renewed(
    sources: dict[int, FlattenedView], start: int, added: int, motion: Rigid2, side: Side | None
) -> Renewed:
    before = begin(sources[start], start)
    return renew(before, parts_of(sources), PlacedPart(added, 0, motion), side)


def row_of_views(view: FlattenedView) -> list[int]:
    return view.view_index[10].tolist()


def test_next_to_the_occluding_edge_the_added_view_wins_though_it_is_steeper() -> None:
    old, new = sheet(0, 0, 40, 5.0), sheet(1, -20, 40, 30.0)
    merged = renewed({0: old, 1: new}, 0, 1, Rigid2(), Side.LEFT)
    # Common are columns 0..19: in their left half the added view, right of it the smaller Z-angle.
    assert row_of_views(merged.view) == [1] * 30 + [0] * 30
    right = renewed({1: new, 0: old}, 1, 0, Rigid2(), Side.RIGHT)
    assert row_of_views(right.view) == [1] * 20 + [0] * 40


def test_elsewhere_the_smaller_absolute_z_angle_wins() -> None:
    old = sheet(0, 0, 40, -30.0)
    flatter, steeper = sheet(1, 0, 40, 5.0), sheet(1, 0, 40, 45.0)
    assert set(row_of_views(renewed({0: old, 1: flatter}, 0, 1, Rigid2(), None).view)) == {1}
    assert set(row_of_views(renewed({0: old, 1: steeper}, 0, 1, Rigid2(), None).view)) == {0}


def test_attributes_follow_the_exact_motion_however_many_views_are_added() -> None:
    start = sheet(0, 0, 60, 0.0, rows=60)
    canonical, sources = begin(start, 0), {0: start}
    random = np.random.default_rng(3)
    for n in range(1, 9):
        # Steep far-off scraps: every pixel of the start stays, carried through eight turned frames.
        scrap = sheet(n, 500, 4, 60.0)
        sources[n] = scrap
        motion = Rigid2(random.uniform(-0.3, 0.3), random.uniform(-0.02, 0.02), random.uniform(-0.02, 0.02))
        canonical = renew(canonical, parts_of(sources), PlacedPart(n, 0, motion), Side.LEFT)
    view = canonical.view
    kept = view.view_index == 0
    assert kept.sum() > 0.95 * 3600
    expected = canonical.current_from_view[0].inverse().apply(view.uv_from_rc(np.argwhere(kept)))
    inner = (np.abs(expected - 0.059) < 0.055).all(axis=1)
    np.testing.assert_allclose(view.xyz_m[kept][inner, :2], expected[inner], atol=1e-6)


def test_a_cylinder_grows_to_the_union_of_its_views() -> None:
    current, new = views(0.0, 40.0)
    cylinder = Cylinder()
    flat = [cylinder.flat_uv_m(v.xyz_m[v.valid].astype(float)) for v in (current, new)]
    uv = [v.uv_from_rc(np.argwhere(v.valid)) for v in (current, new)]
    shift = (uv[0] - flat[0]).mean(axis=0) - (uv[1] - flat[1]).mean(axis=0)
    motion = Rigid2(0.0, float(shift[0]), float(shift[1]))
    assert placement_error_m(current, new, motion) < 0.004
    merged = renewed({0: current, 1: new}, 0, 1, motion, Side.LEFT).view
    width = np.ptp(merged.uv_from_rc(np.argwhere(merged.valid))[:, 0])
    np.testing.assert_allclose(width, np.ptp(np.concatenate(flat)[:, 0]), atol=0.008)
    assert merged.area_m2 > 1.2 * current.area_m2
    # Every pixel still shows the cloth at its own place.
    again = cylinder.flat_uv_m(merged.xyz_m[merged.valid].astype(float))
    drift = merged.uv_from_rc(np.argwhere(merged.valid)) - again
    assert np.linalg.norm(drift - np.median(drift, axis=0), axis=1).max() < 0.005


def test_a_further_component_is_laid_over_without_moving_the_plane() -> None:
    main, other = sheet(0, 0, 40, 5.0), sheet(1, 0, 20, 30.0)
    parts = {(0, 0): main, (1, 0): sheet(1, -20, 40, 30.0), (1, 1): other}

    def part(view_index: int, component: int) -> FlattenedView:
        return parts[view_index, component]

    first = renew(begin(main, 0), part, PlacedPart(1, 0, Rigid2()), Side.LEFT)
    # Pixels 0 to 19 of the component come to lie on columns 50 to 69 (0.1 m to the right of its own).
    laid = lay_over(first, part, PlacedPart(1, 1, Rigid2(0.0, 0.1, 0.0)))
    assert laid.current_from_view == first.current_from_view
    assert [(p.view_index, p.component) for p in laid.layers] == [(0, 0), (1, 0), (1, 1)]
    assert row_of_views(laid.view) == [1] * 30 + [0] * 30 + [-1] * 10 + [1] * 20
    own = laid.label == 2
    np.testing.assert_allclose(
        laid.view.uv_from_rc(np.argwhere(own))[:, 0] - 0.1, laid.view.xyz_m[own][:, 0], atol=1e-6
    )
    again = renew(laid, part, PlacedPart(0, 0, Rigid2(0.2)), None)
    assert again.layers[2].current_from_new.u_m == (Rigid2(0.2).inverse() @ Rigid2(0.0, 0.1, 0.0)).u_m


def test_the_covered_share_is_that_of_the_area() -> None:
    shape, part = sheet(0, 0, 40, 5.0), sheet(1, 0, 20, 5.0)
    assert covered_share(shape, part, Rigid2()) == 1.0
    assert covered_share(shape, part, Rigid2(0.0, 0.06, 0.0)) == 0.5
    assert covered_share(shape, part, Rigid2(0.0, 1.0, 0.0)) == 0.0
