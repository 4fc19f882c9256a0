"""Diagnostics of a proposal: pairs of cloth, the paper's curves and lines, and the strained edges.

They are computed for any method, from the shape and the proposed view at its placement. This takes a few
hundredths of a second, plus the flattening of the view if it is no longer cached.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flatcloth.core.errors import AlignmentError, FlatclothError
from flatcloth.core.geometry import wrapped_deg
from flatcloth.core.types import Float64, Rigid2
from flatcloth.flattening.cloth import SurfaceEdges
from flatcloth.methods.answers import ClothPairs, ColumnCurves, Correspondence
from flatcloth.methods.edges import edges_of_parts
from flatcloth.methods.paper.alignment import correspond
from flatcloth.methods.paper.planning import column_curves, overlap_column, rotation_to_limit_deg
from flatcloth.session.machine import Document, PlacedPart, Side

if TYPE_CHECKING:
    from flatcloth.engine.integration import Integration

LEAST_STRAIN = 0.04
"""An edge is strained if its length is off by at least this share, and by ``LEAST_OFF_M``. Chosen; not
measured."""
LEAST_OFF_M = 0.0005
"""Chosen: smaller changes of length are the rounding of a D435 (1 mm units), averaged."""
MOST_EDGES = 400
"""Strained edges that are reported, the most strained first. Chosen: the page draws them in one frame."""


@dataclass(frozen=True, kw_only=True)
class StrainedEdges:
    """Edges whose length on the plane differs much from their length along the cloth (Eq. (2)).

    ``uv_m`` (K, 2, 2) their ends on the plane of the shape, ``xyz_m`` (K, 2, 3) in the object frame;
    ``strain`` (K,) the relative change of length, positive if longer on the plane; ``total`` the
    number of all edges.
    """

    uv_m: Float64
    xyz_m: Float64
    strain: Float64
    total: int


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
    shape_edges: StrainedEdges
    new_edges: StrainedEdges
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
    algorithm = integration.algorithm
    own = PlacedPart(pending.view_index, pending.component, pending.current_from_new)
    return Reasons(
        pairs=algorithm.pairs(document, pending.view_index, pending.component),
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
        shape_edges=strained_edges(algorithm.surface_edges(document)),
        new_edges=strained_edges(edges_of_parts(integration.views, angles, [own])),
    )


def strained_edges(found: SurfaceEdges, most: int = MOST_EDGES) -> StrainedEdges:
    """Return the edges with the largest strain, without those that have an unknown end (NaN)."""
    uv_m, xyz_m, edges, length_m = found.uv_m, found.xyz_m, found.edges, found.length_m
    flat = np.linalg.norm(uv_m[edges[:, 0]] - uv_m[edges[:, 1]], axis=1)
    off = flat - length_m
    known = np.isfinite(off)
    with np.errstate(invalid="ignore"):
        strain = off / np.maximum(length_m, 1e-9)
        large = np.flatnonzero(known & (np.abs(strain) >= LEAST_STRAIN) & (np.abs(off) >= LEAST_OFF_M))
    worst = large[np.argsort(-np.abs(strain[large]), kind="stable")][:most]
    return StrainedEdges(
        uv_m=uv_m[edges[worst]], xyz_m=xyz_m[edges[worst]], strain=strain[worst], total=int(known.sum())
    )
