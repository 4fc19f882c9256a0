"""Where the outlines of noisy views may have another layer's depth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.types import Bool, FlattenedView
from flatcloth.flattening.ramps import RAMP_HALF_WIDTH_PX
from flatcloth.flattening.sampling import LEAST_INTERVAL_M
from flatcloth.flattening.surface import Surface
from flatcloth.shape.shape import Shape

_OTHER_LAYER_M = 0.012
"""Another layer is nearer or farther by at least this. It is also the standard deviation of what may have the
depth of another layer: outlines of noisy views next to it, half a ramp wide and as far from it. Set by
hand."""


def with_placement_std(view: FlattenedView, shape: Shape, surfaces: Mapping[int, Surface]) -> FlattenedView:
    """Return a view of a shape with the standard deviation of each pixel's place.

    Each pixel takes the standard deviation of the node nearest to it on the plane. It is larger where the
    pixel's view is noisy and shows another layer next to it, whose depth may be mixed in.
    """
    nodes = np.flatnonzero(np.isfinite(shape.std_m))
    if not nodes.size:
        return view
    rows, cols = view.shape
    block_px = max(1, round(0.5 * LEAST_INTERVAL_M / view.pixel_size_m))  # half the distance of nodes
    along = (np.arange(0, size + block_px, block_px) for size in (rows, cols))
    coarse = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1)
    _, nearest = cKDTree(shape.all_uv_m[nodes]).query(view.uv_from_rc(coarse))
    values = shape.std_m[nodes][nearest].astype(np.float32)
    smooth = cv2.resize(values, None, fx=block_px, fy=block_px, interpolation=cv2.INTER_LINEAR)
    # cv2 aligns the corners of pixels: the value of a coarse pixel is at the centre of its block.
    shift = block_px // 2
    std = smooth[shift : shift + rows, shift : shift + cols]
    std = np.hypot(std, np.float32(_OTHER_LAYER_M) * _beside_a_layer(view, surfaces))
    return replace(view, placement_std_m=np.where(view.valid, std, np.float32(np.nan)))


def _beside_a_layer(view: FlattenedView, surfaces: Mapping[int, Surface]) -> Bool:
    """Return the pixels (R, C) that a noisy view shows at an outline of its surface next to another layer."""
    result = np.zeros(view.shape, dtype=np.bool_)
    pixels = np.flatnonzero(view.valid)
    seen_by = view.view_index.ravel()[pixels]
    order = np.argsort(seen_by, kind="stable")
    pixels, seen_by = pixels[order], seen_by[order]
    for number, surface in surfaces.items():
        own = pixels[slice(*np.searchsorted(seen_by, (number, number + 1)))]
        if surface.noisy and own.size:
            rc = np.rint(view.source_rc.reshape(-1, 2)[own] - np.asarray(surface.frame.offset_rc)).astype(int)
            rc = np.clip(rc, 0, np.array(surface.usable.shape) - 1)
            result.ravel()[own] = _layer_rims(surface)[rc[:, 0], rc[:, 1]]
    return result


def _layer_rims(surface: Surface) -> Bool:
    measured = surface.frame.depth_m
    kernel = np.ones((2 * RAMP_HALF_WIDTH_PX + 1,) * 2, dtype=np.uint8)
    depth = surface.depth_m
    farthest = cv2.dilate(np.where(surface.inverse_depth > 0, measured, np.float32(0.0)), kernel)
    nearest = cv2.erode(np.where(measured > 0, measured, np.float32(np.inf)), kernel)
    reach = np.arange(-RAMP_HALF_WIDTH_PX, RAMP_HALF_WIDTH_PX + 1)
    disc = (np.hypot(*np.meshgrid(reach, reach)) <= RAMP_HALF_WIDTH_PX).astype(np.uint8)
    inside = cv2.erode(surface.usable.astype(np.uint8), disc, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    step_m = np.maximum(farthest - depth, depth - nearest)
    rims: Bool = surface.usable & (inside == 0) & (step_m > _OTHER_LAYER_M)
    return rims
