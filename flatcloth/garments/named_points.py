"""Named points of a garment, and its dimensions between them, on the plane of its shape."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from flatcloth.core.types import FlattenedView, Float64
from flatcloth.flattening.sampling import LEAST_INTERVAL_M
from flatcloth.garments.distance import to_edges
from flatcloth.garments.evidence import PieceEvidence
from flatcloth.garments.fit import APART_M, OUTLINE_STD_M, TEMPERATURE, Fit, robust_weight
from flatcloth.garments.model import with_slope
from flatcloth.segmentation.settings import SURE

POINT_NEAR_M = LEAST_INTERVAL_M
"""A named point is seen if cloth lies this near to its place: the distance of neighbouring samples."""
KNOWN_STD_M = 0.025
"""A named point whose place is known worse than this is predicted, whatever cloth lies there, and a loose
piece is not placed without asking. Chosen: twice ``POINT_NEAR_M``."""


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A dimension: value and standard deviation, m."""

    value_m: float
    std_m: float


@dataclass(frozen=True, kw_only=True)
class Point:
    """A named point: its place (2,) on the plane of the shape and standard deviation (each axis), m.

    ``pixel`` is the pixel (row, col) of the shape where its cloth was seen, or that of a floating
    ``piece`` which was placed there, by its index; None: predicted only. ``doubt_m`` is the part of its
    deviation that comes of other places of the outline.
    """

    uv_m: Float64
    std_m: float
    pixel: tuple[int, int] | None
    piece: int | None = None
    doubt_m: float = 0.0


def dimensions_of(fit: Fit, points: Mapping[str, Point]) -> dict[str, Measure]:
    """Return the dimensions of a fit, between its named points where they were found.

    A dimension that both sides have is the mean of both, weighted by how well their points are known. Its
    standard deviation is that of the symmetric outline, with the error and the doubt of its points.
    """
    count = len(fit.kind.parameters)
    covariance = fit.covariance[:count, :count]

    def lengths(parameters: Float64) -> Float64:
        named = fit.kind.named(parameters)
        pairs = fit.kind.dimensions.values()
        return np.stack([np.linalg.norm(named[a] - named[b], axis=0) for a, b in pairs])

    _, slope = with_slope(lengths, fit.parameters)
    outline_std = np.sqrt(np.einsum("kp,pq,kq->k", slope, covariance, slope))
    found: dict[str, Measure] = {}
    for (name, (a, b)), std in zip(fit.kind.dimensions.items(), outline_std, strict=True):
        pairs = {frozenset((a, b)), frozenset((_mirrored(a, points), _mirrored(b, points)))}
        ends = [tuple(points[end] for end in pair) for pair in pairs]
        variance = [one.std_m**2 + other.std_m**2 for one, other in ends]
        off = [float(np.linalg.norm(one.uv_m - other.uv_m)) for one, other in ends]
        doubt = min(max(one.doubt_m, other.doubt_m) for one, other in ends)
        found[name] = Measure(
            value_m=float(np.average(off, weights=1.0 / np.array(variance))),
            std_m=math.hypot(std, OUTLINE_STD_M, doubt),
        )
    return found


def _mirrored(name: str, points: Mapping[str, Point]) -> str:
    """Return the name of a point's mirror image; its own if there is none."""
    for side, other in (("_right", "_left"), ("_left", "_right")):
        if name.endswith(side) and (mirrored := name.removesuffix(side) + other) in points:
            return mirrored
    return name


def points_of(
    fit: Fit,
    shape: FlattenedView,
    main: PieceEvidence,
    held: Mapping[str, tuple[Float64, float]] = MappingProxyType({}),
) -> dict[str, Point]:
    """Return the named points of a fit on the plane of the shape; ``held`` are given (place, std) by hand.

    Cloth is not exactly symmetric: a point whose true edges were seen follows them.
    """
    count = len(fit.kind.parameters)
    pose = fit.garment_from_piece[0]
    joint = fit.covariance[: count + 3, : count + 3]
    names = list(fit.kind.named(fit.parameters[:, None]))

    def places(x: Float64) -> Float64:
        named = np.concatenate(list(fit.kind.named(x[:count]).values()))
        cos, sin = np.cos(x[count]), np.sin(x[count])
        u, v = named[0::2] - x[count + 1], named[1::2] - x[count + 2]
        return np.stack([cos * u + sin * v, -sin * u + cos * v], axis=1).reshape(-1, x.shape[1])

    x = np.concatenate([fit.parameters, [pose.theta_rad, pose.u_m, pose.v_m]])
    value, slope = with_slope(places, x)
    variance = np.einsum("kp,pq,kq->k", slope, joint, slope)
    outline_uv = pose.inverse().apply(fit.outline)
    points: dict[str, Point] = {}
    doubt = _doubt_of(fit, value.reshape(-1, 2)) if not held else np.zeros(len(names))
    for n, name in enumerate(names):
        own = np.s_[2 * n : 2 * n + 2]
        point_std = math.sqrt(float(variance[own].mean()) + OUTLINE_STD_M**2)
        uv, std = held[name] if name in held else _followed(value[own], point_std, outline_uv, main)
        doubt_m = math.sqrt(doubt[n])
        std = math.hypot(std, doubt_m)  # the edges nearby do not decide which optimum is right
        pixel = pixel_near(uv, shape) if std <= KNOWN_STD_M else None
        points[name] = Point(uv_m=uv, std_m=std, pixel=pixel, doubt_m=doubt_m)
    return points


