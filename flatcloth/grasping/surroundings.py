"""The neighbourhood of a pixel of a flattened view: the nearest outline, and the local map into space."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from flatcloth.core.types import Bool, FlattenedView, Float64

_OUTLINE_REACH_M = 0.015
"""The outline's direction is fitted to its part within this distance. Set by hand."""
_PATCH_RADIUS_M = 0.008
"""Radius of the patch that gives the normal at a grasp. Chosen: about a finger's width."""
_INSIDE, _OUTSIDE = 2, 3
"""Marks of the pixels of a piece, and of those around it. Chosen."""
_LAYER_GAP_M = 0.010
"""Cloth farther than this along the normal is another layer. Chosen: folds of one layer are flatter in the
patch."""


@dataclass(frozen=True, kw_only=True)
class NearestOutline:
    """The outline of the cloth nearest to a pixel, on the plane.

    ``distance_m`` to its nearest point, ``direction`` (2,) its unit direction there with
    the cloth on the right as seen from outside, ``spread_deg`` its deviation from a straight line (rms).
    """

    distance_m: float
    direction: Float64
    spread_deg: float


@dataclass(frozen=True, kw_only=True)
class TangentMap:
    """The cloth around a pixel as a linear map from the plane to space.

    ``object_from_plane`` (3, 2): metres of space, object frame, per metre of the plane;
    ``scatter_m`` rms of the measured points about a smooth patch, along its normal;
    ``normal_spread_deg`` rms angle of the normals to their mean.
    """

    object_from_plane: Float64
    scatter_m: float
    normal_spread_deg: float


def nearest_outline(view: FlattenedView, rc: tuple[int, int]) -> NearestOutline | None:
    """Return the outline nearest to a valid pixel (row, col), or None if it is too short for a direction.

    Holes inside the cloth are unseen, not outline; other pieces of cloth on the plane do not count
    either.
    """
    marks = np.pad(view.valid.astype(np.uint8), 1)
    cv2.floodFill(marks, None, (rc[1] + 1, rc[0] + 1), _INSIDE, flags=8)
    outside = np.where(marks == _INSIDE, np.uint8(_INSIDE), np.uint8(0))
    cv2.floodFill(outside, None, (0, 0), _OUTSIDE, flags=4)
    padded: Bool = outside != _OUTSIDE  # the piece that contains the pixel, with its holes filled
    piece = padded[1:-1, 1:-1]
    inner = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    edge = piece & ~inner
    uv = view.uv_from_rc(np.argwhere(edge))
    at = view.uv_from_rc(np.array(rc))
    offset = np.linalg.norm(uv - at, axis=1)
    nearest = uv[int(np.argmin(offset))]
    away = np.linalg.norm(uv - nearest, axis=1)
    near = away <= _OUTLINE_REACH_M
    if near.sum() < 3:
        return None
    # The outline near the point has the largest weight, because outlines are curved.
    weight = np.exp(-np.square(away[near] / (_OUTLINE_REACH_M / 2)))
    center = np.average(uv[near], axis=0, weights=weight)
    spread, axes = np.linalg.eigh(np.cov(uv[near].T, aweights=weight))
    if not spread[1] > 0:
        return None
    direction = axes[:, 1]
    around = view.rc_from_uv(nearest)
    reach_px = _OUTLINE_REACH_M / view.pixel_size_m + 1.0
    first = np.maximum(np.floor(around - reach_px).astype(int), 0)
    last = np.ceil(around + reach_px).astype(int)
    window = piece[first[0] : last[0] + 1, first[1] : last[1] + 1]
    cloth = view.uv_from_rc(np.argwhere(window) + first)
    inside = cloth[np.linalg.norm(cloth - nearest, axis=1) <= _OUTLINE_REACH_M].mean(axis=0) - center
    if direction[0] * inside[1] - direction[1] * inside[0] < 0:
        direction = -direction
    return NearestOutline(
        distance_m=float(offset.min()),
        direction=direction,
        spread_deg=math.degrees(math.atan(math.sqrt(max(float(spread[0]), 0.0) / float(spread[1])))),
    )


def tangent_map(view: FlattenedView, rc: tuple[int, int]) -> TangentMap | None:
    """Return the tangent map at a valid pixel (row, col), or None if there is too little cloth around it.

    A quadratic in (u, v) is fitted to the points of the pixel's layer within 8 mm; the map is its
    linear part.
    """
    radius_px = max(_PATCH_RADIUS_M / view.pixel_size_m, 2.5)
    span = math.ceil(radius_px)
    top, left = max(rc[0] - span, 0), max(rc[1] - span, 0)
    window = np.s_[top : rc[0] + span + 1, left : rc[1] + span + 1]
    places = np.argwhere(view.valid[window]) + np.array([top, left])
    offset = (places - rc)[:, ::-1] * view.pixel_size_m
    xyz = view.xyz_m[places[:, 0], places[:, 1]].astype(np.float64)
    normal = view.normal[places[:, 0], places[:, 1]].astype(np.float64)
    here, out = view.xyz_m[rc].astype(np.float64), view.normal[rc].astype(np.float64)
    away = np.linalg.norm(offset, axis=1)
    same = (away <= radius_px * view.pixel_size_m) & np.isfinite(xyz).all(axis=1)
    with np.errstate(invalid="ignore"):
        same &= (np.abs((xyz - here) @ out) <= _LAYER_GAP_M) & (normal @ out > 0.5)
    if same.sum() < 8:
        return None
    u, v = (offset[same] / _PATCH_RADIUS_M).T
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
    fit, _, rank, _ = np.linalg.lstsq(terms, xyz[same] - here, rcond=1e-6)
    if rank < terms.shape[1]:
        return None
    mean = normal[same].mean(axis=0)
    mean /= np.linalg.norm(mean)
    rest = (xyz[same] - here - terms @ fit) @ mean
    tilt = np.arccos(np.clip(normal[same] @ mean / np.linalg.norm(normal[same], axis=1), -1.0, 1.0))
    return TangentMap(
        object_from_plane=fit[1:3].T / _PATCH_RADIUS_M,
        scatter_m=math.sqrt(float(rest @ rest) / (len(rest) - terms.shape[1])),
        normal_spread_deg=math.degrees(math.sqrt(float(np.mean(tilt**2)))),
    )
