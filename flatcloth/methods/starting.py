"""The start view, the desirable overlap, and the two sides of a growing shape (paper, 4.1)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from flatcloth.core.types import Float64, Progress, no_progress
from flatcloth.methods.base import Views
from flatcloth.session.document import Document, Side

LEAST_COMPONENT_SHARE = 0.2
"""Of a view's components, those with at least this share of the largest one's area are placed; components
that overlap by less, or are known but for less, are different cloth, or nothing new. Set by hand."""
OVERLAP_SHARE = LEAST_COMPONENT_SHARE
"""S_0 as a share of the largest area seen in one view, where it is not set.

The paper sets it by the expected size of the item and gives no number. A fifth is 0.025 to 0.04 m2 for the
shirts and trousers of the shared recordings, and 0.011 m2 for shorts and a skirt.
"""


_FILLED = 1.3
"""A flattened view is at most so much larger than its observed area. Chosen: it was 1.25 times as large on a
dress; steep cloth counts for less in the observed area, and dropouts are filled."""


def start_by_view(views: Views, progress: Progress = no_progress) -> int | None:
    """Return the view of largest observed area whose largest component flattens without folds, if any."""
    for view in _by_area(views.observed_areas_m2(progress)):
        if views.unfolded_area_m2(view) > 0.0:
            return view
    return None


def start_by_component(views: Views, progress: Progress = no_progress) -> int | None:
    """Return the view with the largest component that flattens without folds; None if all are folded."""
    view, area_m2 = max(components_by_area(views, progress), key=lambda tried: tried[1], default=(-1, 0.0))
    return view if area_m2 > 0.0 else None


def components_by_area(views: Views, progress: Progress = no_progress) -> Iterator[tuple[int, float]]:
    """Yield views by their observed area, each with the area (m2) of its largest component (0: folded).

    A view is not flattened if all that it shows is less than the largest component so far; it ends there.
    """
    areas, largest_m2 = views.observed_areas_m2(progress), 0.0
    for view in _by_area(areas):
        if _FILLED * areas[view] <= largest_m2:
            return
        progress(0.9, f"looking for the start view: flattening view {view}")
        area_m2 = views.unfolded_area_m2(view)
        largest_m2 = max(largest_m2, area_m2)
        yield view, area_m2


def overlap_area_m2(views: Views) -> float:
    """Return the desirable overlap S_0: as set, or a share of the largest area seen in one view."""
    set_m2 = views.config.planning.overlap_area_m2
    return set_m2 or max(round(1e4 * OVERLAP_SHARE * float(views.observed_areas_m2().max())), 1) / 1e4


def _by_area(areas_m2: Float64) -> list[int]:
    order: list[int] = np.argsort(-areas_m2, kind="stable").tolist()
    return order


def fronts(document: Document, angles_deg: Sequence[float]) -> dict[Side, tuple[int, float]]:
    """Return for each side the outermost accepted view and its rotation from the start view (deg)."""
    assert document.start_view is not None
    start = document.start_view
    outer = {Side.LEFT: (start, 0.0), Side.RIGHT: (start, 0.0)}
    for added in document.accepted:
        turn = (angles_deg[added.view_index] - angles_deg[start]) % 360.0
        side = added.side or (Side.LEFT if turn <= 180.0 else Side.RIGHT)
        covered = turn if side is Side.LEFT else (-turn) % 360.0
        if covered > outer[side][1]:
            outer[side] = (added.view_index, covered)
    return outer


def side_of(document: Document, angles_deg: Sequence[float], view_index: int) -> Side:
    """Return the side that a view chosen by hand extends: the one whose front is nearer."""
    outer = fronts(document, angles_deg)
    beyond = {
        Side.LEFT: (angles_deg[view_index] - angles_deg[outer[Side.LEFT][0]]) % 360.0,
        Side.RIGHT: (angles_deg[outer[Side.RIGHT][0]] - angles_deg[view_index]) % 360.0,
    }
    return min(beyond, key=lambda side: beyond[side])
