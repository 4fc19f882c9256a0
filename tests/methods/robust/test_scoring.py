"""Scores and refinement on a flat sheet that faces the camera: closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_sheets import shape_of_view
from scenes import box, frame, placed_view, plane

from flatcloth.core.types import Rigid2
from flatcloth.methods.robust.scoring import SampledComponent, cloth_pairs, refined, score_placement
from flatcloth.shape.pieces import TWICE_M
from flatcloth.shape.shape import Shape

HALF_M = 0.09


@pytest.fixture(scope="module")
def sheet() -> Shape:
    depth = plane()
    return shape_of_view(placed_view(frame(depth, box(HALF_M, depth))), lambda xyz_m: xyz_m[:, :2])


@pytest.fixture(scope="module")
def component(sheet: Shape) -> SampledComponent:
    """The same sheet as another view shows it: its plane is x, y in space, so the identity is right."""
    node = np.flatnonzero(sheet.placed).astype(np.int32)
    xyz = sheet.nodes.xyz_m[node]
    return SampledComponent(uv_m=xyz[:, :2], xyz_m=xyz, node=node, area_m2=(2 * HALF_M) ** 2)


def test_the_right_placement_agrees_in_everything(sheet, component):
    score = score_placement(sheet, component, Rigid2())
    assert score.total == pytest.approx(1.0)
    assert score.parts["twice_share"] == score.parts["other_cloth_share"] == 0.0
    assert score.apart_mm == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("shift_m", [0.003, TWICE_M, 0.030])
def test_common_cloth_that_is_shifted_is_that_far_off_and_half_right_at_the_limit(sheet, component, shift_m):
    score = score_placement(sheet, component, Rigid2(0.0, shift_m, 0.0))
    assert score.apart_mm == pytest.approx(1e3 * shift_m)
    assert score.total == pytest.approx(1.0 / (1.0 + (shift_m / TWICE_M) ** 2))
    if shift_m != TWICE_M:
        assert score.parts["twice_share"] == float(shift_m > TWICE_M)


def test_a_component_is_less_right_by_its_share_that_lies_on_other_cloth(sheet, component):
    half = np.arange(len(component.uv_m)) % 2 == 0
    for behind_m, share in ((2.9 * TWICE_M, 0.0), (3.1 * TWICE_M, half.mean())):
        behind = component.xyz_m + np.where(half[:, None], (0.0, 0.0, behind_m), 0.0)
        node = np.where(half, -1, component.node).astype(np.int32)
        score = score_placement(sheet, replace(component, xyz_m=behind, node=node), Rigid2())
        assert score.parts["other_cloth_share"] == pytest.approx(share)
        assert score.total == pytest.approx(1.0 - share)


def test_a_placement_without_common_cloth_is_not_right_and_has_no_measure_of_distance(sheet, component):
    strange = replace(component, node=np.full_like(component.node, -1))
    score = score_placement(sheet, strange, Rigid2())
    assert score.total == 0.0
    assert score.apart_mm is None
    assert refined(cloth_pairs(sheet, strange), Rigid2(0.1, 0.2, 0.3)) == Rigid2(0.1, 0.2, 0.3)


@pytest.mark.parametrize(
    "start", [Rigid2(0.0, 0.010, -0.006), Rigid2(0.5, 0.1, 0.0), Rigid2(-2.0, -0.3, 0.2)]
)
def test_refinement_comes_back_to_the_right_place_from_anywhere(sheet, component, start):
    other = np.arange(len(component.uv_m)) % 5 == 0  # a fifth is not the cloth that it is taken for
    uv = component.uv_m + np.where(other[:, None], (0.03, -0.05), 0.0)
    found = refined(cloth_pairs(sheet, replace(component, uv_m=uv)), start)
    moved = found.apply(component.uv_m) - component.uv_m
    assert np.linalg.norm(moved, axis=1).max() < 1e-3


def test_the_nodes_that_a_component_shows_are_paired_with_their_places(sheet, component):
    motion = Rigid2(0.4, 0.05, -0.02)
    some = component.node[:20]
    own = motion.inverse().apply(np.concatenate([sheet.uv_m[some], [[0.3, 0.3]]]))
    shown = SampledComponent(
        uv_m=own, xyz_m=np.zeros((21, 3)), node=np.append(some, -1).astype(np.int32), area_m2=0.01
    )
    found = cloth_pairs(sheet, shown)
    assert len(found.shape_uv_m) == 20
    np.testing.assert_allclose(motion.apply(found.new_uv_m), found.shape_uv_m, atol=1e-12)
