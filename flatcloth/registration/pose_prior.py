"""Prior of the errors of a recording's rotation: what can move, and by how much.

The axis is shifted and tilted, together with all views; each view is turned about it slightly more or less
than recorded, and swings about the held point. All these are small, so their effects on a view's motion
add up; they are given as twists (rotation vector, then shift; object frame).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from flatcloth.core.geometry import Rigid3, rotation_about, rotations_by
from flatcloth.core.types import Float64, RotationAxis
from flatcloth.flattening.surface import EXTENT_M

COMMON, OWN = 5, 3
"""Unknowns: shift (2) and tilt (2) of the axis, and the fattening; turn and swing (2) of each view. By
definition."""


@dataclass(frozen=True, kw_only=True)
class PosePrior:
    """Expected errors of recordings, before any comparison.

    The levels are a grid of hypotheses, from the accuracy of a turntable with a calibrated axis to that
    of the recordings ``*-loose`` and of hand-turned items; ``python -m benchmarks registration``
    measures the resulting poses.
    """

    turn_stds_deg: tuple[float, ...] = (0.03, 0.2, 0.6, 1.5)
    """Possible standard deviations of the recorded angles."""
    axis_stds_m: tuple[float, ...] = (0.0001, 0.001, 0.006)
    """Possible standard deviations of the axis' position."""
    swing_stds_deg: tuple[float, ...] = (0.02, 0.15, 0.8)
    """Possible standard deviations of the item's swing about the held point, from view to view."""
    fattening_std_px: float = 1.0
    """Standard deviation of the edge fattening, by which a stereo sensor makes near surfaces larger."""


def motion(twist: Float64, center_m: Float64) -> Rigid3:
    """Return the motion that first rotates about a center by a rotation vector and then shifts."""
    angle = float(np.linalg.norm(twist[:3]))
    turn = rotation_about(twist[:3] / angle, angle) if angle > 0 else np.eye(3)
    return Rigid3(turn, center_m - turn @ center_m + twist[3:])


def twists_between(
    one: tuple[Float64, Float64], other: tuple[Float64, Float64], centers_m: Float64
) -> Float64:
    """Return the twists (P, 6) about centers (P, 3) of ``other^-1 one``, those of :func:`motion`.

    ``one``, ``other`` are rotations (P, 3, 3) and translations (P, 3).
    """
    back, apart = other[0].transpose(0, 2, 1), one[1] - other[1]
    r = back @ one[0]
    axis = 0.5 * np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], axis=1)
    sine = np.linalg.norm(axis, axis=1)
    scale = np.where(sine > 1e-12, np.arcsin(np.minimum(1.0, sine)) / np.maximum(sine, 1e-12), 1.0)
    shift = np.einsum("pij,pj->pi", r, centers_m) + np.einsum("pij,pj->pi", back, apart) - centers_m
    return np.concatenate([scale[:, None] * axis, shift], axis=1)


def moved_axis(axis: RotationAxis, common: Float64) -> RotationAxis:
    """Return the axis, shifted and tilted by the common unknowns (5,)."""
    side, front = across(axis)
    direction = axis.direction + common[2] * side + common[3] * front
    return replace(
        axis,
        point_m=axis.point_m + common[0] * side + common[1] * front,
        direction=direction / np.linalg.norm(direction),
    )


def poses(
    axis: RotationAxis, held_point_m: Float64, angles_deg: list[float], common: Float64, own: Float64
) -> tuple[Rigid3, ...]:
    """Return ``object_from_camera`` of views from the common unknowns (5,) and those of each view (N, 3)."""
    moved = turns_and_shifts(axis, held_point_m, angles_deg, common, own)
    return tuple(Rigid3(rotation, shift_m) for rotation, shift_m in zip(*moved, strict=True))


def turns_and_shifts(
    axis: RotationAxis, held_point_m: Float64, angles_deg: list[float], common: Float64, own: Float64
) -> tuple[Float64, Float64]:
    """Return :func:`poses` as rotations (N, 3, 3) and translations (N, 3), m."""
    side, front = across(axis)
    turned = moved_axis(axis, common)
    swings = rotations_by(own[:, 1:2] * side + own[:, 2:] * front)
    turns = rotations_by((np.radians(angles_deg) + own[:, 0])[:, None] * -turned.direction)
    there = turned.point_m - turns @ turned.point_m - held_point_m
    return swings @ turns, held_point_m + np.einsum("nij,nj->ni", swings, there)


