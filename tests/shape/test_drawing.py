"""The canonical view of two views of a cylinder: each pixel from the view that saw it best."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import AXIS, CAMERA, Cylinder, box, frame, placed_view, plane

from flatcloth.core.config import Config, FlatteningConfig
from flatcloth.core.types import FlattenedView
from flatcloth.shape.algorithm import as_decided, shape
from flatcloth.shape.drawing import composite, draw, pixel_cost, with_placement_std
from flatcloth.shape.joints import DecidedParts
from flatcloth.shape.observations import FRONTAL_NOISE, PlacedView
from flatcloth.shape.shape import PIECES_APART_M, Shape, of_views

ANGLES = (0.0, 30.0)
PIXEL_M = 0.002
INTERVAL_PX = FlatteningConfig().sampling_intervals_px[-1]
CYLINDER = Cylinder(angles_deg=ANGLES)
VIEWS = [placed_view(CYLINDER[n]) for n in range(2)]
SURFACES = {n: view.surface for n, view in enumerate(VIEWS)}
COSTS = {n: pixel_cost(surface) for n, surface in SURFACES.items()}


@pytest.fixture(scope="module")
def made() -> Shape:
    found = shape(VIEWS, INTERVAL_PX, 0)
    # Upright and undistorted, but somewhere on the plane: moved to where the cylinder's own places are.
    shift = np.nanmean(CYLINDER.flat_uv_m(found.nodes.xyz_m) - found.uv_m, axis=0)
    return replace(found, all_uv_m=found.all_uv_m + shift)


@pytest.fixture(scope="module")
def view(made: Shape) -> FlattenedView:
    return composite(made, SURFACES, AXIS, INTERVAL_PX, PIXEL_M, COSTS)


def test_each_pixel_lies_where_its_cloth_belongs(view: FlattenedView) -> None:
    """Upright, since the image of the first view is; nothing else turns it."""
    true = CYLINDER.flat_uv_m(view.xyz_m[view.valid].astype(float))
    found = view.uv_from_rc(np.argwhere(view.valid))
    off = np.linalg.norm(found - true, axis=1)
    assert np.median(off) < 0.0005
    assert np.percentile(off, 99) < 0.002


def test_each_pixel_comes_from_the_view_that_looks_at_it_more_squarely(view: FlattenedView) -> None:
    """Turned by 30 degrees, the views look equally at what lies 15 degrees to the left."""
    around = CYLINDER.flat_uv_m(view.xyz_m.astype(float))[..., 0] / 0.12
    inner = view.valid & (np.abs(np.degrees(around) + 15.0) < 30.0) & (np.abs(view.xyz_m[..., 1]) < 0.07)
    clear = inner & (np.abs(np.degrees(around) + 15.0) > 4.0)
    expected = np.where(np.degrees(around) < -15.0, 1, 0)
    assert (view.view_index[clear] == expected[clear]).mean() > 0.99
    assert set(np.unique(view.view_index[inner])) == {0, 1}


def test_what_is_read_is_what_the_image_shows_there(view: FlattenedView) -> None:
    rows, cols = np.nonzero(view.valid)
    for row, col in zip(rows[::911], cols[::911], strict=True):
        r, c = np.rint(view.source_rc[row, col]).astype(int)
        recorded = CYLINDER[int(view.view_index[row, col])]
        near = recorded.color[max(r - 1, 0) : r + 2, max(c - 1, 0) : c + 2, 0].astype(int)
        assert near.min() - 1 <= int(view.rgb[row, col, 0]) <= near.max() + 1


def test_nodes_without_a_place_are_not_drawn(made: Shape, view: FlattenedView) -> None:
    half = np.where(made.uv_m[:, :1] < 0.0, np.nan, made.uv_m)
    drawn = composite(made, SURFACES, AXIS, INTERVAL_PX, PIXEL_M, COSTS, half)
    assert drawn.uv_from_rc(np.argwhere(drawn.valid))[:, 0].min() > -0.012  # nearer to the others beyond
    assert 0.3 < drawn.area_m2 / view.area_m2 < 0.6


def test_cloth_that_would_lie_mirrored_is_not_drawn_as_an_area(made: Shape, view: FlattenedView) -> None:
    mirrored = made.uv_m * (-1.0, 1.0)
    drawn = composite(made, SURFACES, AXIS, INTERVAL_PX, PIXEL_M, COSTS, mirrored)
    assert drawn.area_m2 < 0.9 * view.area_m2  # single pixels, with gaps between them


def test_the_cost_is_the_noise_at_that_incidence() -> None:
    """Noise of a pair: a share seen frontally, and tan^2 of the incidence more; both fade in from the rim."""
    flat = plane(slope_x=0.5)
    surface = placed_view(frame(flat, box(0.08, flat))).surface
    row, col = CAMERA.height // 2, CAMERA.width // 2
    offset = np.asarray(surface.frame.offset_rc)
    found = pixel_cost(surface)
    center = found[row - int(offset[0]), col - int(offset[1])]
    assert center == pytest.approx(FRONTAL_NOISE + 0.5**2, abs=0.02)
    assert np.isinf(found[~surface.usable]).all()
    assert found[surface.usable].max() > center + 1.0


def test_a_part_that_is_taken_off_is_drawn_as_a_floating_piece(made: Shape, view: FlattenedView) -> None:
    right = made.nodes.xyz_m[:, 0] > 0.03
    main, floating, are_off = draw(
        as_decided(made, DecidedParts([right]), 0), SURFACES, AXIS, Config(), COSTS, taken_off=right
    )
    (piece,) = floating
    assert are_off == {0}
    assert main.placement_std_m is not None
    assert main.area_m2 + piece.area_m2 == pytest.approx(view.area_m2, rel=0.1)
    cloth = [CYLINDER.flat_uv_m(of.xyz_m[of.valid].astype(float))[:, 0] for of in (main, piece)]
    assert np.percentile(cloth[0], 99) < np.percentile(cloth[1], 1) + 0.02
    assert piece.origin_uv_m[0] > 0.5 * PIECES_APART_M


def test_a_part_that_two_parts_divide_lies_where_its_own_pairs_say(made: Shape) -> None:
    around = made.nodes.xyz_m[:, 0]
    left, right = around < -0.03, around > 0.03
    found = as_decided(made, DecidedParts([left, right]), 0)
    flat = CYLINDER.flat_uv_m(made.nodes.xyz_m)
    assert set(found.piece[found.has_place]) == {0, 1, 2}
    for number in range(3):
        own = found.piece == number
        off = found.all_uv_m[own] - flat[own]
        assert np.percentile(np.ptp(off, axis=0), 95) < 0.004


def test_what_some_of_the_views_show_lies_where_the_whole_shape_has_it(
    made: Shape, view: FlattenedView
) -> None:
    first = of_views(made, {0})
    assert first.views == (0,)
    shown = composite(first, SURFACES, AXIS, INTERVAL_PX, PIXEL_M, COSTS)
    assert set(np.unique(shown.view_index[shown.valid])) == {0}
    assert 0.5 < shown.area_m2 / view.area_m2 < 0.9
    off = shown.uv_from_rc(np.argwhere(shown.valid)) - CYLINDER.flat_uv_m(
        shown.xyz_m[shown.valid].astype(float)
    )
    assert np.percentile(np.linalg.norm(off, axis=1), 99) < 0.002


def test_a_pixel_is_as_sure_as_the_node_nearest_to_it(made: Shape, view: FlattenedView) -> None:
    left = made.uv_m[:, 0] < 0.0
    std_m = np.where(made.placed, np.where(left, 0.004, 0.009), np.nan)
    seen = with_placement_std(view, replace(made, std_m=std_m), SURFACES).placement_std_m
    assert seen is not None
    assert np.isnan(seen[~view.valid]).all()
    u = view.uv_from_rc(np.argwhere(view.valid))[:, 0]
    assert np.median(seen[view.valid][u < -0.02]) == pytest.approx(0.004, abs=0.0002)
    assert np.median(seen[view.valid][u > 0.02]) == pytest.approx(0.009, abs=0.0002)


def beside_a_layer(layer_m: float, *, noisy: bool) -> PlacedView:
    """A sheet at 0.85 m whose left outline is beside a layer, all on one item."""
    depth, columns = plane(), np.arange(240)
    own = np.zeros(depth.shape, dtype=np.bool_)
    own[40:200, 120:200] = True
    beside = (columns >= 60) & (columns < 120)
    shown = np.where(own, depth, np.where(beside, layer_m, np.nan))
    view = placed_view(frame(shown, own))
    # The item's mask has the farther layer, too; a nearer one may be anything.
    behind = np.where(beside & (layer_m > 0.85), np.float32(1.0 / layer_m), np.float32(0.0))
    inverse = np.where(own, view.surface.inverse_depth, behind)
    noise_m = 0.0005 if noisy else 0.0
    return replace(view, surface=replace(view.surface, noisy=noisy, noise_m=noise_m, inverse_depth=inverse))


@pytest.mark.parametrize(
    ("layer_m", "noisy", "is_rim"),
    [
        (0.82, True, True),
        (0.88, True, True),
        (0.843, True, False),
        (0.857, True, False),
        (0.82, False, False),
    ],
)
def test_a_noisy_outline_next_to_another_layer_is_unsure_as_wide_as_depths_are_mixed(
    layer_m: float, *, noisy: bool, is_rim: bool
) -> None:
    seen = beside_a_layer(layer_m, noisy=noisy)
    made = shape([seen], INTERVAL_PX, 0)
    made = replace(made, std_m=np.where(made.placed, 0.001, np.nan))
    view, _, _ = draw(made, {0: seen.surface}, AXIS, Config(), {0: pixel_cost(seen.surface)})
    assert view.placement_std_m is not None
    columns, unsure = view.source_rc[..., 1], view.placement_std_m > 0.011
    at_rim = view.valid & (columns < 122.5)
    inside = view.valid & (columns > 126) & (columns < 190)
    assert at_rim.sum() > 100
    assert not unsure[inside].any()
    assert (unsure[at_rim].mean() > 0.9) == is_rim
    assert unsure[at_rim].any() == is_rim
    assert not unsure[view.valid & (columns > 195)].any()  # an outline beside which nothing lies