def _doubt_of(fit: Fit, places: Float64) -> Float64:
    """Return the variance (N,) of named points at ``places`` (N, 2) by the other optima of the same kind.

    That of the mixture of all optima by their evidence, about the best one; none if that is sure. The
    corners of a towel have no order, so that its optima differ by their names only.
    """
    if fit.kind.corners is not None:
        return np.zeros(len(places))
    total, variance, known = 1.0, np.zeros(len(places)), [places]
    for below, other in fit.others:
        share = math.exp(min(below, 0.0) / TEMPERATURE)
        named = np.stack([place[:, 0] for place in other.kind.named(other.parameters[:, None]).values()])
        there = other.garment_from_piece[0].inverse().apply(named)
        # Several starts lead to the same optimum.
        if all(np.abs(there - each).max() > APART_M for each in known):
            known.append(there)
            total += share
            variance += share * np.square(there - places).sum(axis=1) / 2
    sure = 1.0 / total >= SURE
    found: Float64 = np.zeros(len(places)) if sure else variance / total
    return found


def pixel_near(uv: Float64, shape: FlattenedView) -> tuple[int, int] | None:
    """Return the pixel with cloth nearest to a place, None if none is within :data:`POINT_NEAR_M`."""
    row, col = shape.rc_from_uv(uv).tolist()
    radius_px = POINT_NEAR_M / shape.pixel_size_m
    first_row, first_col = max(0, math.floor(row - radius_px)), max(0, math.floor(col - radius_px))
    window = shape.valid[
        first_row : math.ceil(row + radius_px) + 1, first_col : math.ceil(col + radius_px) + 1
    ]
    if row < -radius_px or col < -radius_px or not window.any():
        return None
    rc = np.argwhere(window) + np.array([first_row, first_col])
    off = np.hypot(rc[:, 0] - row, rc[:, 1] - col)
    nearest = int(off.argmin())
    return (int(rc[nearest, 0]), int(rc[nearest, 1])) if off[nearest] <= radius_px else None


def _followed(uv: Float64, std_m: float, outline_uv: Float64, main: PieceEvidence) -> tuple[Float64, float]:
    """Return a named point moved with the true edges nearby, and its standard deviation then.

    The corner of the outline is shifted so that its sides meet the edges on either side of it: linear
    least squares of the shift (2,), with the fit as the prior and robust weights. How far the cloth there may
    be off is one error of all these edges.
    """
    near = np.linalg.norm(main.edge_uv_m - uv, axis=1) <= APART_M
    if near.sum() < 6:
        return uv, std_m
    q, normal, trust = main.edge_uv_m[near], main.edge_normal[near], main.edge_weight * main.edge_trust[near]
    edge_std_m = np.hypot(OUTLINE_STD_M, math.sqrt(trust.sum()) * main.edge_std_m[near])
    shift: Float64 = np.zeros(2)
    precision = np.eye(2) / std_m**2
    for _ in range(4):
        _, _, away, distance = to_edges(q - shift, normal, outline_uv)
        weight = trust * np.square(robust_weight(distance / edge_std_m) / edge_std_m)
        matrix = precision + (away * weight[:, None]).T @ away
        pull: Float64 = away.T @ (weight * (distance + away @ shift))
        shift = np.linalg.solve(matrix, pull).astype(np.float64)
    variance = float(np.trace(np.linalg.inv(matrix))) / 2
    return uv + shift, math.hypot(math.sqrt(variance), OUTLINE_STD_M)
