"""Diagnostics of a proposal: pairs of cloth, the paper's curves and lines.

They are computed for any method, from the shape and the proposed view at its placement. This takes a few
hundredths of a second, plus the flattening of the view if it is no longer cached.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from flatcloth.core.errors import AlignmentError, FlatclothError
from flatcloth.core.geometry import wrapped_deg
from flatcloth.core.types import Rigid2
from flatcloth.methods.answers import ClothPairs, ColumnCurves, Correspondence
from flatcloth.methods.paper.alignment import correspond
from flatcloth.methods.paper.planning import column_curves, overlap_column, rotation_to_limit_deg
from flatcloth.session.machine import Document, Side

if TYPE_CHECKING:
    from flatcloth.engine.integration import Integration


@dataclass(frozen=True, kw_only=True)
class Reasons:
    """The quantities of the paper's section 4 for a pending view.

    ``front_view`` is the accepted view that it continues on its ``side``: the outermost one there by
    the paper's method, otherwise the one with the smallest rotation to it. ``turn_deg`` is the
    rotation from that view to the proposed one (A, signed). ``curves`` are h(u) and A_z(u) of the
    shape at the rotation of ``front_view``, on columns of that view's plane, to which
    ``front_from_current`` transforms. ``new_curves`` are those of the proposed view at its own
    rotation on its own plane, from which ``current_from_new`` transforms. ``u_b_m``, ``a_0_deg`` and
    ``rotation_deg`` (unsigned) are the paper's plan there. ``correspondence`` is its initial estimate;
    if there is none, it is None and ``trouble`` gives the reason. ``pairs`` are the pairs of cloth that
    fixed the place, if the method finds such.
    """

    view_index: int
    side: Side
    front_view: int
    turn_deg: float
    curves: ColumnCurves
    new_curves: ColumnCurves
    u_b_m: float
    a_0_deg: float
    rotation_deg: float
    correspondence: Correspondence | None
    trouble: str
    front_from_current: Rigid2
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
    angles, config, axis = integration.recording.angles_deg, integration.config, integration.axis
    side, front = integration.algorithm.continued(document, pending.view_index, pending.side)
    canonical = integration.canonical(document)
    front_from_current = canonical.current_from_view[front].inverse()
    turn = wrapped_deg(angles[pending.view_index] - angles[front])
    new = integration.views.part(pending.view_index, pending.component)
    limit = config.planning.z_angle_limit_deg
    curves = column_curves(canonical.view, axis, angles[front], limit, front_from_current)
    u_b, a_0 = overlap_column(curves, side, integration.planning.overlap_area_m2)
    found, trouble = None, ""
    try:
        seen = (angles[front], angles[front] + turn)
        found = correspond(canonical.view, new, axis, seen, front_from_current, limit)
    except AlignmentError as error:
        trouble = str(error)
    return Reasons(
        pairs=integration.algorithm.pairs(document, pending.view_index, pending.component),
        view_index=pending.view_index,
        side=side,
        front_view=front,
        turn_deg=turn,
        curves=curves,
        new_curves=column_curves(new, axis, angles[front] + turn, limit),
        u_b_m=u_b,
        a_0_deg=a_0,
        rotation_deg=rotation_to_limit_deg(side, a_0, config.planning),
        correspondence=found,
        trouble=trouble,
        front_from_current=front_from_current,
        current_from_new=pending.current_from_new,
    )
