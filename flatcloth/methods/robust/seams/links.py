"""Seam links: sets of places where rims meet that agree on one motion, and what follows for the cloth.

Each set fixes how a piece of the other side lies to one of this side. Two sets that fix it differently
contradict the cloth between them: some of it is joined falsely, as where two parts of a fold touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.geometry import fit_rigid2, refit_rigid2
from flatcloth.core.graphs import cut_between
from flatcloth.core.types import MIRROR, Bool, FlattenedView, Float64, Int16, Int32, Int64, Rigid2
from flatcloth.flattening.sampling import CORRELATED_M, LEAST_INTERVAL_M
from flatcloth.methods.answers import Ends
from flatcloth.methods.robust.seams.rims import meeting, rim_of
from flatcloth.shape.algorithm import apart
from flatcloth.shape.graph import z_of
from flatcloth.shape.joints import false_share, seen_often
from flatcloth.shape.pieces import LEAST_PIECE
from flatcloth.shape.shape import PIECES_APART_M, PLACE_STD_M, Shape

LEAST_MATCHES = 28
"""Fewest matches of a set that joins pieces, or fewer if they cover as much as that on a strip as wide as
``_AGREE_M``. Measured by ``python -m benchmarks seams``: where the strongest set of a piece is false and lays
no true edges on the other sheet, it has up to 27."""
_DOUBTED_EVIDENCE = 120.0
"""Cloth of the other side that alone joins two pieces of this side is not believed with less evidence.
Measured by the same command: such joints with up to 70 are false, with 210 and more true."""
_BENT = 0.3
"""Cloth is cut between two sets that contradict each other if its evidence is less than this for each match
of the weaker one, weighted by its width; otherwise the weaker set is false. Measured by the same command:
where the cloth is bent it is up to 0.2, where the set is false 0.4 and more."""
_FALSE_SETS = 1 / 177
"""Probability that a set that joins is false. Measured by the same command: of 176 none was (Laplace)."""
_MOST_CONTRADICTED = _BENT
"""A set is contradicted if, for each of its places, more true edges than this would lie on the other sheet's
cloth. Measured by the same command: of the strongest sets that join, true ones have up to 0.06, but one 0.40;
false ones 0.46 and 0.78."""
_WELL_SEEN = 0.75
"""Trust of a true edge that counts: more than three views faced it. By definition of the trust; fewer may
have seen a fold's silhouette."""
_AGREE_M = LEAST_INTERVAL_M
"""Matches of one set fit its motion to this: four times their median residual."""
_CONTRADICTS = "it contradicts a stronger seam"
_TEARS = "it contradicts a stronger seam, and little evidence joins the cloth of this side between them"
_PLACELESS = "the cloth of the other side there was cut off and has no place"
MOST_DRIFT_M = 0.04
"""Sets that place a piece differently by more than this contradict each other; the drift of a layout is 5 to
15 mm. Set by hand."""
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
    other parts touch, too. ``why`` says why it does not join them; it is empty if it does. ``is_kept``: the
    operator or the garment decided that it does. ``is_bridge``: cloth of the other side led from it to a set
    of another piece of this side, and was cut because its evidence is small; or, if no cloth was cut, one of
    the sets is too straight to join its piece. ``tears`` (N,) are the nodes of this side that are joined
    falsely, if the set is true.
    """

    this_piece: int
    other_piece: int
    members: Int64
    strength: float
    why: str = ""
    is_kept: bool = False
    is_bridge: bool = False
    tears: Bool | None = None

    @property
    def joins(self) -> bool:
        """Whether the set is large enough to join its pieces by itself, or the operator kept it."""
        return self.is_kept or max(len(self.members), self.strength) >= LEAST_MATCHES


def matches_of(this: Sequence[FlattenedView], other: Sequence[FlattenedView]) -> Matches:
    """Return where the pieces of this side meet those of the other side."""
    own, its = rim_of(this), rim_of(other)
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
) -> tuple[Shape, Matches, list[SeamLink]]:
    """Decide which sets of matches join the sides; take the other side apart where they contradict it.

    Two sets that place one piece of the other side differently on one piece of this side contradict each
    other: either the weaker is contact of other parts, or the cloth between them is bent or joined falsely,
    on the side where it has less evidence. This side is not taken apart here.
    Cloth of the other side that alone would join two pieces of this side must be strong to be believed,
    unless both sets are kept.
    Where the strongest set of a piece lays true edges on the middle of the other sheet's cloth, either the
    set is false, or the cloth between the set and these edges is joined falsely.
    ``ends`` are where the cloth of the pieces of both sides truly ends. ``sets`` are those of
    :func:`sets_of`; those that the operator cut have the reason.

    Returns
    -------
    Shape
        The other side, taken apart.
    Matches
        At their places on its new plane.
    list of SeamLink
        All sets, in the same order.
    """
    links, at_other = list(sets), node_at(other, matches.other_uv_m)
    at_this = node_at(this, matches.this_uv_m)
    side = np.zeros(len(other.nodes), dtype=np.int64)  # the part of each node
    bridges, straight = set[int](), set[int]()

    def part_of(link: SeamLink) -> int:
        """Return the part of most of the places of a set."""
        return int(np.bincount(side[at_other[link.members]]).argmax())

    for n, link in enumerate(links):
        if link.why:
            continue
        earlier = [k for k in range(n) if not links[k].why and links[k].other_piece == link.other_piece]
        earlier = [k for k in earlier if part_of(links[k]) == part_of(link)]
        against = [k for k in earlier if not agree(matches, links[k], link)]
        tears = _torn_between(this, other, (at_this, at_other), [links[k] for k in against], link)
        if tears is not None:
            links[n] = replace(link, why=_TEARS, tears=tears)
            continue
        if not link.joins:
            if len(against) == len(earlier):
                links[n] = replace(link, why="too few places meet")
            continue
        if not earlier and not link.is_kept:
            is_false, part = _judged_by_edges(other, matches, link, ends, at_other, side == part_of(link))
            if is_false:
                links[n] = replace(link, why="true edges would lie on cloth of the other sheet")
                continue
            side = side if part is None else _divided(side, part & (other.piece == link.other_piece))
        if against and not link.is_kept and link.strength < LEAST_MATCHES:
            links[n] = replace(link, why=_CONTRADICTS)
            if all(links[k].this_piece != link.this_piece for k in against):
                straight |= {n, *against}
            continue
        for k in against:
            before = links[k]
            part, evidence = evidence_between(other, *(at_other[each.members] for each in (before, link)))
            is_bridge = before.this_piece != link.this_piece
            if is_bridge and before.is_kept and link.is_kept:
                continue
            if evidence < (_DOUBTED_EVIDENCE if is_bridge else _BENT * link.strength):
                side = _divided(side, part & (other.piece == link.other_piece))
                bridges |= {k, n} if is_bridge else set()
            elif not is_bridge and not link.is_kept:
                links[n] = replace(link, why=_CONTRADICTS)
                break
    parted, matches = _taken_apart(other, side, matches, at_other)
    links = [replace(link, is_bridge=n in (bridges or straight)) for n, link in enumerate(links)]
    return parted, matches, [_renumbered(link, parted.piece[at_other]) for link in links]


def _divided(side: Int64, part: Bool) -> Int64:
    """Return the part of each node (N,) once ``part`` (N,) is cut from the rest."""
    return np.unique(2 * side + part, return_inverse=True)[1].ravel()


def _judged_by_edges(
    other: Shape,
    matches: Matches,
    link: SeamLink,
    ends: tuple[Sequence[Ends], Sequence[Ends]],
    at_other: Int64,
    in_part: Bool,
) -> tuple[bool, Bool | None]:
    """Return whether true edges on the other sheet show that a set is false, or else the part (N,) to cut.

    ``in_part`` (N,) are the nodes of the part of the other side that the set joins.
    """
    trust, places = contradicting(matches, link, ends)
    there = node_at(other, places)
    own = in_part[there]
    against_it = float(trust[own].sum())
    if against_it <= _MOST_CONTRADICTED * len(link.members):
        return False, None
    part, evidence = evidence_between(other, at_other[link.members], there[own])
    return evidence >= _BENT * min(against_it, link.strength), part


def _torn_between(
    this: Shape,
    other: Shape,
    node_of_match: tuple[Int64, Int64],
    against: Sequence[SeamLink],
    link: SeamLink,
) -> Bool | None:
    """Return the part (N,) of this side that is joined falsely if both a set and one ``against`` it are true.

    Of the two parts that the cloth between the sets joins, it is the smaller one. None if that cloth has
    enough evidence, or the other side's cloth between the sets has less.
    """
    for before in against:
        if link.is_kept or before.this_piece != link.this_piece:
            continue
        (side, evidence), (_, its) = (
            evidence_between(shape, at[before.members], at[link.members])
            for shape, at in zip((this, other), node_of_match, strict=True)
        )
        pairs = this.graph.pairs
        crosses = side[pairs[:, 0]] != side[pairs[:, 1]]
        doubt = false_share(seen_often(this.graph, this.holds)[crosses].sum())
        if evidence < _BENT * link.strength and evidence < its < np.inf and doubt > _FALSE_SETS:
            parts: list[Bool] = [(this.piece == link.this_piece) & part for part in (side, ~side)]
            return min(parts, key=np.count_nonzero)
    return None


def contradicting(
    matches: Matches, link: SeamLink, ends: tuple[Sequence[Ends], Sequence[Ends]]
) -> tuple[Float64, Float64]:
    """Return the trust (K,) of true edges that a set lays on the other sheet's cloth, and their places.

    Both sheets end at the same seams and hems, necklines apart. Places (K, 2) are on the other side's plane.
    """
    pieces = [int(np.bincount(matches.pieces[link.members, side]).argmax()) for side in (0, 1)]
    own, its = ends[0][pieces[0]], ends[1][pieces[1]]
    motion = matches.motion(link.members)
    at_other = motion.inverse().apply(own.edge_uv_m) * MIRROR
    at_this = motion.apply(its.edge_uv_m * MIRROR)
    uv_m = np.concatenate([at_other, its.edge_uv_m])
    trust = np.concatenate([own.edge_trust, its.edge_trust])
    depth_m = np.concatenate([its.depth_at(at_other), own.depth_at(at_this)])
    against = (trust > _WELL_SEEN) & (depth_m > MOST_DRIFT_M)
    return trust[against], uv_m[against]


def _renumbered(link: SeamLink, piece: Int32) -> SeamLink:
    """Return a set with the piece of most of its places, and only those; ``piece`` (K,) are the present ones.

    Where their cloth has no place any more (-1), the set joins nothing.
    """
    own = int(np.bincount(piece[link.members] + 1).argmax()) - 1
    members = link.members[piece[link.members] == own]
    return replace(link, other_piece=own, members=members, why=link.why or ("" if own >= 0 else _PLACELESS))


def sets_of(this: Shape, other: Shape, matches: Matches) -> list[SeamLink]:
    """Return the sets of matches that agree on one motion, for each pair of pieces; the strongest first."""
    at = node_at(this, matches.this_uv_m), node_at(other, matches.other_uv_m)
    ends = np.stack([this.piece[at[0]], other.piece[at[1]]], axis=1).astype(np.int64)
    links = []
    for this_piece, other_piece in np.unique(ends, axis=0).tolist():
        rest = np.flatnonzero((ends == (this_piece, other_piece)).all(axis=1))
        while (members := _largest_set(matches, rest)).size:
            strength = members.size * _width_m(matches.this_uv_m[members]) / _AGREE_M
            links.append(
                SeamLink(this_piece=this_piece, other_piece=other_piece, members=members, strength=strength)
            )
            rest = np.setdiff1d(rest, members)
    return sorted(links, key=lambda link: -link.strength)


def _width_m(uv_m: Float64) -> float:
    """Return the standard deviation of places (K, 2) across the line through them, at least a residual's."""
    across = float(np.linalg.eigvalsh(np.cov(uv_m.T))[0])
    return max(float(np.sqrt(max(across, 0.0))), PLACE_STD_M)


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


