"""The two sides of a growing shape, by the rotations of its views (paper, section 4: occluding edges)."""

from __future__ import annotations

from collections.abc import Sequence

from flatcloth.session.document import Document, Side

LEAST_COMPONENT_SHARE = 0.2
"""Of a view's components, those with at least this share of the largest one's area are placed; components
that overlap by less, or are known but for less, are different cloth, or nothing new. Set by hand."""


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
