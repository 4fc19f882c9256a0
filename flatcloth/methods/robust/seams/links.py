"""Seam links: sets of places where rims meet that agree on one motion, and what follows for the cloth.

Each set fixes how a piece of the other side lies to one of this side. Two sets that fix it differently
contradict the cloth between them: some of it is joined falsely, as where two parts of a fold touch.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import expit, logit

from flatcloth.core.geometry import fit_rigid2, refit_rigid2
from flatcloth.core.graphs import cut_between
from flatcloth.core.types import MIRROR, Bool, Float64, Int16, Int32, Int64, Rigid2
from flatcloth.flattening.sampling import CORRELATED_M, LEAST_INTERVAL_M
from flatcloth.methods.answers import Ends
from flatcloth.methods.robust.seams.rims import Rim, meeting
from flatcloth.segmentation.settings import SURE
from flatcloth.shape.algorithm import as_decided
from flatcloth.shape.graph import z_of
from flatcloth.shape.joints import LEAST_PIECE, NEGLIGIBLE, DecidedParts, seen_often
from flatcloth.shape.shape import PIECES_APART_M, PLACE_STD_M, Shape

_LOG_ODDS = (1.17, 1.78, -1.51)
"""Logarithm of the odds that a set is true: a constant, for each e-fold of its strength, and for each of one
more than the true edges that it lays on the other sheet's cloth. Fitted, with the next, to true places of
nodes of 85 recordings; ``python -m benchmarks seams`` fits both to true places of pixels."""
_FALSE_LOG_ODDS = (-0.48, 0.71)
"""Logarithm of the odds, over 1 plus its evidence, that cloth between two true sets joins falsely: a
constant, and for the true edges against both sets that tearing it leaves out (benchmarks/seams.py)."""
_SURE_ODDS = logit(SURE)
_WELL_SEEN = 0.75
"""Trust of a true edge that counts: more than three views faced it. By definition of the trust; fewer may
have seen a fold's silhouette."""
_AGREE_M = LEAST_INTERVAL_M
"""Matches of one set fit its motion to this: four times their median residual."""
_CONTRADICTS = "it contradicts a stronger seam"
_TEARS = "it contradicts a stronger seam, and little evidence joins the cloth of this side between them"
_EDGES = "true edges would lie on cloth of the other sheet"
_FEW = "too few places meet"
_PLACELESS = "the cloth of the other side there was cut off and has no place"
MOST_DRIFT_M = 0.04
"""Sets that place a piece differently by more than this contradict each other; the drift of a layout is 5 to
15 mm. Set by hand."""
EdgesAgainst = tuple[Float64, Float64, Float64]
"""True edges of one sheet that a set lays on the other: places (E, 2) on both planes, their trust (E,)."""
_TRIES = 300
"""Motions tried for a set. Chosen: a set with a seventh of the matches is found in 99 of 100 cases."""
_SEED_M = (0.03, 0.2)
"""Distances of the two matches that give a motion to try. Chosen: nearer ones fix no angle, between farther
ones the cloth may be bent."""


def motion_onto(places_m: Float64, target_m: Float64) -> Rigid2:
    """Return the motion that fits most places (K, 2) of a seam to others (K, 2).

    Some places of a set belong to other rims: in a least-squares fit to thirty places, two more or fewer
    turned a piece by 1.6 degrees.
    """
    return refit_rigid2(fit_rigid2(places_m, target_m), places_m, target_m, PLACE_STD_M, 10)


@dataclass(frozen=True, kw_only=True)
class Matches:
    """Places where the rims of both sides meet.

    ``this_uv_m``, ``other_uv_m`` (K, 2) on the plane of this side and on the other's own plane; ``xyz_m``
    (K, 3) object frame; ``views`` (K, 2) the views that show the one and the other rim, ``pieces`` (K, 2) the
    pieces that they bound.
    """

    this_uv_m: Float64
    other_uv_m: Float64
    xyz_m: Float64
    views: Int16
    pieces: Int16

    def __len__(self) -> int:
        """Return the number of places."""
        return len(self.this_uv_m)

    def motion(self, members: Int64) -> Rigid2:
        """Return the motion from the mirrored plane of the other side on which some places agree."""
        return motion_onto(self.other_uv_m[members] * MIRROR, self.this_uv_m[members])

    def misfit_m(self, members: Int64, motion: Rigid2) -> Float64:
        """Return how far from their places on this side a motion brings those of the other."""
        off = motion.apply(self.other_uv_m[members] * MIRROR) - self.this_uv_m[members]
        misfit: Float64 = np.linalg.norm(off, axis=1)
        return misfit