def evidence_between(shape: Shape, one: Int64, other: Int64) -> tuple[Bool, float]:
    """Return which nodes (N,) the weakest cut between some nodes and ``other`` ones leaves with the first.

    The second is the evidence that the cut takes away, infinite if nothing lies between them.
    """
    both = np.intersect1d(one, other)
    one, other = np.setdiff1d(one, both), np.setdiff1d(other, both)
    if not (one.size and other.size):
        return np.zeros(len(shape.nodes), dtype=np.bool_), np.inf
    edges, evidence = shape.links.edges, shape.evidence
    side = cut_between(len(shape.nodes), edges, evidence, one, other)
    return side, float(evidence[side[edges[:, 0]] != side[edges[:, 1]]].sum())


def _taken_apart(shape: Shape, side: Int64, matches: Matches, node: Int64) -> tuple[Shape, Matches]:
    """Return the other side as parts, numbered by ``side`` (N,), and the matches at their new places.

    ``node`` (K,) is the node of each match.
    """
    if not side.any():
        return shape, matches
    code = np.where(shape.piece >= 0, side * (int(shape.piece.max()) + 1) + shape.piece, -1)
    parts = [part for number in np.unique(code[code >= 0]) if (part := code == number).sum() >= LEAST_PIECE]
    laid = apart(shape, parts, shape.views[0])
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
