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
from dataclasses import replace

import numpy as np

from flatcloth.core.geometry import object_from_camera
from flatcloth.core.types import Float64, RotationAxis
from flatcloth.registration.adjustment import solved
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
    pair_covariance,
    twist_of,
    variances,
)
from flatcloth.registration.registered import Registered, Spread
from flatcloth.registration.view_features import MOST_APART_DEG, ViewFeatures

_PARTNERS = 4
"""Most views that a view is compared with. Set by hand."""
_REFIT_FATTENING_PX = 0.15
"""Pairs are compared again if the fattening has changed by more than this. Set by hand."""


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
        spread=Spread.by_prior(np.sqrt(variances(0, grades(prior)[-1], prior))),
        posterior=chances(prior),
    )


def confirmed_by(registered: Registered) -> Registered:
    """Return a registration without views, as sure as that of the same recording by its other side.

    It confirms the recorded poses; views are added by :func:`with_confirmed`.
    """
    return replace(
        begin_registration(registered.axis, registered.held_point_m, registered.prior),
        common=registered.common,
        posterior=registered.posterior,
    )


def with_confirmed(registered: Registered, new: ViewFeatures) -> Registered:
    """Add a view where it is recorded: nothing is compared."""
    grown = _with_views(registered, [new])
    likeliest = grades(grown.prior)[grown.posterior.argmax()]
    return replace(
        grown, spread=Spread.by_prior(np.sqrt(variances(len(grown.features), likeliest, grown.prior)))
    )


def register_together(
    features: Sequence[ViewFeatures],
    axis: RotationAxis,
    held_point_m: Float64,
    partners: int = _PARTNERS,
    fattening_px: float = 0.0,
    threads: int = 1,
) -> Registered:
    """Register all views at once: the same model as view by view, solved once.

    Pairs are compared from the recorded poses on, not from those refined before, and each view with
    ``partners`` before it only: that shows in a fraction of the time whether the recorded poses are right.
    """
    registered = begin_registration(axis, held_point_m)
    registered = _with_views(
        replace(registered, common=np.append(registered.common[:4], fattening_px)), features
    )
    pairs = [(n, m) for n in range(1, len(features)) for m in _partners(registered, n)[:partners]]
    with ThreadPoolExecutor(threads) as pool:
        fits = list(pool.map(lambda pair: _fitted(registered, *pair), pairs))
    return _solved_again(registered, fits, threads)


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
    n, grown = len(registered.features), _with_views(registered, [new])
    fits = [_fitted(grown, n, partner) for partner in _partners(grown, n)]
    return _solved_again(grown, [*grown.pairs, *fits])


def _with_views(registered: Registered, features: Sequence[ViewFeatures]) -> Registered:
    """Add views where they are recorded, compared with no other."""
    axis, held_point_m = registered.axis, registered.held_point_m
    return replace(
        registered,
        features=(*registered.features, *features),
        known=(*registered.known, *(object_from_camera(axis, seen.angle_deg) for seen in features)),
        jacobians=(
            *registered.jacobians,
            *(jacobian(axis, held_point_m, seen.angle_deg) for seen in features),
        ),
        own=np.concatenate([registered.own, np.zeros((len(features), OWN))]),
    )


def _solved_again(registered: Registered, fits: Sequence[PairFit | None], threads: int = 1) -> Registered:
    """Solve for the unknowns, and again after comparing the pairs of another fattening again."""
    registered = solved(replace(registered, pairs=tuple(fit for fit in fits if fit is not None)))

    def is_outdated(pair: PairFit) -> bool:
        return abs(registered.fattening_px - pair.fattening_px) > _REFIT_FATTENING_PX

    if not any(map(is_outdated, registered.pairs)):
        return registered
    with ThreadPoolExecutor(threads) as pool:
        again = list(
            pool.map(
                lambda pair: _fitted(registered, pair.first, pair.second) if is_outdated(pair) else pair,
                registered.pairs,
            )
        )
    return solved(replace(registered, pairs=tuple(fit for fit in again if fit is not None)))


def _partners(registered: Registered, n: int) -> list[int]:
    """Return the views with near enough directions, nearest first."""
    looks = np.array([pose.rotation[:, 2] for pose in registered.known])
    cos = looks[:n] @ looks[n]
    order = np.argsort(-cos, kind="stable")[:_PARTNERS]
    return [int(i) for i in order if cos[i] >= math.cos(math.radians(MOST_APART_DEG))]


def _fitted(registered: Registered, first: int, second: int) -> PairFit | None:
    """Compare two views, from their present poses on."""
    one, other = registered.features[first], registered.features[second]
    poses = registered.known[first], registered.known[second]
    center: Float64 = 0.5 * (poses[0].apply(one.middle_m) + poses[1].apply(other.middle_m))
    now = registered.object_from_camera[first], registered.object_from_camera[second]
    about = at_center(registered.jacobians[first], center), at_center(registered.jacobians[second], center)
    return fit_pair(
        (one, other),
        poses,
        (first, second),
        pair_covariance(*about, registered.prior),
        center_m=center,
        uncertainty_m=expected_displacement_m(*about, registered.prior, registered.posterior),
        fattening_px=registered.fattening_px,
        twist=twist_of((now[1] @ poses[1].inverse()).inverse() @ now[0] @ poses[0].inverse(), center),
    )
