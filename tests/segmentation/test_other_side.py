"""The other side of a thin turning plate, of which the masks name the front."""

import numpy as np
import pytest
from plates import TOP_M, plate
from scenes import AXIS

from flatcloth.core.config import Config
from flatcloth.segmentation.observed import gather_evidence
from flatcloth.segmentation.other_side import other_side

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
