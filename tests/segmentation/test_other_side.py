"""The other side of a thin turning plate, of which the masks name the front."""

from types import SimpleNamespace

import numpy as np
import pytest
from plates import TOP_M, plate
from scenes import AXIS

from flatcloth.core.config import Config
from flatcloth.segmentation.observed import gather_evidence
from flatcloth.segmentation.other_side import _opposite_share, other_side
from flatcloth.segmentation.relations import SignedGraph

VIEWS = plate()


@pytest.fixture(scope="module")
def observed():
    return gather_evidence([view.frame for view in VIEWS], AXIS, TOP_M, Config())


def test_the_back_of_a_plate_is_the_other_side_of_its_front(observed):
    found = other_side(observed, lambda view: VIEWS[view].front)
    said = right = back = 0
    for n, view in enumerate(VIEWS):
        if n not in observed.views:  # edge on
            continue
        mask = found.mask(n)
        its_back = observed.views[n].whole(observed.views[n].item) & ~view.front
        said, right = said + mask.sum(), right + (mask & its_back).sum()
        back += its_back.sum()
        assert not (mask & view.front).any()
    assert right / said > 0.99
    assert right / back > 0.9
    assert found.area_of_interest_m2 == pytest.approx(0.14 * 0.20, rel=0.1)


def test_masks_that_name_nothing_leave_nothing_sure(observed):
    found = other_side(observed, lambda view: np.zeros_like(VIEWS[view].front))
    assert found.area_of_interest_m2 < 0.5 * 0.14 * 0.20


def test_cloth_that_goes_on_smoothly_over_the_border_of_the_masks_is_not_of_this_side():
    this, over_seam, behind = 0, 1, 2
    graph = SignedGraph(
        count=3,
        first=np.array([this, over_seam, this]),
        second=np.array([over_seam, behind, behind]),
        weight=np.array([0.9, 0.3, -0.5]),
    )
    clusters = SimpleNamespace(count=3, place_m=np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.3, 0.0]]))
    seen = SimpleNamespace(graph=graph, clusters=clusters)
    share = _opposite_share(seen, np.array([True, False, False]))
    assert share[this] == 0.0
    assert share[over_seam] == share[behind] == 1.0
