"""A recording without masks takes those of a solver; a stroke changes what depends on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
import pytest
from scenes import Cylinder

from flatcloth.core.errors import SegmentationError
from flatcloth.core.strokes import Decision, ImageStroke
from flatcloth.core.types import Bool
from flatcloth.engine.integration import Integration
from flatcloth.engine.segmenting import MOST_VIEWS, prepare
from flatcloth.segmentation.result import Segmentation
from flatcloth.segmentation.solver import SideSolver
from flatcloth.session.document import Document

ANGLES = (0.0, 20.0)
LEFT_HALF = ImageStroke(side="other", view_index=0, points_rc=((0.0, 0.0),))


@dataclass
class Labels:
    masks: list[Bool]
    text: str = "all of it"

    def mask(self, view_index: int) -> Bool:
        return self.masks[view_index]

    def mask_key(self, view_index: int) -> int:
        return hash(self.masks[view_index].tobytes())


class HalfSolver:
    """All of the item is of interest; a stroke takes the left half of view 0 away."""

    def __init__(self, item: list[Bool]) -> None:
        self.item = item
        self.solved = 0

    def solve(self, decisions: tuple[Decision, ...]) -> Segmentation:
        self.solved += 1
        masks = [item.copy() for item in self.item]
        if decisions:
            masks[0][:, : masks[0].shape[1] // 2] = False
        return cast("Segmentation", Labels(masks))


def made() -> tuple[Integration, HalfSolver]:
    masked, bare = Cylinder(angles_deg=ANGLES), Cylinder(angles_deg=ANGLES, masks=False)
    items = [masked[n].mask for n in range(len(ANGLES))]
    solver = HalfSolver([item for item in items if item is not None])
    return Integration(bare, segmenter=lambda _views, _progress: cast("SideSolver", solver)), solver


def test_masks_that_are_found_count_as_recorded_ones() -> None:
    found, _ = made()
    recorded = Integration(Cylinder(angles_deg=ANGLES))
    document = Document(start_view=0)
    np.testing.assert_array_equal(
        found.canonical(document).view.valid, recorded.canonical(document).view.valid
    )


def test_a_stroke_changes_the_shape_and_only_the_views_whose_masks_change() -> None:
    found, solver = made()
    whole = found.canonical(Document(start_view=0)).view.area_m2
    other = found.views.flattening(1)
    half = found.canonical(Document(start_view=0, strokes=(LEFT_HALF,))).view.area_m2
    assert half < 0.7 * whole
    assert found.views.flattening(1) is other
    assert found.canonical(Document(start_view=0)).view.area_m2 == whole
    assert solver.solved == 2  # undo needs no new solution


def test_strokes_on_a_recording_with_masks_are_refused_in_one_line() -> None:
    with pytest.raises(SegmentationError, match="has masks, so strokes have no effect"):
        Integration(Cylinder(angles_deg=ANGLES)).views.segment((LEFT_HALF,))


def test_more_views_than_fit_into_the_memory_are_refused() -> None:
    angles = tuple(0.5 * n for n in range(MOST_VIEWS + 1))
    views = Integration(Cylinder(angles_deg=angles, masks=False)).views
    with pytest.raises(SegmentationError, match=r"601 views of .* without masks; .*Keep fewer"):
        prepare(views)
