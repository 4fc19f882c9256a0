"""The edges of Eq. (2) of single views, transformed to a plane."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flatcloth.core.geometry import object_from_camera
from flatcloth.flattening.cloth import SurfaceEdges
from flatcloth.methods.base import Views
from flatcloth.session.document import PlacedPart


def edges_of_parts(views: Views, angles_deg: Sequence[float], parts: Sequence[PlacedPart]) -> SurfaceEdges:
    """Return the edges within components of views that were placed on a plane, at the views' angles."""
    found, first = [], 0
    for part in parts:
        flattening = views.flattening(part.view_index)
        level = flattening.levels[-1]
        own = np.zeros(len(level.points_rc), dtype=bool)
        own[flattening.components[part.component].members] = True
        used = own[level.edges].all(axis=1)
        placed = part.current_from_new.apply(level.uv_m)
        held = object_from_camera(views.axis, angles_deg[part.view_index]).apply(level.points_m)
        found.append((placed, held, level.edges[used] + first, level.edge_length_m[used]))
        first += len(level.uv_m)
    uv_m, xyz_m, edges, length_m = (np.concatenate(each) for each in zip(*found, strict=True))
    return SurfaceEdges(uv_m=uv_m, xyz_m=xyz_m, edges=edges.astype(np.int32), length_m=length_m)
