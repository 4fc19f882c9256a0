"""The edges of Eq. (2) of single views, transformed to a plane."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flatcloth.core.geometry import object_from_camera
from flatcloth.core.types import Rigid2
from flatcloth.flattening.cloth import SurfaceEdges
from flatcloth.methods.base import Views


def edges_of_view(
    views: Views, angle_deg: float, view_index: int, component: int, plane_from_view: Rigid2
) -> SurfaceEdges:
    """Return the edges within one component of a view that was placed on a plane."""
    flattening = views.flattening(view_index)
    level = flattening.levels[-1]
    own = np.zeros(len(level.points_rc), dtype=bool)
    own[flattening.components[component].members] = True
    used = own[level.edges].all(axis=1)
    held = object_from_camera(views.axis, angle_deg)
    return SurfaceEdges(
        uv_m=plane_from_view.apply(level.uv_m),
        xyz_m=held.apply(level.points_m),
        edges=level.edges[used],
        length_m=level.edge_length_m[used],
    )


def joined_edges(of_views: Sequence[SurfaceEdges]) -> SurfaceEdges:
    """Return the edges of several views as one list."""
    first = np.cumsum([0] + [len(e.uv_m) for e in of_views])
    return SurfaceEdges(
        uv_m=np.concatenate([e.uv_m for e in of_views]),
        xyz_m=np.concatenate([e.xyz_m for e in of_views]),
        edges=np.concatenate([e.edges + f for e, f in zip(of_views, first, strict=False)]).astype(np.int32),
        length_m=np.concatenate([e.length_m for e in of_views]),
    )
