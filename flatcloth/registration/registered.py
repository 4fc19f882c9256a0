"""Registered views: the unknowns with their covariance, and what follows from them.

:mod:`.adjustment` solves for the unknowns of the pairs that :mod:`.cameras` compares.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import Float64, RotationAxis
from flatcloth.registration.pairwise import PairFit
from flatcloth.registration.pose_prior import (
    COMMON,
    OWN,
    PosePrior,
    at_center,
    grades,
    poses,
    twists_between,
)
from flatcloth.registration.view_features import UNKNOWNS, ViewFeatures


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How uncertain the M unknowns are: a mixture of Gaussians, one for each of K likely grades.

    ``chance`` (K,) of each grade; ``root`` (K, M) of its prior variances; ``off`` (K, M) its mean minus
    that of all; ``matrix`` (M, M) of the evidence of all pairs, which the grades share.
    """

    chance: Float64
    root: Float64
    off: Float64
    matrix: Float64

    @classmethod
    def by_prior(cls, root: Float64) -> Spread:
        """Return that of one grade (M,) without evidence."""
        size = len(root)
        return cls(chance=np.ones(1), root=root[None], off=np.zeros((1, size)), matrix=np.zeros((size, size)))

    def covariance(self) -> Float64:
        """Return the covariance (M, M) of the mixture."""
        made: Float64 = (self.chance[:, None] * self.off).T @ self.off
        for chance, root in zip(self.chance, self.root, strict=True):
            made += chance * root[:, None] * np.linalg.inv(scaled(root, self.matrix)) * root
        return made


def scaled(root: Float64, matrix: Float64) -> Float64:
    """Return M = 1 + D^1/2 A D^1/2 (M, M) for the root (M,) of the prior's variances D."""
    made: Float64 = root[:, None] * matrix * root
    np.einsum("ii->i", made)[:] += 1.0
    return made


@dataclass(frozen=True, kw_only=True)
class Registered:
    """A set of views, registered together; immutable.

    ``axis``, ``held_point_m`` as recorded; ``features`` and ``known`` (object from camera) by increasing
    view index, as all that is given for each view; ``pairs`` the result of each pair. ``common`` (5,):
    shift (m) and tilt (rad) of the axis, fattening (px); ``own`` (N, 3): turn and swing of each view, rad;
    ``spread`` of both, in this order; ``posterior`` (G,): probability of each grade of the pose prior.
    """

    axis: RotationAxis
    held_point_m: Float64
    prior: PosePrior
    features: tuple[ViewFeatures, ...] = ()
    known: tuple[Rigid3, ...] = ()
    jacobians: Float64
    pairs: tuple[PairFit, ...] = ()
    common: Float64
    own: Float64
    spread: Spread
    posterior: Float64

    @cached_property
    def covariance(self) -> Float64:
        """Covariance (M, M) of the unknowns; needed by few, so computed on request."""
        return self.spread.covariance()

    @property
    def error_stds(self) -> tuple[float, float, float]:
        """Estimated errors of the recording: standard deviations of turn (deg), axis (m) and swing (deg)."""
        turn, axis, swing = np.sqrt(self.posterior @ np.square(grades(self.prior)))
        return math.degrees(turn), float(axis), math.degrees(swing)

    @property
    def is_confirmed(self) -> bool:
        """Whether, by the views, the recorded poses are more probably exact than not."""
        return bool(self.posterior[0] > 0.5)

    @property
    def is_loose(self) -> bool:
        """Whether the views show that the recorded poses are wrong by more than a sensor's errors look like.

        Those of exact recordings look like a turn and a shift of the axis of up to 0.3 degrees and 1.3 mm,
        but like no swing.
        """
        turn, axis, swing = self.prior.turn_stds_deg, self.prior.axis_stds_m, self.prior.swing_stds_deg
        between = zip(self.error_stds, (turn[1:], axis[1:], swing), strict=True)
        return any(std > math.sqrt(level[0] * level[1]) for std, level in between if len(level) > 1)

    @property
    def fattening_px(self) -> float:
        """Edge fattening of the sensor in pixels."""
        return float(self.common[4])

    @property
    def axis_moved_m(self) -> float:
        """Distance of the estimated axis from the recorded one, at its point."""
        return math.hypot(*self.common[:2])

    @property
    def axis_std_m(self) -> float:
        """Standard deviation of the axis' position, in the less certain direction."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))

    @property
    def view_indices(self) -> tuple[int, ...]:
        """Index of each view."""
        return tuple(seen.view_index for seen in self.features)

    @property
    def angles_deg(self) -> list[float]:
        """Recorded angle of each view."""
        return [seen.angle_deg for seen in self.features]

    @cached_property
    def object_from_camera(self) -> tuple[Rigid3, ...]:
        """Pose of the camera of each view."""
        return poses(self.axis, self.held_point_m, self.angles_deg, self.common, self.own)

    @cached_property
    def stds(self) -> Float64:
        """(N, 6) standard deviations of rotation (rad) and position (m) of the middle of each view's surface.

        Object frame (x, y, z), relative to the views it was compared with, or to the recorded motion if there
        are none.
        """
        return _relative_stds(self)

    @property
    def moved_m(self) -> Float64:
        """(N,) displacement of the middle of each view's surface by all changes, including the axis."""
        moved = []
        for seen, known, now in zip(self.features, self.known, self.object_from_camera, strict=True):
            middle_m = known.apply(seen.middle_m)
            moved.append(np.linalg.norm((now @ known.inverse()).apply(middle_m) - middle_m))
        return np.array(moved)

    @cached_property
    def twists(self) -> Float64:
        """Motion (P, 6) of the first view of each pair against the second: see :class:`.pairwise.PairFit`."""
        moved = [
            now @ known.inverse() for now, known in zip(self.object_from_camera, self.known, strict=True)
        ]
        turns, shifts = np.array([m.rotation for m in moved]), np.array([m.translation_m for m in moved])
        one, other = np.array([(pair.first, pair.second) for pair in self.pairs]).T
        centers_m = np.array([pair.center_m for pair in self.pairs])
        return twists_between((turns[one], shifts[one]), (turns[other], shifts[other]), centers_m)

    @cached_property
    def surprises(self) -> Float64:
        """By how much each pair (P,) contradicts the registered poses: see :func:`surprise`.

        An item twists and bends while it sways. So views may be off by what is allowed to the poses of an
        exact turntable (the prior's first level), too: else little of what an exact sensor sees would fit.
        """
        if not self.pairs:
            return np.zeros(0)
        off = np.column_stack([self.twists, np.full(len(self.pairs), self.fattening_px)])
        off -= np.array([(*pair.twist, pair.fattening_px) for pair in self.pairs])
        form = np.array([pair.matrix for pair in self.pairs])
        pull = np.array([pair.gradient for pair in self.pairs]) + np.einsum("pij,pj->pi", form, off)
        turn, shift_m = math.radians(self.prior.turn_stds_deg[0]), self.prior.axis_stds_m[0]
        return surprise(form, pull, np.repeat([turn, shift_m], 3))