@dataclass(frozen=True, kw_only=True)
class SeamLink:
    """A set of matches: ``members`` (K,) of all matches, between a piece of each side.

    ``strength`` is their number, weighted by the width of the strip that they cover: along a straight line
    other parts touch, too. ``probability`` that they are a seam. ``why`` says why it does not join them; it
    is empty if it does. ``is_kept``: the operator decided that it does.
    """

    this_piece: int
    other_piece: int
    members: Int64
    strength: float
    probability: float = 1.0
    why: str = ""
    is_kept: bool = False


@dataclass(frozen=True, kw_only=True)
class SideJoint:
    """Cloth of a ``side`` (0 this, 1 the other) that joins a ``part`` (N,) of the nodes of a ``piece``.

    ``evidence`` joins it; ``false`` is the probability that it does so falsely, ``is_false`` whether it is
    cut, as only cloth of the other side is. Cut there, fewer true edges speak against the sets at its ends:
    by ``relief`` e-folds.
    """

    side: int
    piece: int
    part: Bool
    evidence: float
    relief: float
    false: float
    is_false: bool = False


def matches_of(own: Rim, its: Rim) -> Matches:
    """Return where the rim of this side meets that of the other side."""
    a, b = meeting(own, its)
    return Matches(
        this_uv_m=own.uv_m[a],
        other_uv_m=its.uv_m[b],
        xyz_m=0.5 * (own.xyz_m[a] + its.xyz_m[b]),
        views=np.stack([own.view_index[a], its.view_index[b]], axis=1),
        pieces=np.stack([own.piece[a], its.piece[b]], axis=1),
    )


def linked(
    this: Shape,
    other: Shape,
    matches: Matches,
    sets: Sequence[SeamLink],
    ends: tuple[Sequence[Ends], Sequence[Ends]],
) -> tuple[Shape, Matches, list[SeamLink], list[SideJoint]]:
    """Decide which sets of matches join the sides; take the other side apart where they contradict it.

    Two true sets that place one piece of the other side differently on one piece of this side need cloth
    between them, of either side, that joins falsely: of all configurations the most probable one is taken
    (``configuration.py``). True edges of one sheet in the middle of the other's cloth speak against a set.
    This side is not taken apart here.

    Parameters
    ----------
    ends : two sequences of Ends
        Where the cloth of the pieces of both sides truly ends.
    sets : sequence of SeamLink
        Those of :func:`sets_of`; those that the operator cut have the reason.

    Returns
    -------
    Shape
        The other side, taken apart.
    Matches
        At their places on its new plane.
    list of SeamLink
        All sets, in the same order.
    list of SideJoint
        The cloth between sets that stays joined: on this side also where it is more probably false.
    """
    links, joints = list(sets), list[SideJoint]()
    at = node_at(this, matches.this_uv_m), node_at(other, matches.other_uv_m)
    found = [n for n, link in enumerate(links) if not link.why]
    for pieces in sorted({(links[n].this_piece, links[n].other_piece) for n in found}):
        own = [n for n in found if (links[n].this_piece, links[n].other_piece) == pieces]
        decided, between = _decided((this, other), at, matches, [links[n] for n in own], ends)
        joints += between
        for n, link in zip(own, decided, strict=True):
            links[n] = link
    side = np.zeros(len(other.nodes), dtype=np.int64)  # the part of each node
    for joint in joints:
        if joint.is_false:
            part = joint.part & (other.piece == joint.piece)
            side = np.unique(2 * side + part, return_inverse=True)[1].ravel()
    parted, matches = _taken_apart(other, side, matches, at[1])
    kept = [joint for joint in joints if not joint.is_false]
    return parted, matches, [_renumbered(link, parted.piece[at[1]]) for link in links], kept