def jacobians_of(axis: RotationAxis, held_point_m: Float64, angles_deg: Sequence[float]) -> Float64:
    """Return the derivatives (N, 6, 7) of the views' twists about the origin of the object frame.

    Columns: its turn and swing (two directions), shift and tilt of the axis (two directions).
    """
    back, ways = rotations_by(np.radians(angles_deg)[:, None] * -axis.direction), across(axis)
    made = np.zeros((len(angles_deg), 2 * 3, OWN + 4))
    own = [_about(-axis.direction, axis.point_m), *(_about(way, held_point_m) for way in ways)]
    made[:, :, :OWN] = np.stack(own, axis=1)
    for n, way in enumerate(ways):
        tilt = _cross(axis.direction) @ way
        made[:, 3:, OWN + n] = way - back @ way
        made[:, :3, OWN + 2 + n] = tilt - back @ tilt
        made[:, 3:, OWN + 2 + n] = (tilt - back @ tilt) @ _cross(axis.point_m).T
    return made


def at_center(derivative: Float64, center_m: Float64) -> Float64:
    """Transform derivatives (..., 6, N) of twists about the origin to those about centers (..., 3)."""
    there = derivative.copy()
    there[..., 3:, :] -= _cross(center_m) @ derivative[..., :3, :]
    return there


@lru_cache(maxsize=4)
def grades(prior: PosePrior) -> Float64:
    """Return the grades of error (G, 3): standard deviations of turn (rad), axis (m) and swing (rad).

    The first is the smallest, the last the largest.
    """
    levels = [
        np.radians(prior.turn_stds_deg),
        np.array(prior.axis_stds_m),
        np.radians(prior.swing_stds_deg),
    ]
    return np.array(list(itertools.product(*levels)))


def chances(prior: PosePrior) -> Float64:
    """Return the prior probability (G,) of each grade."""
    chance = np.ones(len(grades(prior)))
    if len(chance) > 1:
        chance *= 0.5 / (len(chance) - 1)
        chance[0] = 0.5  # exact recordings are as probable as all others together
    return chance


def variances(n: int, grade: Float64, prior: PosePrior) -> Float64:
    """Return the prior variances (..., 5 + 3 n) of the unknowns at grades (..., 3)."""
    turn, axis, swing = np.moveaxis(np.square(grade), -1, 0)
    tilt, fattening = axis / EXTENT_M**2, np.full_like(axis, prior.fattening_std_px**2)
    common = np.stack([axis, axis, tilt, tilt, fattening], axis=-1)
    own = np.stack([turn, swing, swing], axis=-1)
    return np.concatenate([common, *[own] * n], axis=-1)


def pair_covariance(one: Float64, other: Float64, prior: PosePrior) -> Float64:
    """Return the prior covariance (6, 6) of a pair's twist at the largest grade.

    ``one``, ``other`` (6, 7) are the two views' derivatives about the centre of the twist.
    """
    likely = variances(1, grades(prior)[-1], prior)
    own, axis = likely[COMMON:], one[:, OWN:] - other[:, OWN:]
    covariance = (one[:, :OWN] * own) @ one[:, :OWN].T + (other[:, :OWN] * own) @ other[:, :OWN].T
    covariance += (axis * likely[:4]) @ axis.T
    # The cloth deforms slightly: motions as small as the smallest errors are explained by nothing else.
    rigid = np.repeat(np.square([math.radians(prior.swing_stds_deg[0]), prior.axis_stds_m[0]]), 3)
    return covariance + np.diag(rigid)


def across(axis: RotationAxis) -> tuple[Float64, Float64]:
    """Return two unit vectors perpendicular to the axis: sideways, and (camera level) towards the camera."""
    forward = np.array([0.0, 0.0, 1.0]) if axis.direction[2] ** 2 < 0.5 else np.array([0.0, 1.0, 0.0])
    side = _cross(axis.direction) @ forward
    side /= np.linalg.norm(side)
    return side, _cross(axis.direction) @ side


def _cross(a: Float64) -> Float64:
    """Return the matrices (..., 3, 3) of the cross products with vectors (..., 3)."""
    cross = np.zeros((*a.shape, 3))
    cross[..., 0, 1], cross[..., 0, 2], cross[..., 1, 2] = -a[..., 2], a[..., 1], -a[..., 0]
    cross[..., 1, 0], cross[..., 2, 0], cross[..., 2, 1] = a[..., 2], -a[..., 1], a[..., 0]
    return cross


def _about(turn: Float64, point_m: Float64) -> Float64:
    """Return the twist about the origin of a small rotation about a point."""
    return np.concatenate([turn, _cross(point_m) @ turn])