def surprise(form: Float64, pull: Float64, free: Float64 | None = None) -> Float64:
    """Return by how much pairs (P,) are less likely than at their best, twice the logarithm.

    ``form`` (P, 7, 7) and ``pull`` (P, 7) are matrix and gradient of the negative log likelihood. If the
    stated deviations are right, it follows a chi-squared distribution with 7 degrees of freedom. ``free``
    (6,) are deviations of the motion by which each pair may be off besides.
    """
    best = np.linalg.solve(form + 1e-6 * np.eye(UNKNOWNS), pull[..., None])[..., 0]
    surprises: Float64 = (pull * best).sum(axis=1)
    if free is not None:  # (F^-1 + T)^-1 in place of F, by Woodbury's identity
        form, pull = form[:, :6, :6] + np.diag(1.0 / np.square(free)), pull[:, :6]
        surprises -= (pull * np.linalg.solve(form, pull[..., None])[..., 0]).sum(axis=1)
    return surprises


def describe(registered: Registered) -> str:
    """Summarise the registration and its uncertainty in one line."""
    if not registered.pairs:
        return "No two views share enough cloth for registration; the recorded poses are used."
    paired = np.unique([end for pair in registered.pairs for end in (pair.first, pair.second)])
    sure_mm = 1e3 * float(np.median(np.linalg.norm(registered.stds[paired, 3:], axis=1)))
    agree = f"neighbouring views agree to about {sure_mm:.1f} mm."
    if not registered.is_loose:
        if registered.is_confirmed:
            return f"Recorded angles and axis are confirmed; {agree}"
        turn, axis, swing = registered.error_stds
        return (
            f"Recorded angles and axis are used, though the views differ from them by some {turn:.2f} "
            f"degrees of turn, {1e3 * axis:.1f} mm and {swing:.2f} degrees of swing, as errors of depth "
            f"may; {agree}"
        )
    turned = math.degrees(np.abs(registered.own[:, 0]).max())
    swung = math.degrees(np.hypot(registered.own[:, 1], registered.own[:, 2]).max())
    return (
        f"Cameras registered: the axis moved by {1e3 * registered.axis_moved_m:.1f} mm "
        f"(+-{1e3 * registered.axis_std_m:.1f}), angles by up to {turned:.1f} degrees, swing up to "
        f"{swung:.1f} degrees; {agree}"
    )


def _relative_stds(registered: Registered) -> Float64:
    """Return the standard deviations (N, 6) of each view's twist about its middle, relative to its partners.

    Views without partners: relative to the recorded motion. Rotation (rad), then position (m).
    """
    views = len(registered.features)
    points = np.zeros((views, views))  # that two views share
    for p in registered.pairs:
        points[p.first, p.second] = points[p.second, p.first] = p.count
    share = np.eye(views) - points / np.maximum(points.sum(axis=1, keepdims=True), 1.0)
    middles = [
        pose.apply(seen.middle_m) for seen, pose in zip(registered.features, registered.known, strict=True)
    ]
    of, by = np.nonzero(share)
    change = at_center(registered.jacobians[by], np.stack(middles)[of]) * share[of, by, None, None]
    common, own = np.zeros((views, 6, COMMON)), np.zeros((views, 6, views, OWN))
    np.add.at(common[:, :, :4], of, change[:, :, OWN:])
    own[of, :, by] = change[:, :, :OWN]
    rows = np.concatenate([common, own.reshape(views, 6, -1)], axis=2)
    spread: Float64 = rows.reshape(6 * views, -1) @ registered.covariance
    variance = (spread.reshape(rows.shape) * rows).sum(axis=2)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))