def _decided(
    shapes: tuple[Shape, Shape],
    at: tuple[Int64, Int64],
    matches: Matches,
    links: Sequence[SeamLink],
    ends: tuple[Sequence[Ends], Sequence[Ends]],
) -> tuple[list[SeamLink], list[SideJoint]]:
    """Return the sets between two pieces as they are true or not, and the joints between those that are."""
    edges = [edges_against(matches, link, ends) for link in links]
    judged = [_log_odds(*each) for each in zip(links, edges, strict=True)]
    between = {
        (n, k): [
            joint_between(side, shapes[side], at[side], (links[n], links[k]), (edges[n], edges[k]))
            for side in (0, 1)
        ]
        for n, k in combinations(range(len(links)), 2)
        if not agree(matches, links[n], links[k])
    }
    false = {pair: 1.0 - math.prod(1.0 - each.false for each in both) for pair, both in between.items()}
    found = configured([odds for _, odds in judged], false)
    decided, joints = list(links), list[SideJoint]()
    for n, (alone, odds) in enumerate(judged):
        why = _CONTRADICTS if odds > _SURE_ODDS else _EDGES if alone > _SURE_ODDS else _FEW
        why = "" if found.true[n] else why
        decided[n] = replace(links[n], why=why, probability=float(found.probability[n]))
    for pair, both in between.items():
        worst = max(both, key=lambda each: each.false)
        for each in both:
            chance = min(1.0, each.false * found.false[pair] / max(false[pair], 1e-300))
            is_false = each is worst and each.side == 1 and pair in found.needs
            if chance > 0.5 * NEGLIGIBLE:
                joints.append(replace(each, false=chance, is_false=is_false))
        if worst.side == 0 and pair in found.needs:
            decided[pair[1]] = replace(decided[pair[1]], why=_TEARS)
    return decided, joints


def _log_odds(link: SeamLink, edges: EdgesAgainst) -> tuple[float, float]:
    """Return the logarithm of the odds that a set is true: by its strength, and by true edges against it."""
    if link.is_kept:
        return (-math.log(np.finfo(np.float64).eps),) * 2
    alone = _LOG_ODDS[0] + _LOG_ODDS[1] * math.log(link.strength)
    return alone, alone + _LOG_ODDS[2] * math.log1p(edges[2].sum())


def joint_between(
    side: int,
    shape: Shape,
    node: Int64,
    links: tuple[SeamLink, SeamLink],
    edges: tuple[EdgesAgainst, EdgesAgainst],
) -> SideJoint:
    """Return the weakest joint of a side between two sets of a piece; its part has the nodes of the first.

    Few views see a false pair, so cloth is cut where little is often seen; ``node`` (K,) is that of each
    match. If the joint is false, each set lays the other sheet on its own part only, so that of the ``edges``
    against a set only those on its part count. Where it would leave less than ``LEAST_PIECE`` nodes on a side
    there is none: it is never false.
    """
    ends = node[links[0].members], node[links[1].members]
    here, there = (np.setdiff1d(each, np.intersect1d(*ends)) for each in ends)
    piece = (links[0].this_piece, links[0].other_piece)[side]
    own, total, relief = shape.piece == piece, np.inf, 0.0
    part = np.zeros(len(own), dtype=np.bool_)
    if here.size and there.size:
        pairs, evidence = shape.graph.pairs[shape.holds], shape.graph.evidence[shape.holds]
        often = seen_often(evidence, shape.graph.views[shape.holds])
        part = cut_between(len(own), pairs, often, here, there)
        if min((own & part).sum(), (own & ~part).sum()) >= LEAST_PIECE:
            total = float(evidence[part[pairs[:, 0]] != part[pairs[:, 1]]].sum())
            for against, is_first in zip(edges, (True, False), strict=True):
                counts = part[node_at(shape, against[side])] == is_first
                relief += math.log1p(against[2].sum()) - math.log1p(against[2][counts].sum())
    false = float(expit(_FALSE_LOG_ODDS[0] + _FALSE_LOG_ODDS[1] * relief - math.log1p(total)))
    return SideJoint(side=side, piece=piece, part=part, evidence=total, relief=relief, false=false)


def edges_against(
    matches: Matches, link: SeamLink, ends: tuple[Sequence[Ends], Sequence[Ends]]
) -> EdgesAgainst:
    """Return the true edges that a set lays on the other sheet's cloth.

    Both sheets end at the same seams and hems, necklines apart.
    """
    own, its = (ends[side][int(np.bincount(matches.pieces[link.members, side]).argmax())] for side in (0, 1))
    motion = matches.motion(link.members)
    at_other, at_this = motion.inverse().apply(own.edge_uv_m) * MIRROR, motion.apply(its.edge_uv_m * MIRROR)
    trust = np.concatenate([own.edge_trust, its.edge_trust])
    depth_m = np.concatenate([its.depth_at(at_other), own.depth_at(at_this)])
    counts = (trust > _WELL_SEEN) & (depth_m > MOST_DRIFT_M)
    this, other = np.concatenate([own.edge_uv_m, at_this]), np.concatenate([at_other, its.edge_uv_m])
    return this[counts], other[counts], trust[counts]


