"""Application of decisions to a recognised garment: kind, held points, placed pieces, parts taken off.

The plane of the shape may change when views are added. So a place is kept with points of the cloth near
it, and found again by where these points lie then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.geometry import fit_rigid2, refit_rigid2
from flatcloth.core.graphs import cut_between
from flatcloth.core.types import Bool, FlattenedView, Float64, Floats, LaidPiece, Rigid2
from flatcloth.flattening.cloth import Cloth
from flatcloth.garments.evidence import PieceEvidence
from flatcloth.garments.fit import APART_M, HELD_STD_M, Pull, surest
from flatcloth.garments.named_points import KNOWN_STD_M, POINT_NEAR_M, dimensions_of, pixel_near, points_of
from flatcloth.garments.placing import place_pieces
from flatcloth.garments.recognition import NONE, Recognition, held_fit
from flatcloth.session.garment import ClothPlaces, DecidedPart, GarmentDecisions, HeldPoint, PlacedPiece
from flatcloth.shape.joints import DecidedParts

_LEAST_FOUND = 0.5  # by definition: most of the points of a decision, or its cloth is gone


@dataclass(frozen=True, kw_only=True)
class DecidedPieces:
    """Decisions about floating pieces, by their index: where those placed lie, and which were refused.

    ``std_m`` are the standard deviations of the places; ``by_hand`` the pieces that the operator placed, or
    cut off the shape.
    """

    shape_from_piece: dict[int, Rigid2]
    refused: frozenset[int]
    std_m: dict[int, float] = field(default_factory=dict)
    by_hand: frozenset[int] = frozenset()

    def with_laid(self, laid: Sequence[LaidPiece]) -> DecidedPieces:
        """Return these with the pieces that seams lay, each where it is known better."""
        surer = [each for each in laid if each.std_m < self.std_m.get(each.index, np.inf)]
        return replace(
            self,
            shape_from_piece=self.shape_from_piece | {each.index: each.shape_from_piece for each in surer},
            std_m=self.std_m | {each.index: each.std_m for each in surer},
            by_hand=self.by_hand - {each.index for each in surer},
        )


def decided(
    found: Recognition,
    evidence: Sequence[PieceEvidence],
    shape: FlattenedView,
    kind: str | None,
    pulls: Sequence[Pull] = (),
    *,
    with_pieces: bool = True,
) -> Recognition:
    """Return a recognition as an operator's decisions change it.

    Parameters
    ----------
    found : Recognition
        The recognition by the evidence alone.
    evidence : sequence of PieceEvidence
        What it was found from, the canonical view first.
    shape : FlattenedView
        The canonical view.
    kind : str or None
        The kind set by hand, also ``NONE``: it is another item.
    pulls : sequence of Pull
        Named points held by hand; those that the kind does not have are left out.
    with_pieces : bool
        Whether floating pieces are placed again on the changed outline: takes a second.
    """
    known = {fit.kind.name: fit for fit in found.fits}
    by_hand = kind if kind in {*known, NONE} else None
    fit = known.get(kind or "", found.fit)
    names = set(fit.kind.named(fit.parameters[:, None]))
    own = tuple(pull for pull in pulls if pull.name in names)
    if fit is found.fit and not own:
        share = found.probabilities[fit.kind.name] if by_hand == fit.kind.name else 1.0  # now it is sure
        pieces = tuple(replace(piece, probability=piece.probability / share) for piece in found.pieces)
        return replace(found, by_hand=by_hand, pieces=pieces)
    if own:
        fit = held_fit(fit, evidence[0], own)
    points = points_of(fit, shape, evidence[0], {pull.name: (pull.uv_m, HELD_STD_M) for pull in own})
    pieces = tuple(place_pieces(fit, evidence)) if with_pieces else found.pieces
    return replace(
        found,
        fits=(fit, *(each for each in found.fits if each.kind.name != fit.kind.name)),
        dimensions=dimensions_of(fit, points),
        points=points,
        pieces=pieces,
        by_hand=by_hand,
        held=frozenset(pull.name for pull in own),
    )


def with_placed_cloth(
    found: Recognition, pieces: DecidedPieces, floating: Sequence[FlattenedView]
) -> Recognition:
    """Return a recognition whose named points are seen on placed pieces too."""
    points = dict(found.points)
    for name, point in found.points.items():
        for index, motion in pieces.shape_from_piece.items():
            pixel = pixel_near(motion.inverse().apply(point.uv_m), floating[index])
            if points[name].pixel is None and pixel is not None and point.std_m <= KNOWN_STD_M:
                points[name] = replace(point, pixel=pixel, piece=index)
    return replace(found, points=points)


def held_point(name: str, uv_m: Float64, shape: FlattenedView) -> HeldPoint:
    """Return a place of the plane tied to the cloth nearest to it."""
    places = shape.uv_from_rc(np.argwhere(shape.valid))
    off = np.linalg.norm(places - uv_m, axis=1)
    # Cloth a little farther off, too: the decision outlives the loss of a view.
    near = off <= off.min() + APART_M
    u_m, v_m = (float(x) for x in uv_m)
    return HeldPoint(name, (u_m, v_m), _tied(shape.xyz_m[shape.valid][near], places[near]))


def pulls_of(decisions: GarmentDecisions, shape: FlattenedView) -> tuple[Pull, ...]:
    """Return the held points where they lie on a shape now; those whose cloth is gone are left out."""
    pulls = []
    for held in decisions.held:
        moved = _now_from_then(held.cloth, shape)
        if moved is not None:
            pulls.append(Pull(name=held.name, uv_m=moved.apply(np.array(held.uv_m))))
    return tuple(pulls)


def placed_piece(
    piece: FlattenedView,
    shape: FlattenedView,
    shape_from_piece: Rigid2,
    probability: float,
    std_m: float,
    *,
    accepted: bool,
) -> PlacedPiece:
    """Return a decision about a floating piece, tied to its cloth and to that of the shape."""
    own = _cloth_of(piece)
    laid = shape_from_piece.apply(np.array(own.uv_m))
    return PlacedPiece(
        accepted=accepted,
        piece=replace(own, uv_m=tuple((float(u), float(v)) for u, v in laid)),
        shape=_cloth_of(shape),
        probability=float(probability),
        std_m=float(std_m),
    )


def decided_pieces(
    decisions: GarmentDecisions, shape: FlattenedView, floating: Sequence[FlattenedView]
) -> DecidedPieces:
    """Return what was decided about the pieces that float now; the last decision about a piece counts."""
    motions: dict[int, Rigid2] = {}
    std_m: dict[int, float] = {}
    refused: set[int] = set()
    is_any = decisions.pieces or decisions.parts
    trees = [cKDTree(piece.xyz_m[piece.valid]) for piece in floating] if is_any else []

    def index_of(cloth: ClothPlaces) -> int:
        points = np.array(cloth.points_m)
        shares = [float((tree.query(points)[0] <= POINT_NEAR_M).mean()) for tree in trees]
        return int(np.argmax(shares)) if max(shares, default=0.0) >= _LEAST_FOUND else -1

    by_hand = {index_of(each.part) for each in decisions.parts if each.taken_off}
    for decision in decisions.pieces:
        index = index_of(decision.piece)
        if index < 0:
            continue  # seen views join it to the shape by now
        moved = _now_from_then(decision.shape, shape)
        own = _now_from_then(decision.piece, floating[index])
        motions.pop(index, None)
        refused.discard(index)
        if not decision.accepted:
            refused.add(index)
        elif moved is not None and own is not None:
            motions[index] = moved @ own.inverse()
            std_m[index] = decision.std_m or KNOWN_STD_M
            (by_hand.add if decision.by_hand else by_hand.discard)(index)
    return DecidedPieces(
        shape_from_piece=motions, refused=frozenset(refused), std_m=std_m, by_hand=frozenset(by_hand)
    )


def _cloth_of(view: FlattenedView) -> ClothPlaces:
    return _tied(view.xyz_m[view.valid], view.uv_from_rc(np.argwhere(view.valid)))


def _tied(xyz_m: Floats, uv_m: Float64) -> ClothPlaces:
    """Return some of the places (N, 2) of the plane with their points (N, 3) in space."""
    chosen = surest(np.zeros(len(xyz_m)))
    return ClothPlaces(
        points_m=tuple((float(x), float(y), float(z)) for x, y, z in xyz_m[chosen]),
        uv_m=tuple((float(u), float(v)) for u, v in uv_m[chosen]),
    )


def _now_from_then(cloth: ClothPlaces, view: FlattenedView) -> Rigid2 | None:
    """Return the motion of the plane since places were tied to cloth, None if the cloth is gone."""
    pixels = np.argwhere(view.valid)
    if len(pixels) < 3:
        return None
    off, nearest = cKDTree(view.xyz_m[view.valid]).query(np.array(cloth.points_m))
    kept = off <= POINT_NEAR_M
    if kept.sum() < 3:
        return None
    then, now = np.array(cloth.uv_m)[kept], view.uv_from_rc(pixels[nearest[kept]])
    return refit_rigid2(fit_rigid2(then, now), then, now, POINT_NEAR_M, 10)


def decided_part(cloth: Cloth, part: Bool, probability: float, *, taken_off: bool) -> DecidedPart:
    """Return the decision that a part (N,) is taken off or kept, by points of its cloth and of the rest."""
    rest = cloth.placed & ~part
    return DecidedPart(
        taken_off=taken_off,
        part=_tied(cloth.xyz_m[part], cloth.uv_m[part]),
        rest=_tied(cloth.xyz_m[rest], cloth.uv_m[rest]),
        probability=float(probability),
    )


def placed_by_hand(taken_off: DecidedPart, shape_from_part: Rigid2) -> PlacedPiece:
    """Return the decision that a part that is taken off lies elsewhere on the shape, moved by so much."""
    laid = shape_from_part.apply(np.array(taken_off.part.uv_m)).tolist()
    there = replace(taken_off.part, uv_m=tuple((u, v) for u, v in laid))
    return PlacedPiece(accepted=True, piece=there, shape=taken_off.rest, probability=1.0, by_hand=True)


def found_again(cloth: Cloth, decision: DecidedPart) -> Bool | None:
    """Return the samples (N,) of a decided part on a shape as it is now; None if it is not on it."""
    placed = np.flatnonzero(cloth.placed)
    tree = cKDTree(cloth.xyz_m[placed])
    ends = []
    for tied in (decision.part, decision.rest):
        off, nearest = tree.query(np.array(tied.points_m))
        if (off <= POINT_NEAR_M).mean() < _LEAST_FOUND:
            return None
        ends.append(placed[nearest[off <= POINT_NEAR_M]])
    own, others = np.setdiff1d(ends[0], ends[1]), np.setdiff1d(ends[1], ends[0])
    if not (own.size and others.size):
        return None
    joined = cloth.joined  # the cut with the least evidence between both
    return (
        cut_between(len(cloth.uv_m), cloth.edges[joined], cloth.evidence[joined], own, others) & cloth.placed
    )


def decided_parts(pieces: Sequence[Cloth], decisions: Sequence[DecidedPart]) -> DecidedParts:
    """Return the parts that were taken off pieces, or kept on them; of a part, the last decision counts."""
    last = [each for cloth in pieces for each in last_decisions(cloth, decisions)]
    off, kept = ([part for one, part in last if one.taken_off == is_off] for is_off in (True, False))
    return DecidedParts(taken_off=off, kept=kept)


def last_decisions(cloth: Cloth, decisions: Sequence[DecidedPart]) -> list[tuple[DecidedPart, Bool]]:
    """Return the last decision about each part that is found again, and its samples (N,)."""
    found: list[tuple[DecidedPart, Bool]] = []
    for decision in decisions:
        part = found_again(cloth, decision)
        if part is not None:
            found = [(before, other) for before, other in found if not is_same_part(part, other)]
            found.append((decision, part))
    return found


def is_same_part(part: Bool, other: Bool) -> bool:
    """Return whether two parts (N,) have most of their samples in common."""
    return bool((part & other).sum() > 0.5 * (part | other).sum())


def pixels_of_part(view: FlattenedView, cloth: Cloth, part: Bool) -> Bool:
    """Return the pixels (H, W) of the shape that a part (N,) of its samples carries."""
    own = np.zeros(view.shape, dtype=np.bool_)
    own[view.valid] = cloth.at(view.uv_from_rc(np.argwhere(view.valid)), part)
    return own
