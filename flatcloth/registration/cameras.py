"""Registration of the cameras in 3D, because the recorded rotation is only approximately right.

Angles are read off a turntable, the axis is measured once, and the cloth swings. The views are registered
in pairs, and one small adjustment explains all pairs together: the axis is shifted and tilted, every view is
turned slightly about it and swings slightly about the held point. The adjustment also estimates the edge
fattening of the sensor, which would pull convex cloth apart. The accuracy of a recording is unknown; it is
inferred from the evidence, so that exact poses stay exact.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, MutableMapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

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
    grades,
    jacobians_of,
    variances,
)
from flatcloth.registration.registered import Registered, Spread
from flatcloth.registration.view_features import MOST_APART_DEG, UNKNOWNS, ViewFeatures

_FURTHER_DEG = 20.0
"""On either side a view is compared with the nearest view, and with the nearest one at least so much further.
Chosen: near views tell an error of the axis from the edge fattening badly, far ones share little cloth."""

_START_STEPS = np.array([math.radians(0.2)] * 3 + [0.001] * 3 + [0.3])
"""Pairs are compared again from a start rounded to these steps of rotation, shift (m) and fattening (px).
Chosen: well below what a comparison corrects, so that sets of almost the same views share comparisons."""
_SURPRISING = float(chdtri(UNKNOWNS, 1e-3))
"""A pair that contradicts the others by more is compared again. Chosen: one in a thousand does by chance."""

Pair = tuple[int, int]
Start = tuple[int, ...] | None
Fits = MutableMapping[tuple[Pair, Start], PairFit | None]
"""What comparing two views of one recording gave, by their indices, the larger one first, and by the start in
steps, None at first; None where they have too little in common."""


def register(
    features: Sequence[ViewFeatures],
    axis: RotationAxis,
    held_point_m: Float64,
    fits: Fits | None = None,
    *,
    prior: PosePrior | None = None,
    confirmed: Registered | None = None,
    threads: int = 1,
) -> Registered:
    """Register a set of views.

    Parameters
    ----------
    features : sequence of ViewFeatures
        The views, by increasing view index.
    axis : RotationAxis
        The recorded axis, camera frame of view 0.
    held_point_m : (3,) float64
        The held point, camera frame of view 0, about which the item swings.
    fits : mutable mapping, optional
        Pairs of views of this recording that were compared before, by the same axis, held point and prior;
        those compared now are added.
    prior : PosePrior, optional
        Expected errors of recordings.
    confirmed : Registered, optional
        A registration of the same recording that confirms its poses: no views are compared, and all are as
        sure as those.
    threads : int
        How many pairs are compared at the same time.

    Returns
    -------
    Registered
        A view with too little in common with the others keeps the pose of the axis and its recorded angle.

    Notes
    -----
    The result depends on the set only. Two views are compared from their recorded poses on, whatever other
    views there are; those that contradict the others are compared again at the fattening and from the poses
    that all together have, which are rounded so that other sets can use what that gives.
    """
    prior, fits = prior or PosePrior(), {} if fits is None else fits
    held_point_m = np.asarray(held_point_m, dtype=np.float64)
    known = tuple(object_from_camera(axis, seen.angle_deg) for seen in features)
    begun = Registered(
        axis=axis,
        held_point_m=held_point_m,
        prior=prior,
        features=tuple(features),
        known=known,
        jacobians=jacobians_of(axis, held_point_m, [seen.angle_deg for seen in features]),
        common=np.zeros(COMMON) if confirmed is None else confirmed.common,
        own=np.zeros((len(features), OWN)),
        spread=Spread.by_prior(np.zeros(0)),
        posterior=chances(prior) if confirmed is None else confirmed.posterior,
    )
    if confirmed is not None or not features:
        grade = grades(prior)[-1 if confirmed is None else begun.posterior.argmax()]
        return replace(begun, spread=Spread.by_prior(np.sqrt(variances(len(features), grade, prior))))
    index = [seen.view_index for seen in features]
    pairs = {(index[n], index[m]): (n, m) for n, m in _pairs(begun.angles_deg)}

    def solve(starts: Mapping[Pair, Start]) -> Registered:
        missing = [key for key in starts.items() if key not in fits]
        with ThreadPoolExecutor(threads) as pool:
            made = pool.map(lambda key: _fitted(begun, pairs[key[0]], key[1]), missing)
            fits.update(zip(missing, made, strict=True))
        found = ((fits[key], pairs[key[0]]) for key in starts.items())
        used = (replace(fit, first=n, second=m) for fit, (n, m) in found if fit is not None)
        return solved(replace(begun, pairs=tuple(used)))

    starts: dict[Pair, Start] = dict.fromkeys(pairs)
    registered = solve(starts)
    again = registered.surprises > _SURPRISING
    if not again.any():
        return registered
    for n in np.flatnonzero(again):
        fit = registered.pairs[n]
        start = np.array([*registered.twists[n], registered.fattening_px])
        starts[index[fit.first], index[fit.second]] = tuple(
            np.rint(start / _START_STEPS).astype(int).tolist()
        )
    return solve(starts)


def _pairs(angles_deg: Sequence[float]) -> list[tuple[int, int]]:
    """Return the pairs of views to compare, the later view first: on either side of each, one or two."""
    angles, found = np.asarray(angles_deg), set[tuple[int, int]]()
    for n, sign in itertools.product(range(len(angles)), (1.0, -1.0)):
        apart = sign * (angles - angles[n]) % 360.0
        apart[n] = np.inf
        nearest = float(apart.min())
        for least in (nearest, nearest + _FURTHER_DEG):
            m = int(np.where(apart < least, np.inf, apart).argmin())
            if apart[m] <= MOST_APART_DEG:
                found.add((max(n, m), min(n, m)))
    return sorted(found)


def _fitted(registered: Registered, pair: Pair, start: Start) -> PairFit | None:
    """Compare two views: from their recorded poses on, or from a start in steps from there."""
    one, other = (registered.features[n] for n in pair)
    poses = registered.known[pair[0]], registered.known[pair[1]]
    center: Float64 = 0.5 * (poses[0].apply(one.middle_m) + poses[1].apply(other.middle_m))
    about = at_center(registered.jacobians[pair[0]], center), at_center(registered.jacobians[pair[1]], center)
    begin = None if start is None else _START_STEPS * start
    return fit_pair((one, other), poses, pair, about, center, registered.prior, begin)
