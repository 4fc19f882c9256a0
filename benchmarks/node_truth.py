"""Where the nodes of a shape truly are on the flat cloth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from flatcloth.core.types import Float64
from flatcloth.engine.evaluation import bilinear_on_layer, of_interest
from flatcloth.flattening.surface import Surface
from flatcloth.recordings.truth import Truth
from flatcloth.shape.shape import Shape


def true_at(truth: Truth | Any, view_index: int, rc: Float64) -> Float64:
    """Return the true places (K, 2) of positions in a view's image; NaN where the panel is not shown."""
    true = truth[view_index]
    shown = of_interest(true, truth.panel_of_interest)
    flat = np.where(shown[..., None], true.flat_uv_m, np.nan)
    return bilinear_on_layer(flat, rc).astype(np.float64)


def true_places(shape: Shape, surfaces: Mapping[int, Surface], truth: Truth | Any) -> Float64:
    """Return the true place (N, 2) of each node, the median of all views that see it; NaN if none does."""
    seen: list[list[Float64]] = [[] for _ in range(len(shape.nodes))]
    for observation in shape.observations:
        offset = np.array(surfaces[observation.view_index].frame.offset_rc)
        places = true_at(truth, observation.view_index, observation.rc + offset)
        for node, place in zip(observation.node, places, strict=True):
            if np.isfinite(place[0]):
                seen[node].append(place)
    return np.array([np.median(places, axis=0) if places else (np.nan, np.nan) for places in seen])
