"""Scores and refinement on a flat sheet that faces the camera: closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from made_up_sheets import STILL, shape_of_view
from scenes import AXIS, box, frame, plane

from flatcloth.core.config import SurfaceConfig
from flatcloth.core.types import Rigid2
from flatcloth.flattening.surface import Surface, observe_surface
from flatcloth.methods.robust.scoring import (
    CONFIDENCE_WEIGHTS,
    FEATURES,
    ReferenceShape,
    SampledComponent,
    cloth_pairs,
    confidence_of,
    features_of,
    refine,
    sample_component,
    score_placement,
)

HALF_M = 0.09
PLACE_STD_M = 0.003


def surface_of() -> Surface:
    """A sheet with a random texture of 12 mm, in a plane across the line of sight."""
    depth = plane()
    random = np.random.default_rng(3).uniform(40, 210, (20, 20))
    color = np.kron(random, np.ones((12, 12)))[:240, :240]
    shown = frame(depth, box(HALF_M, depth), color[..., None] * np.ones(3))
    return observe_surface(shown, AXIS, SurfaceConfig())


@pytest.fixture(scope="module")
def reference() -> ReferenceShape:
    surface = surface_of()
    shape = shape_of_view(surface, STILL, lambda xyz_m: xyz_m[:, :2])
    return ReferenceShape(shape, {0: surface}, AXIS)


@pytest.fixture(scope="module")
def component() -> SampledComponent:
    """The same sheet as another view shows it: its plane is x, y in space, so the identity is right."""
    surface = surface_of()
    rc = np.argwhere(surface.usable)[::37].astype(np.int32)
    uv = surface.xyz_m[rc[:, 0], rc[:, 1]][:, :2].astype(float)
    none = np.zeros(0, dtype=np.int32)
    return sample_component(uv, rc, surface, STILL, np.zeros((0, 2)), none, (2 * HALF_M) ** 2)


def test_the_right_placement_agrees_in_everything(
    reference: ReferenceShape, component: SampledComponent
) -> None:
    score = score_placement(reference, component, Rigid2())
    assert score.parts["place_agreement"] > 0.99
    assert score.parts["place_median_mm"] < 0.1
    assert score.parts["overlap_share"] > 0.98
    assert score.parts["overlap_cm2"] == pytest.approx(1e4 * (2 * HALF_M) ** 2, rel=0.02)
    assert score.parts["other_cloth_share"] == 0.0
    assert score.total > 0.9
    assert score.apart_mm == score.parts["place_median_mm"]


def test_cloth_is_other_cloth_if_it_faces_another_way_or_lies_elsewhere_in_space(
    reference: ReferenceShape, component: SampledComponent
) -> None:
    half = np.arange(len(component.uv_m)) % 2 == 0
    covered, _, _ = reference.nodes.surface_at(component.uv_m)
    share = half[covered].mean()
    turned = replace(component, normal=np.where(half[:, None], -1.0, 1.0) * component.normal)
    score = score_placement(reference, turned, Rigid2())
    assert score.parts["other_cloth_share"] == pytest.approx(share)
    assert score.parts["place_agreement"] == pytest.approx(1.0 - share, abs=0.01)
    scale = PLACE_STD_M + 2.0 * reference.noise_m
    for times, expected in ((3.5, 0.0), (4.5, share)):
        off = np.where(half[:, None], (0.0, 0.0, times * scale), 0.0)
        moved = replace(component, xyz_m=component.xyz_m + off)
        found = score_placement(reference, moved, Rigid2()).parts["other_cloth_share"]
        assert found == pytest.approx(expected)


@pytest.mark.parametrize("shift_m", [0.003, 0.010, 0.030])
def test_a_flat_sheet_that_is_shifted_lies_that_far_apart_in_space(
    reference: ReferenceShape, component: SampledComponent, shift_m: float
) -> None:
    score = score_placement(reference, component, Rigid2(0.0, shift_m, 0.0))
    scale = PLACE_STD_M + 2.0 * reference.noise_m
    assert score.parts["place_median_mm"] == pytest.approx(1e3 * shift_m, abs=0.05)
    assert score.parts["place_agreement"] == pytest.approx(1.0 / (1.0 + (shift_m / scale) ** 2), abs=0.01)
    assert score.parts["height_agreement"] > 0.99  # it was moved along the horizontal
    # Nodes lie up to 12 mm inside the outline and cover 10 mm around them.
    covered = 1.0 - np.clip(shift_m + np.array([0.002, -0.010]), 0.0, None) / (2 * HALF_M)
    assert covered[0] - 0.01 < score.parts["overlap_share"] <= covered[1] + 0.01


def test_a_placement_off_the_shape_has_no_overlap_and_no_measure_of_distance(
    reference: ReferenceShape, component: SampledComponent
) -> None:
    score = score_placement(reference, component, Rigid2(0.0, 1.0, 0.0))
    assert score.parts["overlap_cm2"] == 0.0
    assert score.apart_mm is None
    assert score.total < 0.05


def test_cloth_that_the_shape_has_elsewhere_is_there_twice(
    reference: ReferenceShape, component: SampledComponent
) -> None:
    node = np.full(len(component.uv_m), -1, dtype=np.int32)
    placed = np.flatnonzero(np.isfinite(reference.all_uv_m[:, 0]))
    apart = np.linalg.norm(reference.nodes.uv_m[:, None] - component.uv_m[None, ::7], axis=2)
    node[::7] = placed[apart.argmin(axis=0)]
    known = replace(component, node=node)
    assert score_placement(reference, known, Rigid2()).parts["twice_share"] == 0.0
    assert score_placement(reference, known, Rigid2(0.0, 0.03, 0.0)).parts["twice_share"] == 1.0


def test_the_confidence_is_the_logistic_function_of_its_features() -> None:
    parts = {
        "place_agreement": 0.8, "outline_agreement": 0.9, "other_cloth_share": 0.1,
        "twice_share": 0.2, "overlap_cm2": 100.0, "place_median_mm": 5.0,
    }  # fmt: skip
    values = features_of(parts)
    assert values == pytest.approx((1.0, 0.8, 0.9, 0.1, 0.2, 2.0, 0.5))
    assert len(values) == len(FEATURES) == len(CONFIDENCE_WEIGHTS)
    logit = float(np.dot(CONFIDENCE_WEIGHTS, values))
    assert confidence_of(parts) == pytest.approx(1.0 / (1.0 + math.exp(-logit)))
    far = {**parts, "place_median_mm": math.nan}
    assert confidence_of(far) < confidence_of(parts)


@pytest.mark.parametrize(
    "start", [Rigid2(0.0, 0.010, -0.006), Rigid2(0.05, 0.0, 0.0), Rigid2(-0.04, 0.008, 0.008)]
)
def test_refinement_comes_back_to_the_right_place(
    reference: ReferenceShape, component: SampledComponent, start: Rigid2
) -> None:
    found = refine(reference, component, start)[0]
    moved = found.apply(component.uv_m) - component.uv_m
    assert np.linalg.norm(moved, axis=1).max() < 2e-4


def test_refinement_says_which_direction_a_strip_leaves_open(
    reference: ReferenceShape, component: SampledComponent
) -> None:
    """On a plane place and height determine all; how well depends on the samples, and turns on the arm."""
    std = refine(reference, component, Rigid2())[1]
    few = np.arange(len(component.uv_m)) % 4 == 0
    fewer = SampledComponent(
        uv_m=component.uv_m[few],
        xyz_m=component.xyz_m[few],
        normal=component.normal[few],
        node=component.node[few],
        area_m2=component.area_m2,
    )
    np.testing.assert_allclose(refine(reference, fewer, Rigid2())[1], 2.0 * std, rtol=0.05)
    arm_m = np.sqrt(np.square(component.uv_m - component.uv_m.mean(axis=0)).sum(axis=1).mean())
    assert std[0] == pytest.approx(std[1] / arm_m, rel=0.05)


def test_refinement_without_any_overlap_knows_nothing(
    reference: ReferenceShape, component: SampledComponent
) -> None:
    far = Rigid2(0.0, 1.0, 0.0)
    motion, std = refine(reference, component, far)
    assert motion == far
    assert np.isinf(std).all()


def test_the_nodes_that_a_component_shows_are_paired_with_their_places_each_once(
    reference: ReferenceShape, component: SampledComponent
) -> None:
    motion = Rigid2(0.4, 0.05, -0.02)
    chosen = np.repeat(np.arange(20), 2)
    node = np.append(chosen, -1).astype(np.int32)
    own = motion.inverse().apply(np.concatenate([reference.all_uv_m[chosen], [[0.3, 0.3]]]))
    xyz = np.zeros((len(own), 3))
    known = replace(component, uv_m=own, node=node, xyz_m=xyz, normal=xyz)
    found = cloth_pairs(reference, known)
    assert found is not None
    assert len(found.shape_uv_m) == 20
    np.testing.assert_allclose(motion.apply(found.new_uv_m), found.shape_uv_m, atol=1e-12)
    assert cloth_pairs(reference, replace(known, node=np.full_like(node, -1))) is None
