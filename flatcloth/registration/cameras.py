"""Registration of the cameras in 3D, because the recorded rotation is only approximately right.

Angles are read off a turntable, the axis is measured once, and the cloth swings. The views are registered
in pairs, and one small adjustment explains all pairs together: the axis is shifted and tilted, every view is
turned slightly about it and swings slightly about the held point. The adjustment also estimates the edge
fattening of the sensor, which would pull convex cloth apart. The accuracy of a recording is unknown; it is
inferred from the evidence, so that exact poses stay exact.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from flatcloth.core.geometry import Rigid3, held_from_camera
from flatcloth.core.types import Float64, RotationAxis
from flatcloth.registration.adjustment import middle_m, relative_stds, solved
from flatcloth.registration.pairwise import PairFit, fit_pair
from flatcloth.registration.pose_prior import (
    COMMON,
    OWN,
    PosePrior,
    at_center,
    chances,
    expected_displacement_m,
    grades,
    jacobian,
    moved_axis,
    pair_covariance,
    poses,
    twist_of,
    variances,
)
from flatcloth.registration.view_features import ViewFeatures

_LOOSE_TURN_DEG = 0.4
"""The recorded rotation is kept unless the estimated errors of angles, ..."""
_LOOSE_AXIS_M = 0.0025
"""... axis, ..."""
_LOOSE_SWING_DEG = 0.5
"""... or swing exceed these limits. Set by hand."""
MOST_APART_DEG = 65.0
"""Views with directions farther apart than this share little cloth. Set by hand."""
_MOST_PARTNERS, _FEW_PARTNERS, _CONFIRMING_VIEWS = 6, 3, 8
"""Most views that a view is compared with: first, and once so many confirm recorded poses. Set by hand."""
_REFITS = 3
"""How often pairs are registered again after a view was added, ..."""
_REFIT_FATTENING_PX = 0.15
"""... if the fattening has changed by more than this. Set by hand."""

__all__ = [
    "Registered",
    "Registration",
    "begin_registration",
    "describe",
    "extend_registration",
    "register_all",
    "register_together",
]


@dataclass(frozen=True, kw_only=True)
class Registration:
    """The pose of a view's camera, the change by registration, and its uncertainty.

    ``held_from_camera`` is the refined motion. ``turned_deg`` is the rotation of the item in addition to
    the recorded one, ``swung_deg`` its tilt about the held point, ``moved_m`` the displacement of the
    centre of the view's surface by all changes, including the axis. ``std_deg`` and ``std_m`` (3,) are
    standard deviations of rotation and position of that centre (object frame: x, y, z) relative to the
    views it was compared with, or to the recorded motion if there are none. ``views`` are those views,
    ``points`` is the number of compared points, ``distance_m`` their typical distance before and after.
    """

    view_index: int
    held_from_camera: Rigid3
    turned_deg: float
    swung_deg: float
    moved_m: float
    std_deg: Float64
    std_m: Float64
    views: tuple[int, ...]
    points: int
    distance_m: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Registered:
    """All accepted views, registered together. Immutable: undo by keeping the previous object.

    ``axis``, ``held_point_m`` as recorded; ``features`` and ``known`` (held from camera) in order of
    acceptance; ``pairs`` the result of each pair. ``common`` (5,): shift (m) and tilt (rad) of the
    axis, fattening (px); ``own`` (N, 3): turn and swing of each view, rad; ``covariance`` of both, in
    this order; ``posterior`` (G,): probability of each grade of the pose prior.
    """

    axis: RotationAxis
    held_point_m: Float64
    prior: PosePrior
    features: tuple[ViewFeatures, ...] = ()
    known: tuple[Rigid3, ...] = ()
    jacobians: tuple[Float64, ...] = ()
    pairs: tuple[PairFit, ...] = ()
    common: Float64
    own: Float64
    covariance: Float64
    posterior: Float64

    @property
    def refined_axis(self) -> RotationAxis:
        """The axis as estimated from the views."""
        return moved_axis(self.axis, self.common)

    @property
    def error_stds(self) -> tuple[float, float, float]:
        """Estimated errors of the recording: standard deviations of turn (deg), axis (m) and swing (deg)."""
        turn, axis, swing = np.sqrt(self.posterior @ np.square(grades(self.prior)))
        return math.degrees(turn), float(axis), math.degrees(swing)

    @property
    def is_loose(self) -> bool:
        """Whether the views show that the recorded poses are wrong."""
        turn_deg, axis_m, swing_deg = self.error_stds
        return turn_deg > _LOOSE_TURN_DEG or axis_m > _LOOSE_AXIS_M or swing_deg > _LOOSE_SWING_DEG

    @property
    def fattening_px(self) -> float:
        """Edge fattening of the sensor in pixels."""
        return float(self.common[4])

    @property
    def fattening_std_px(self) -> float:
        """Standard deviation of the edge fattening."""
        return math.sqrt(float(self.covariance[4, 4]))

    @property
    def axis_moved_m(self) -> float:
        """Distance of the estimated axis from the recorded one, at its point."""
        return math.hypot(*self.common[:2])

    @property
    def axis_std_m(self) -> float:
        """Standard deviation of the axis' position, in the less certain direction."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))

    @property
    def angles_deg(self) -> list[float]:
        """Recorded angle of each view."""
        return [seen.angle_deg for seen in self.features]

    @cached_property
    def held_from_camera(self) -> tuple[Rigid3, ...]:
        """Pose of the camera of each view."""
        return poses(self.axis, self.held_point_m, self.angles_deg, self.common, self.own)

    @cached_property
    def stds(self) -> Float64:
        """(N, 6) standard deviations of rotation (rad) and position (m); see :class:`Registration`."""
        return relative_stds(self)

    @cached_property
    def views(self) -> tuple[Registration, ...]:
        """The report of each view, in order of acceptance."""
        return tuple(_report(self, n) for n in range(len(self.features)))


