"""Which of the nodes that a view shows are the cloth that was accepted, by the placement on the plane."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from made_up_sheets import STEP_M, grid, observed, shape_of

from flatcloth.core.types import Bool, Float64, Rigid2
from flatcloth.methods.robust.acceptance import PlacesInView, _fits_one_motion, same_cloth
from flatcloth.methods.robust.observations import Association
from flatcloth.session.document import Accepted

UV = grid(10, 24)
COLUMN = np.rint(UV[:, 0] / STEP_M).astype(int)
EVERYTHING = np.ones(len(UV), dtype=bool)
SHAPE = shape_of(UV, [observed(UV, EVERYTHING, 0)], EVERYTHING)
MOTION = Rigid2(0.3, 0.05, -0.02)
NODES = Association(
    node=np.arange(len(UV), dtype=np.int32), rc=np.zeros((len(UV), 2)), incidence_deg=np.zeros(len(UV))
)


def kept(own_uv: Float64, component: Any) -> Bool:
    """Which nodes are kept of a view that shows all of them at ``own_uv`` of its plane."""
    places = PlacesInView(uv_m=own_uv, component=np.broadcast_to(component, len(UV)).astype(np.int32))
    added = Accepted(1, MOTION)
    found, by_hand = same_cloth(
        SHAPE, NODES, places, added, cast("Any", SimpleNamespace()), joins_piece=False
    )
    assert not by_hand
    return np.isin(NODES.node, found.node)


def test_nodes_that_the_placement_takes_elsewhere_are_other_cloth() -> None:
    own = MOTION.inverse().apply(UV)
    layer = COLUMN % 5 == 0
    random = np.random.default_rng(0).uniform(-0.3, 0.3, own.shape)
    np.testing.assert_array_equal(kept(np.where(layer[:, None], own + random, own), 0), ~layer)


@pytest.mark.parametrize(("off_m", "is_kept"), [(0.024, True), (0.026, False)])
def test_the_gate_is_a_distance_on_the_plane(off_m: float, is_kept: bool) -> None:
    own = MOTION.inverse().apply(UV)
    one = np.arange(len(UV)) == 57
    found = kept(np.where(one[:, None], own + np.array([0.0, off_m]), own), 0)
    assert found[57] == is_kept
    assert found[~one].all()


@pytest.mark.parametrize(("count", "is_kept"), [(4, True), (3, False)])
def test_a_further_component_is_joined_by_as_many_nodes_as_a_motion_needs(count: int, is_kept: bool) -> None:
    own = MOTION.inverse().apply(UV)
    further = np.arange(len(UV)) < count
    elsewhere = Rigid2(-0.8, 0.4, 0.1).apply(UV)
    found = kept(np.where(further[:, None], elsewhere, own), np.where(further, 1, 0))
    assert found[~further].all()
    assert (found[further] == is_kept).all()


@pytest.mark.parametrize(("wrong_share", "fits"), [(0.3, True), (0.6, False)])
def test_a_motion_is_common_if_most_points_follow_it(wrong_share: float, fits: bool) -> None:
    wrong = np.random.default_rng(1).permutation(len(UV)) < wrong_share * len(UV)
    target = (
        MOTION.apply(UV) + np.where(wrong[:, None], (0.0, 0.2), 0.0) * np.linspace(1, 3, len(UV))[:, None]
    )
    np.testing.assert_array_equal(_fits_one_motion(UV, target, 12), ~wrong & fits)
    assert not _fits_one_motion(UV[:11], UV[:11], 12).any()
