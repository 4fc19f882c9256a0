"""Diagnostics of a proposal: pairs of cloth, or the paper's corresponding lines.

This takes a few hundredths of a second, plus the flattening of the view if it is no longer cached.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flatcloth.core.errors import AlignmentError, FlatclothError
from flatcloth.core.geometry import wrapped_deg
from flatcloth.core.types import Rigid2
from flatcloth.engine.integration import Integration
from flatcloth.methods.answers import ClothPairs, Correspondence
from flatcloth.methods.paper.alignment import correspond
from flatcloth.methods.starting import fronts
from flatcloth.session.document import Document, Pending, Side


@dataclass(frozen=True, kw_only=True)
class Reasons:
    """The quantities of the paper's section 4 for a pending view.

    ``front_view`` is the accepted view that it continues on its ``side``: the outermost one there by
    the paper's method, otherwise the one with the smallest rotation to it. ``turn_deg`` is the
    rotation from that view to the proposed one (A, signed). ``current_from_new`` is the placement,
    ``correspondence`` the paper's initial estimate of it; if there is none, it is None and ``trouble`` gives
    the reason. ``pairs`` are the pairs of cloth that fixed the place, if the method finds such.
    """

    view_index: int
    side: Side
    front_view: int
    turn_deg: float
    correspondence: Correspondence | None
    trouble: str
    current_from_new: Rigid2
    pairs: ClothPairs | None = None


def reasons(integration: Integration, document: Document) -> Reasons:
    """Compute the diagnostics of a document's pending view.

    Raises
    ------
    FlatclothError
        If no view is pending.
    """
    pending = document.pending
    if pending is None:
        raise FlatclothError("There is no proposal to explain. Step first.")
    angles, limit = integration.recording.angles_deg, integration.config.planning.z_angle_limit_deg
    side, front = _continued(document, pending, angles)
    canonical = integration.canonical(document)
    front_from_current = canonical.current_from_view[front].inverse()
    turn = wrapped_deg(angles[pending.view_index] - angles[front])
    new = integration.views.part(pending.view_index, pending.component)
    found, trouble = None, ""
    try:
        seen = (angles[front], angles[front] + turn)
        found = correspond(canonical.view, new, integration.axis, seen, front_from_current, limit)
    except AlignmentError as error:
        trouble = str(error)
    return Reasons(
        pairs=integration.algorithm.pairs(document, pending.view_index, pending.component),
        view_index=pending.view_index,
        side=side,
        front_view=front,
        turn_deg=turn,
        correspondence=found,
        trouble=trouble,
        current_from_new=pending.current_from_new,
    )


def _continued(document: Document, pending: Pending, angles_deg: Sequence[float]) -> tuple[Side, int]:
    """Return the side that a view extends, and the accepted view that it continues there.

    It is the outermost one on the side of its plan, otherwise that with the smallest rotation to it.
    """
    if pending.side is not None:
        return pending.side, fronts(document, angles_deg)[pending.side][0]
    turns = {v: wrapped_deg(angles_deg[pending.view_index] - angles_deg[v]) for v in document.views_in_order}
    nearest = min(turns, key=lambda view: abs(turns[view]))
    return (Side.LEFT if turns[nearest] >= 0 else Side.RIGHT), nearest
