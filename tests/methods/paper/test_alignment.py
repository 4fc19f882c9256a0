import math
from dataclasses import replace

import numpy as np
import pytest
from scenes import AXIS, Cylinder, aligned_by_z_angle, placement_error_m, views
from scipy import ndimage

from flatcloth.core.errors import AlignmentError
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import FlattenedView, Rigid2
from flatcloth.methods.paper.alignment import correspond, from_lines, from_places
from flatcloth.methods.paper.matching import Matcher


@pytest.mark.parametrize("turn_deg", [20.0, -20.0, 40.0, 50.0])
def test_a_known_turn_is_found_to_two_pixels(turn_deg: float) -> None:
    current, new = views(0.0, turn_deg)
    found = aligned_by_z_angle(current, new, turn_deg)
    assert placement_error_m(current, new, found.current_from_new) < 0.004
    assert found.score.total > 0.85
    assert found.score.total >= found.initial_score.total - 1e-9


def test_the_initial_estimate_comes_from_lines_of_the_common_z_angle() -> None:
    current, new = views(0.0, 40.0)
    made = correspond(current, new, AXIS, (0.0, 40.0), Rigid2(), 50.0)
    assert made.rotation_deg == 40.0
    # Seen by both within 50 deg: from -50 to 10 deg before the turn.
    assert made.common_range_deg == pytest.approx((-49.5, 9.5), abs=2.0)
    assert made.a_m_deg == pytest.approx(-20.0, abs=1.5)
    assert made.new.z_angle_deg - made.current.z_angle_deg == pytest.approx(40.0)
    for line in (made.current, made.new):
        assert abs(line.direction[1]) > 0.99  # a line of equal Z-angle runs along the cylinder
        assert line.direction[1] > 0
    initial = from_lines(made)
    np.testing.assert_allclose(initial.apply(made.new.point_uv_m), made.current.point_uv_m, atol=1e-12)
    assert placement_error_m(current, new, initial) < 0.02


def wavering(view: FlattenedView, seed: int) -> FlattenedView:
    """The view with normals that waver by 10 degrees over 6 mm, as those of a depth sensor do."""
    noise = np.random.default_rng(seed).normal(size=(*view.shape, 3))
    noise = ndimage.gaussian_filter(noise, (1.5, 1.5, 0))
    normal = view.normal + math.tan(math.radians(10.0)) * noise / noise.std()
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return replace(view, normal=normal.astype(np.float32))


def test_wavering_normals_neither_displace_the_start_nor_refuse_the_right_placement() -> None:
    current, new = (wavering(view, n) for n, view in enumerate(views(0.0, 40.0, square_m=10.0)))
    found = aligned_by_z_angle(current, new, 40.0)
    assert placement_error_m(current, new, found.initial) < 0.02
    right = Matcher(current, new, AXIS).score(found.current_from_new)
    assert right.parts["z_angle_agreement"] > 0.7
    turned = Matcher(current, new, AXIS).score(Rigid2(0.0, 0.04, 0.0) @ found.current_from_new)
    assert turned.parts["z_angle_agreement"] < 0.3


def test_views_without_common_z_angle_are_refused_with_a_remedy() -> None:
    current, new = views(0.0, 140.0)
    with pytest.raises(AlignmentError, match="smaller rotation"):
        aligned_by_z_angle(current, new, 140.0)


def test_the_score_is_the_agreement_of_the_places_whatever_the_texture() -> None:
    current, new = views(0.0, 20.0, square_m=10.0)  # plain
    matcher = Matcher(current, new, AXIS)
    cylinder = Cylinder()
    flat = [
        fit_rigid2(v.uv_from_rc(np.argwhere(v.valid)), cylinder.flat_uv_m(v.xyz_m[v.valid]))
        for v in (current, new)
    ]
    right = flat[0].inverse() @ flat[1]
    assert matcher.score(right).total > 0.95
    for apart_m, agreement in ((0.005, 0.8), (0.010, 0.5), (0.020, 0.2)):
        lower = matcher.score(Rigid2(0.0, 0.0, apart_m) @ right)  # along the axis, so exactly as far in space
        assert lower.total == pytest.approx(agreement, abs=0.03)
        across = matcher.score(Rigid2(0.0, apart_m, 0.0) @ right)  # the views themselves are 1 mm off
        assert across.parts["height_agreement"] > 0.95
        assert across.total == pytest.approx(agreement, abs=0.07)
        assert lower.parts["height_rms_mm"] > 3 * across.parts["height_rms_mm"]
    nowhere = matcher.score(Rigid2(0.0, 5.0, 0.0))
    assert (nowhere.total, nowhere.parts["overlap_cm2"]) == (0.0, 0.0)


def test_the_places_give_an_initial_estimate_that_needs_neither_line_nor_texture() -> None:
    current, new = (wavering(view, n) for n, view in enumerate(views(0.0, 50.0, square_m=10.0)))
    assert placement_error_m(current, new, from_places(current, new)) < 0.004


def test_views_of_different_cloth_have_no_place_in_common() -> None:
    current, new = views(0.0, 180.0)
    with pytest.raises(AlignmentError, match="same place"):
        from_places(current, new)


def test_the_search_finds_back_from_a_displaced_start() -> None:
    current, new = views(0.0, 20.0)
    matcher = Matcher(current, new, AXIS)
    right = aligned_by_z_angle(current, new, 20.0).current_from_new
    center = new.uv_from_rc(np.argwhere(new.valid)).mean(axis=0)
    found = matcher.search(right @ Rigid2(math.radians(8), 0.03, -0.025).about(center))
    assert placement_error_m(current, new, found) < 0.004