def _renumbered(link: SeamLink, piece: Int32) -> SeamLink:
    """Return a set with the piece of most of its places, and only those; ``piece`` (K,) are the present ones.

    Where their cloth has no place any more (-1), the set joins nothing.
    """
    own = int(np.bincount(piece[link.members] + 1).argmax()) - 1
    members = link.members[piece[link.members] == own]
    return replace(link, other_piece=own, members=members, why=link.why or ("" if own >= 0 else _PLACELESS))


def sets_of(this: Shape, other: Shape, matches: Matches) -> list[SeamLink]:
    """Return the sets of matches that agree on one motion, for each pair of pieces; the strongest first.

    Of two pieces there are at most ``MOST_SETS``, the largest.
    """
    at = node_at(this, matches.this_uv_m), node_at(other, matches.other_uv_m)
    ends = np.stack([this.piece[at[0]], other.piece[at[1]]], axis=1).astype(np.int64)
    links = []
    for this_piece, other_piece in np.unique(ends, axis=0).tolist():
        rest = np.flatnonzero((ends == (this_piece, other_piece)).all(axis=1))
        for _ in range(MOST_SETS):
            members = _largest_set(matches, rest)
            if not members.size:
                break
            across_m2 = max(float(np.linalg.eigvalsh(np.cov(matches.this_uv_m[members].T))[0]), 0.0)
            strength = members.size * max(float(np.sqrt(across_m2)), PLACE_STD_M) / _AGREE_M
            links.append(
                SeamLink(this_piece=this_piece, other_piece=other_piece, members=members, strength=strength)
            )
            rest = np.setdiff1d(rest, members)
    return sorted(links, key=lambda link: -link.strength)


def _largest_set(matches: Matches, among: Int64) -> Int64:
    """Return the largest set of matches found that one motion fits (RANSAC; Fischler and Bolles, 1981)."""
    none = among[:0]
    if not among.size:
        return none
    u, w = z_of(matches.this_uv_m[among]), z_of(matches.other_uv_m[among] * MIRROR)
    a, b = np.random.default_rng(0).integers(0, among.size, (2, _TRIES))
    here, there = u[b] - u[a], w[b] - w[a]
    good = (np.abs(here) > _SEED_M[0]) & (np.abs(here) < _SEED_M[1])
    good &= np.abs(np.abs(here) - np.abs(there)) < _AGREE_M
    if not good.any():
        return none
    a, turn = a[good], (here * np.conj(there))[good]
    turn /= np.abs(turn)
    moved = turn[:, None] * (w[None] - w[a][:, None]) + u[a][:, None]
    fits = np.abs(moved - u[None]) < _AGREE_M
    members = among[fits[fits.sum(axis=1).argmax()]]
    for _ in range(5):
        if members.size < 3:
            return none
        whole = fit_rigid2(matches.other_uv_m[members] * MIRROR, matches.this_uv_m[members])
        members = among[matches.misfit_m(among, whole) < _AGREE_M]
    return members if members.size >= LEAST_PIECE else none


def agree(matches: Matches, one: SeamLink, other: SeamLink) -> bool:
    """Return whether two sets of the same piece of the other side place it alike."""
    if one.this_piece != other.this_piece:
        return False
    off_m = min(
        float(np.median(matches.misfit_m(a.members, matches.motion(b.members))))
        for a, b in ((one, other), (other, one))
    )
    return off_m <= MOST_DRIFT_M


