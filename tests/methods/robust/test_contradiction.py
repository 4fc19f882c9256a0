"""When other views contradict the one accepted last."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from made_up_sheets import STEP_M, grid, observed, shape_of

from flatcloth.core.config import Config
from flatcloth.methods.base import Views
from flatcloth.methods.robust.joint_shape import JointShape
from flatcloth.methods.robust.method import RobustMethod
from flatcloth.session.machine import Document

UV = grid(10, 24)
COLUMN = np.rint(UV[:, 0] / STEP_M).astype(int)
EVERYTHING = np.ones(len(UV), dtype=bool)


def method_of(shape: JointShape) -> RobustMethod:
    made = RobustMethod(
        cast("Views", SimpleNamespace(config=Config(), held_point_m=np.zeros(3))), (0.0, 10.0)
    )
    made.shapes = cast("Any", SimpleNamespace(shape=lambda _: shape))
    return made


def shape_with(share: float) -> JointShape:
    """Two views of a sheet; of the second one's pairs that share lost its weight."""
    views = [observed(UV, EVERYTHING, 0), observed(UV, EVERYTHING, 1)]
    shape = shape_of(UV, views, EVERYTHING)
    first = len(views[0].edges)
    shape.weight[first : first + round(share * len(views[1].edges))] = 0.2
    shape.weight[: first // 2] = 0.0  # of the other view: does not count
    return shape


@pytest.mark.parametrize("share", [0.0, 0.08, 0.3])
def test_the_contradiction_is_the_share_of_the_last_views_pairs_without_weight(share: float) -> None:
    method = method_of(shape_with(share))
    assert method.contradiction(Document()) == pytest.approx(share, abs=0.002)
    assert method.is_contradicted(Document()) == (share > 0.1)


def test_a_view_that_floats_contradicts_nothing() -> None:
    shape = shape_with(0.5)
    shape.piece[:] = 1
    assert not method_of(shape).is_contradicted(Document())