def describe(registered: Registered) -> str:
    """Summarise the registration and its uncertainty in one line."""
    if not registered.pairs:
        return "No two views share enough cloth for registration; the recorded poses are used."
    paired = np.unique([end for pair in registered.pairs for end in (pair.first, pair.second)])
    sure_mm = 1e3 * float(np.median(np.linalg.norm(registered.stds[paired, 3:], axis=1)))
    if not registered.is_loose:
        return f"Recorded angles and axis are confirmed; neighbouring views agree to about {sure_mm:.1f} mm."
    turned = math.degrees(np.abs(registered.own[:, 0]).max())
    swung = math.degrees(np.hypot(registered.own[:, 1], registered.own[:, 2]).max())
    return (
        f"Cameras registered: the axis moved by {1e3 * registered.axis_moved_m:.1f} mm "
        f"(+-{1e3 * registered.axis_std_m:.1f}), angles by up to {turned:.1f} degrees, swing up to "
        f"{swung:.1f} degrees; neighbouring views agree to about {sure_mm:.1f} mm."
    )


def begin_registration(
    axis: RotationAxis, held_point_m: Float64, prior: PosePrior | None = None
) -> Registered:
    """Return a registration without views.

    Parameters
    ----------
    axis : RotationAxis
        The recorded axis, camera frame of view 0.
    held_point_m : (3,) float64
        The held point, camera frame of view 0, about which the item swings.
    prior : PosePrior, optional
        Expected errors of recordings.
    """
    prior = prior or PosePrior()
    return Registered(
        axis=axis,
        held_point_m=np.asarray(held_point_m, dtype=np.float64),
        prior=prior,
        common=np.zeros(COMMON),
        own=np.zeros((0, OWN)),
        covariance=np.diag(variances(0, grades(prior)[-1], prior)),
        posterior=chances(prior),
    )


def register_all(
    features: Sequence[ViewFeatures],
    axis: RotationAxis,
    held_point_m: Float64,
    prior: PosePrior | None = None,
) -> Registered:
    """Register views in order; see :func:`begin_registration` and :func:`extend_registration`."""
    registered = begin_registration(axis, held_point_m, prior)
    for seen in features:
        registered = extend_registration(registered, seen)
    return registered


def register_together(
    features: Sequence[ViewFeatures],
    axis: RotationAxis,
    held_point_m: Float64,
    prior: PosePrior | None = None,
    partners: int = _MOST_PARTNERS,
    fattening_px: float = 0.0,
    threads: int = 1,
) -> Registered:
    """Register all views at once: the same model as :func:`register_all`, solved once.

    Pairs are compared from the recorded poses on, not from those refined before, and each view with
    ``partners`` before it only: that tells in a fraction of the time whether the views stand as recorded.
    Near the value of ``fattening_px`` no pair is compared twice.
    """
    registered = begin_registration(axis, held_point_m, prior)
    registered = replace(
        registered,
        common=np.append(registered.common[:4], fattening_px),
        features=tuple(features),
        known=tuple(held_from_camera(axis, seen.angle_deg) for seen in features),
        jacobians=tuple(jacobian(axis, registered.held_point_m, seen.angle_deg) for seen in features),
        own=np.zeros((len(features), OWN)),
    )
    pairs = [(n, m) for n in range(1, len(features)) for m in _partners(registered, n)[:partners]]
    with ThreadPoolExecutor(threads) as pool:
        fits = list(pool.map(lambda pair: _fitted(registered, pair[0], pair[1], None), pairs))
    fitted = tuple(fit for fit in fits if fit is not None)
    return _refitted(solved(replace(registered, pairs=fitted)), threads)


