"""The adjustment: the axis, turns and swings that explain the motions of all pairs of views together.

Input: the likelihood of the motion between the views of each pair. Output: the unknowns, how uncertain they
are, and the probability of each grade of the recording's errors. :mod:`.cameras` compares the pairs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtrs

from flatcloth.core.types import Float64, Int64
from flatcloth.registration.pairwise import PairFit
from flatcloth.registration.pose_prior import (
    COMMON,
    OWN,
    at_center,
    chances,
    grades,
    turns_and_shifts,
    twists_between,
    variances,
)
from flatcloth.registration.registered import Registered, Spread, scaled, surprise
from flatcloth.registration.view_features import MOTION, UNKNOWNS, ViewFeatures

_STEPS = 3
"""Gauss-Newton steps. Chosen for speed; the form is quadratic but for the robust weights."""


def solved(registered: Registered) -> Registered:
    """Find the unknowns that explain all pairs, averaged over the grades of the pose prior."""
    prior, n = registered.prior, len(registered.features)
    grid, chance = grades(prior), chances(prior)
    pairs = _linear(registered)
    posterior = registered.posterior
    for step in range(_STEPS):  # Gauss-Newton; all grades are averaged only in the last step
        used = np.arange(len(grid)) if step == _STEPS - 1 else np.flatnonzero(posterior)
        roots = np.sqrt(variances(n, grid[used], prior))
        x = np.concatenate([registered.common, registered.own.ravel()])
        matrix, right = _assembled(registered, pairs, trusting=step == 0)
        pull = right + matrix @ x
        # One grade after the other: the matrix of many views is large.
        logs, each = zip(*(_explained(root, matrix, pull) for root in roots), strict=True)
        own = np.exp(np.array(logs) - max(logs) + np.log(chance[used]))
        own[own < 1e-6 * own.sum()] = 0.0
        own /= own.sum()
        posterior, means = np.zeros(len(grid)), np.array(each)
        posterior[used] = own
        x = own @ means
        registered = replace(
            registered, common=x[:COMMON], own=x[COMMON:].reshape(n, OWN), posterior=posterior
        )
    likely = own > 0.0
    spread = Spread(chance=own[likely], root=roots[likely], off=means[likely] - x, matrix=matrix)
    return replace(registered, spread=spread)


def _explained(root: Float64, matrix: Float64, pull: Float64) -> tuple[float, Float64]:
    """Return the logarithm of how well a grade explains the pairs, but for a constant, and the unknowns (M,).

    The model is linear and Gaussian: with M of :func:`.registered.scaled` and ``pull`` b, it is
    (b' D^1/2 M^-1 D^1/2 b - log det M) / 2, and they are D^1/2 M^-1 D^1/2 b.
    """
    factor, failed = dpotrf(scaled(root, matrix).T, lower=1, overwrite_a=1)  # columns first; M is symmetric
    if failed:
        raise np.linalg.LinAlgError("the adjustment of the views is not finite")
    whitened, _ = dtrtrs(factor, root * pull, lower=1)
    found, _ = dtrtrs(factor, whitened, lower=1, trans=1)
    return float(0.5 * whitened @ whitened - np.log(np.diag(factor)).sum()), root * found


@dataclass(frozen=True, kw_only=True)
class _Linear:
    """What stays the same in all steps, of P pairs.

    ``ends`` (2, P) the views of each; ``centers_m`` (P, 3); ``form`` (P, 7, 7), ``gradient`` (P, 7) and
    ``solution`` (P, 7), where they hold, of its likelihood; ``rows`` (P, 7, 11) the derivative of its
    motion and fattening by the unknowns ``at`` (P, 11); ``share`` (P,) its weight. ``known_turns`` (N, 3, 3)
    and ``known_shifts_m`` (N, 3) are the known poses of the views.
    """

    ends: Int64
    centers_m: Float64
    form: Float64
    gradient: Float64
    solution: Float64
    rows: Float64
    at: Int64
    share: Float64
    known_turns: Float64
    known_shifts_m: Float64


def _linear(registered: Registered) -> _Linear | None:
    """Return the pairs as arrays; None without any."""
    pairs = registered.pairs
    if not pairs:
        return None
    ends = np.array([(p.first, p.second) for p in pairs]).T
    centers_m = np.array([p.center_m for p in pairs])
    one, other = (at_center(registered.jacobians[end], centers_m) for end in ends)
    rows = np.zeros((len(pairs), UNKNOWNS, COMMON + 2 * OWN))
    rows[:, 6, 4] = 1.0
    rows[:, :6, :4] = one[..., OWN:] - other[..., OWN:]
    rows[:, :6, COMMON : COMMON + OWN] = one[..., :OWN]
    rows[:, :6, COMMON + OWN :] = -other[..., :OWN]
    own = [COMMON + OWN * end[:, None] + np.arange(OWN) for end in ends]
    at = np.concatenate([np.broadcast_to(np.arange(COMMON), (len(pairs), COMMON)), *own], axis=1)
    return _Linear(
        ends=ends,
        centers_m=centers_m,
        form=np.array([p.matrix for p in pairs]),
        gradient=np.array([p.gradient for p in pairs]),
        solution=np.array([(*p.twist, p.fattening_px) for p in pairs]),
        rows=rows,
        at=at,
        share=_shares(registered.features, pairs),
        known_turns=np.array([pose.rotation for pose in registered.known]),
        known_shifts_m=np.array([pose.translation_m for pose in registered.known]),
    )


def _shares(features: tuple[ViewFeatures, ...], pairs: tuple[PairFit, ...]) -> Float64:
    """Weights (P,) of the pairs: k views of the same cloth make k (k - 1) / 2 pairs, but k measurements."""
    sees = np.ones(len(features))
    for p in pairs:
        for view in (p.first, p.second):
            sees[view] += min(1.0, 0.5 * p.count / len(features[view].points_m))
    return np.array([min(1.0, 4.0 / (sees[p.first] + sees[p.second])) for p in pairs])


def _pull(registered: Registered, pairs: _Linear) -> Float64:
    """Return the gradients (P, 7) of the pairs at the present unknowns."""
    now, shifts = turns_and_shifts(
        registered.axis, registered.held_point_m, registered.angles_deg, registered.common, registered.own
    )
    turns = now @ pairs.known_turns.transpose(0, 2, 1)
    shifts -= np.einsum("nij,nj->ni", turns, pairs.known_shifts_m)
    one, other = ((turns[end], shifts[end]) for end in pairs.ends)
    off = np.empty((len(pairs.at), UNKNOWNS))
    off[:, :6] = twists_between(one, other, pairs.centers_m)
    off[:, 6] = registered.fattening_px
    pull: Float64 = pairs.gradient + np.einsum("pij,pj->pi", pairs.form, off - pairs.solution)
    return pull


def _assembled(registered: Registered, pairs: _Linear | None, *, trusting: bool) -> tuple[Float64, Float64]:
    """Matrix (M, M) and right side (M,) of a step from the present state, from all pairs.

    Unless ``trusting``, a pair that contradicts the others loses its weight (Student's t, with as many
    degrees of freedom as a motion).
    """
    size = COMMON + OWN * len(registered.features)
    if pairs is None:
        return np.zeros((size, size)), np.zeros(size)
    pull, shares = _pull(registered, pairs), pairs.share
    if not trusting:
        shares = shares * np.minimum(1.0, 2.0 * MOTION / (MOTION + shares * surprise(pairs.form, pull)))
    weighed = shares[:, None, None] * pairs.rows.transpose(0, 2, 1)
    where = (size * pairs.at[:, :, None] + pairs.at[:, None, :]).ravel()
    matrix, right = np.zeros(size * size), np.zeros(size)
    matrix += np.bincount(where, (weighed @ pairs.form @ pairs.rows).ravel(), size * size)
    right -= np.bincount(pairs.at.ravel(), np.einsum("pij,pj->pi", weighed, pull).ravel(), size)
    return matrix.reshape(size, size), right
