"""The state of each pixel of a recorded view in the result of a session."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.errors import FlatteningError, SurfaceError
from flatcloth.core.geometry import back_project, object_from_camera
from flatcloth.core.types import Bool, Uint8
from flatcloth.flattening.pixel_states import PixelState, component_states, states_of_view
from flatcloth.flattening.surface import item_mask
from flatcloth.shape.pieces import TWICE_M

if TYPE_CHECKING:
    from flatcloth.engine.integration import Integration
    from flatcloth.session.document import Document

NEAR_M = TWICE_M
"""Cloth nearer than this to the shape or a piece is part of it, as in the check for doubled cloth."""


@dataclass(frozen=True, kw_only=True)
class PixelStates:
    """The states (H, W) of a view's pixels, and which of them show cloth that the result lacks.

    ``is_missing`` (H, W) are measured pixels of the item that lie near neither the shape nor a piece.
    """

    states: Uint8
    is_missing: Bool


def pixel_states(integration: Integration, document: Document, view_index: int) -> PixelStates:
    """Compute the states of a view's pixels.

    Raises
    ------
    FlatclothError
        If the session has no start view, or the view cannot be read.
    """
    canonical = integration.canonical(document)
    frame = integration.views.frame(view_index)
    item = item_mask(frame, integration.axis, integration.config.surface)
    known = [view.xyz_m[view.valid] for view in (canonical.view, *canonical.floating)]
    rows, cols = np.nonzero(item)
    xyz = back_project(frame.depth_m, frame.intrinsics)[rows, cols].astype(np.float64)
    xyz = object_from_camera(integration.axis, frame.angle_deg).apply(xyz)
    off_m, _ = cKDTree(np.concatenate(known)).query(xyz, distance_upper_bound=NEAR_M)
    is_missing = np.zeros(item.shape, dtype=np.bool_)
    is_missing[rows, cols] = ~np.isfinite(off_m)
    return PixelStates(states=states_of(integration, document, view_index), is_missing=is_missing)


def states_of(integration: Integration, document: Document, view_index: int) -> Uint8:
    """Return the state (H, W) of each pixel of a view; see :class:`PixelState`."""
    frame = integration.views.frame(view_index)
    item = frame.mask
    if item is None:
        item = item_mask(frame, integration.axis, integration.config.surface)
    is_used = view_index in document.used_views
    found = None
    if is_used:
        off = integration.taken_off(document)
        found = integration.algorithm.pixel_states(document, frame, item, off)
    if found is not None:
        return found
    try:
        flattening = integration.views.flattening(view_index)
    except (SurfaceError, FlatteningError):
        return states_of_view(frame, item, None, None)
    on_surface = component_states(flattening, document.components_of(view_index)) if is_used else None
    return states_of_view(frame, item, flattening.surface, on_surface)


def pixel_counts(integration: Integration, document: Document) -> dict[str, int]:
    """Return the number of pixels of the item in each state, over the views of the shape."""
    total = np.zeros(len(PixelState), dtype=np.int64)
    for view_index in sorted(document.used_views):
        states = states_of(integration, document, view_index)
        total += np.bincount(states.ravel(), minlength=len(PixelState))
    return {
        state.name.lower(): int(total[state])
        for state in PixelState
        if state not in (PixelState.OFF_ITEM, PixelState.NOT_USED)
    }