def _taken_apart(shape: Shape, side: Int64, matches: Matches, node: Int64) -> tuple[Shape, Matches]:
    """Return the other side as parts, numbered by ``side`` (N,), and the matches at their new places.

    ``node`` (K,) is the node of each match.
    """
    if not side.any():
        return shape, matches
    code = np.where(shape.piece >= 0, side * (int(shape.piece.max()) + 1) + shape.piece, -1)
    parts = [part for number in np.unique(code[code >= 0]) if (part := code == number).sum() >= LEAST_PIECE]
    laid = as_decided(shape, DecidedParts(parts), shape.views[0])
    piece, uv_m = np.full_like(shape.piece, -1), shape.all_uv_m.copy()
    for number, part in enumerate(parts):
        is_divided = part.sum() < (shape.piece == shape.piece[part][0]).sum()
        found = part & laid.has_place & (laid.piece >= 0)
        if is_divided and found.sum() > 0.5 * part.sum():
            piece[found], uv_m[part] = number, laid.all_uv_m[part]
        else:  # it lies as it did
            piece[part] = number
        uv_m[piece == number] += (
            PIECES_APART_M
            * (number - np.rint(uv_m[piece == number].mean(axis=0) / PIECES_APART_M))
            * (1.0, 0.0)
        )
    parted = replace(laid, piece=piece, all_uv_m=np.where((piece >= 0)[:, None], uv_m, np.nan))
    kept = np.flatnonzero(shape.has_place & parted.has_place)
    tree = cKDTree(shape.all_uv_m[kept])
    uv = np.full_like(matches.other_uv_m, np.nan)
    for k, around in enumerate(tree.query_ball_point(matches.other_uv_m, CORRELATED_M)):
        near = kept[around]
        near = near[code[near] == code[node[k]]]
        if near.size > 2:
            motion = fit_rigid2(shape.all_uv_m[near], parted.all_uv_m[near])
            uv[k] = motion.apply(matches.other_uv_m[k])
    return parted, replace(matches, other_uv_m=uv)


def node_at(shape: Shape, uv_m: Float64) -> Int64:
    """Return the node (K,) of a shape nearest to each place (K, 2) of its plane."""
    placed = np.flatnonzero(shape.has_place)
    nearest: Int64 = placed[cKDTree(shape.all_uv_m[placed]).query(uv_m)[1]]
    return nearest


# --- configurations of sets ------------------------------------------------------------------------

# A configuration says which sets of a pair of pieces are true. Two true sets that place the pieces
# differently need cloth between them that joins falsely. The logarithm of its probability, up to a constant,
# is the sum of the log odds of the true sets and of those of the false joints that they need. There are few
# sets, so all configurations are looked at.


MOST_SETS = 12
"""Sets whose configurations are all looked at, the strongest. Chosen: 4,096 of them."""


@dataclass(frozen=True, kw_only=True)
class Configuration:
    """The most probable configuration, ``true`` (K,), and what all of them say.

    ``all_true`` (2^K, K) are all of them, ``chance`` (2^K,) their probabilities; ``probability`` (K,) that
    each set is true. ``needs`` the pairs of true sets that need a false joint in the most probable one,
    ``false`` the probability that they do, for each pair.
    """

    true: Bool
    all_true: Bool
    chance: Float64
    probability: Float64
    needs: frozenset[tuple[int, int]]
    false: Mapping[tuple[int, int], float]


def configured(log_odds: Sequence[float], false: Mapping[tuple[int, int], float]) -> Configuration:
    """Return what all configurations of the sets of a pair of pieces say.

    Parameters
    ----------
    log_odds : K numbers
        Logarithm of the odds that each set is true, by itself; the surest first, at most ``MOST_SETS``.
    false : mapping
        For each two sets (n, k), n < k, that place the pieces differently: the probability that the cloth
        between them, of either side, joins falsely.
    """
    count = len(log_odds)
    true = (np.arange(2**count)[:, None] >> np.arange(count)) & 1 > 0
    weight = true @ np.asarray(log_odds, dtype=np.float64)
    needs: dict[tuple[int, int], Bool] = {}
    for k in range(count):
        # A true set needs one joint to be false, the most doubtful one; none if it agrees with a true one.
        against = sorted((n for n in range(k) if (n, k) in false), key=lambda n: -false[n, k])
        alone = true[:, k] & ~true[:, [n for n in range(k) if (n, k) not in false]].any(axis=1)
        for n in against:
            needs[n, k] = alone & true[:, n]
            alone = alone & ~true[:, n]
            weight[needs[n, k]] += np.log(max(false[n, k], 1e-300)) - np.log1p(-false[n, k])
    chance = np.exp(weight - weight.max())
    chance /= chance.sum()
    best = int(weight.argmax())
    return Configuration(
        true=true[best],
        all_true=true,
        chance=chance,
        probability=chance @ true,
        needs=frozenset(pair for pair, needed in needs.items() if needed[best]),
        false={pair: float(chance @ needed) for pair, needed in needs.items()},
    )