def extend_registration(registered: Registered, new: ViewFeatures) -> Registered:
    """Add a view; the poses of all views are estimated again.

    Parameters
    ----------
    registered : Registered
        The views so far.
    new : ViewFeatures
        The view to add.

    Returns
    -------
    Registered
        A view with too little in common with the others keeps the pose of the axis and its
        recorded angle.

    Notes
    -----
    Only the new pairs are compared, and old pairs that were compared at another fattening.
    """
    n = len(registered.features)
    grown = replace(
        registered,
        features=(*registered.features, new),
        known=(*registered.known, held_from_camera(registered.axis, new.angle_deg)),
        jacobians=(*registered.jacobians, jacobian(registered.axis, registered.held_point_m, new.angle_deg)),
        own=np.concatenate([registered.own, np.zeros((1, OWN))]),
    )
    fits = [_fitted(grown, n, partner, None) for partner in _partners(grown, n)]
    return _refitted(solved(replace(grown, pairs=(*grown.pairs, *(fit for fit in fits if fit is not None)))))


def _refitted(registered: Registered, threads: int = 1) -> Registered:
    """Compare those pairs anew that were compared at another fattening."""
    for _ in range(_REFITS):
        if not any(_is_outdated(registered, pair) for pair in registered.pairs):
            break
        with ThreadPoolExecutor(threads) as pool:
            fits = list(pool.map(partial(_fresh, registered), registered.pairs))
        registered = solved(replace(registered, pairs=tuple(p for p in fits if p is not None)))
    return registered


def _partners(registered: Registered, n: int) -> list[int]:
    """Return the views with near enough directions, nearest first."""
    looks = np.array([held.rotation[:, 2] for held in registered.known])
    cos = looks[:n] @ looks[n]
    confirmed = n >= _CONFIRMING_VIEWS and not registered.is_loose
    order = np.argsort(-cos, kind="stable")[: _FEW_PARTNERS if confirmed else _MOST_PARTNERS]
    return [int(i) for i in order if cos[i] >= math.cos(math.radians(MOST_APART_DEG))]


def _fitted(registered: Registered, first: int, second: int, before: PairFit | None) -> PairFit | None:
    one, other = registered.features[first], registered.features[second]
    held = registered.known[first], registered.known[second]
    middle: Float64 = 0.5 * (middle_m(one, held[0]) + middle_m(other, held[1]))
    center = middle if before is None else before.center_m
    now = registered.held_from_camera[first], registered.held_from_camera[second]
    about = at_center(registered.jacobians[first], center), at_center(registered.jacobians[second], center)
    return fit_pair(
        (one, other),
        held,
        (first, second),
        pair_covariance(*about, registered.prior),
        center_m=center,
        uncertainty_m=expected_displacement_m(*about, registered.prior, registered.posterior),
        fattening_px=registered.fattening_px,
        twist=twist_of((now[1] @ held[1].inverse()).inverse() @ now[0] @ held[0].inverse(), center),
        before=before,
    )


def _is_outdated(registered: Registered, pair: PairFit) -> bool:
    return abs(registered.fattening_px - pair.fattening_px) > _REFIT_FATTENING_PX


def _fresh(registered: Registered, pair: PairFit) -> PairFit | None:
    return _fitted(registered, pair.first, pair.second, pair) if _is_outdated(registered, pair) else pair


def _report(registered: Registered, n: int) -> Registration:
    seen, known, pose = registered.features[n], registered.known[n], registered.held_from_camera[n]
    own, middle = registered.own[n], middle_m(seen, known)
    pairs = [p for p in registered.pairs if n in (p.first, p.second)]
    partners = [p.second if p.first == n else p.first for p in pairs]
    counts = np.array([float(p.count) for p in pairs])
    typical = [math.nan, math.nan]
    if pairs:
        typical = [float(counts @ [p.distance_m[i] for p in pairs] / counts.sum()) for i in (0, 1)]
    return Registration(
        view_index=seen.view_index,
        held_from_camera=pose,
        turned_deg=math.degrees(own[0]),
        swung_deg=math.degrees(math.hypot(own[1], own[2])),
        moved_m=float(np.linalg.norm((pose @ known.inverse()).apply(middle) - middle)),
        std_deg=np.degrees(registered.stds[n, :3]),
        std_m=registered.stds[n, 3:],
        views=tuple(registered.features[i].view_index for i in partners),
        points=int(counts.sum()),
        distance_m=(typical[0], typical[1]),
    )
