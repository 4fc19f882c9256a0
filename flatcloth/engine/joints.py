"""Weak joints of a shape: where little evidence joins a part, how probably rightly, seen by which views."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import MIRROR, Bool, Float64, Int64, Rigid2
from flatcloth.engine.garment import KnownGarment
from flatcloth.flattening.cloth import Cloth
from flatcloth.garments.deciding import is_same_part, last_decisions
from flatcloth.garments.evidence import LEAST_AREA_M2, PieceEvidence
from flatcloth.garments.fit import APART_M
from flatcloth.garments.placing import place_elsewhere
from flatcloth.session.garment import DecidedPart
from flatcloth.shape.graph import pairs_once
from flatcloth.shape.joints import seen_often, weak_joints

_MOST = 0.9  # by definition: nine tenths of the residuals are below


@dataclass(frozen=True, kw_only=True)
class HeldBy:
    """A view that joins a part to the rest: how many pairs it saw, and how well they fit the shape.

    ``residual_m`` are the median and the ninth decile of how far the pairs are from their length;
    ``xyz_m`` (K, 3) the middles of the pairs, object frame.
    """

    view_index: int
    pairs: int
    residual_m: tuple[float, float]
    xyz_m: Float64


@dataclass(frozen=True)
class Place:
    """Where a part lies if its joint is false: what says so, its motion there, and how probable that is."""

    by: Literal["garment", "seams"]
    shape_from_part: Rigid2
    probability: float


@dataclass(frozen=True, kw_only=True)
class Joint:
    """Where a part of the shape hangs on the rest.

    ``part`` (N,) are the samples behind the joint, ``share`` their share of all; ``evidence`` is that of the
    pairs across, ``probability`` that the joint is right. ``ends_uv_m`` (K, 2, 2) are the ends of the
    different pairs across, that of the part first, and ``length_m`` (K,) their lengths along the cloth;
    ``seam_xyz_m`` (K, 3) their middles. ``views`` have most pairs first. ``is_kept``: the operator says so.
    ``places`` are those that :func:`with_places` finds.
    """

    part: Bool
    share: float
    evidence: float
    probability: float
    ends_uv_m: Float64
    length_m: Float64
    seam_xyz_m: Float64
    views: tuple[HeldBy, ...]
    is_kept: bool
    places: tuple[Place, ...] = ()

    @property
    def seam_uv_m(self) -> Float64:
        """(K, 2) the middles of the pairs across."""
        middle: Float64 = self.ends_uv_m.mean(axis=1)
        return middle


def joints_of(cloth: Cloth, decisions: Sequence[DecidedPart] = ()) -> list[Joint]:
    """Return the weak joints of a shape, the one with the most doubtful cloth first.

    ``cloth`` says how the shape hangs together. A part that the operator keeps, by one of the ``decisions``,
    is right. Without noise, no part is joined falsely.
    """
    joined = np.flatnonzero(cloth.joined)
    pairs, pair = pairs_once(cloth.edges[joined])
    counted = seen_often(np.bincount(pair, cloth.evidence[joined]).astype(np.float64), np.bincount(pair))
    length_m = np.bincount(pair, cloth.length_m[joined]) / np.bincount(pair)
    kept = [part for decided, part in last_decisions(cloth, decisions) if not decided.taken_off]
    least = LEAST_AREA_M2 / cloth.spacing_m**2
    found = []
    for joint in weak_joints(pairs, counted, cloth.placed):
        part = joint.part
        across = np.flatnonzero(cloth.joined & (part[cloth.edges[:, 0]] != part[cloth.edges[:, 1]]))
        if not across.size or np.count_nonzero(part) < least:
            continue
        apart = part[pairs[:, 0]] != part[pairs[:, 1]]
        ends = np.where(part[pairs[apart, :1]], pairs[apart], pairs[apart, ::-1])
        is_kept = any(is_same_part(part, other) for other in kept)
        found.append(
            Joint(
                part=part,
                share=np.count_nonzero(part) / np.count_nonzero(cloth.placed),
                evidence=float(counted[apart].sum()),
                probability=1.0 if is_kept else 1.0 - joint.false * cloth.is_noisy,
                ends_uv_m=cloth.uv_m[ends],
                length_m=length_m[apart],
                seam_xyz_m=cloth.xyz_m[ends].mean(axis=1),
                views=_views(cloth, across),
                is_kept=is_kept,
            )
        )
    return sorted(found, key=lambda joint: (-joint.share * (1.0 - joint.probability), joint.evidence))


def with_places(found: Sequence[Joint], cloth: Cloth, known: KnownGarment | str | None) -> list[Joint]:
    """Return the joints of a shape with the places that its garment, or seams, have for parts in doubt.

    It takes a second for each of them.
    """
    if known is None or isinstance(known, str):
        return list(found)
    return [replace(joint, places=tuple(_places(joint, cloth, known))) for joint in found]


def _places(joint: Joint, cloth: Cloth, known: KnownGarment) -> Iterator[Place]:
    left, own_uv_m = 1.0 - joint.probability, cloth.uv_m[joint.part]
    if left <= 0.0:
        return
    for seam in () if known.sides is None else known.sides.seams:
        if seam.why and seam.this_piece == seam.other_piece == 0:
            own = cloth.at(seam.this_uv_m, joint.part) & np.isfinite(seam.other_uv_m[:, 0])
            if 2 * np.count_nonzero(own) > len(own):
                motion = fit_rigid2(seam.this_uv_m[own], seam.other_uv_m[own] * MIRROR)
                if np.linalg.norm(motion.apply(own_uv_m) - own_uv_m, axis=1).mean() > APART_M:
                    yield Place("seams", motion, min(left, seam.probability))
                    left -= min(left, seam.probability)
    part, rest = _split(known.evidence[0].sheets[0], cloth, joint.part)
    place = place_elsewhere(known.found.fit, rest, part)
    if place is not None:
        motion, probability = place
        yield Place("garment", motion, left * probability)


def _split(main: PieceEvidence, cloth: Cloth, part: Bool) -> tuple[PieceEvidence, PieceEvidence]:
    """Return the evidence of a part (N,) of the samples, and that of the rest."""
    edges, insides = cloth.at(main.edge_uv_m, part), cloth.at(main.inside_uv_m, part)
    pixels = np.argwhere(main.depth_m > 0)
    there = cloth.at(main.depth_origin_uv_m + main.depth_pixel_m * pixels[:, ::-1], part)
    return main.part(edges, insides, pixels[there]), main.part(~edges, ~insides, pixels[~there])


class Alternative(NamedTuple):
    """What the shape may be: as it is, or a ``joint`` is false and its part lies at a ``place``.

    Where no place is known, the part lies anywhere else.
    """

    probability: float
    joint: Joint | None = None
    place: Place | None = None


def alternatives(found: Sequence[Joint]) -> list[Alternative]:
    """Return what the shape may be, the most probable first.

    Shapes with several false joints are not listed: they have the rest of the probability.
    """
    right = math.prod(joint.probability for joint in found)
    listed = [Alternative(right)]
    for joint in found:
        others, left = right / max(joint.probability, 1e-9), 1.0 - joint.probability
        for place in joint.places:
            listed.append(Alternative(others * place.probability, joint, place))
            left -= place.probability
        if left > 0.0:
            listed.append(Alternative(others * left, joint))
    return sorted(listed, key=lambda each: -each.probability)


def _views(cloth: Cloth, across: Int64) -> tuple[HeldBy, ...]:
    ends = cloth.uv_m[cloth.edges[across]]
    residual_m = np.abs(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) - cloth.length_m[across])
    middle = cloth.xyz_m[cloth.edges[across]].mean(axis=1)
    views, counts = np.unique(cloth.view_index[across], return_counts=True)
    found = []
    for n in np.argsort(-counts, kind="stable"):
        own = cloth.view_index[across] == views[n]
        median_m, most_m = np.quantile(residual_m[own], [0.5, _MOST]).tolist()
        found.append(
            HeldBy(
                view_index=int(views[n]),
                pairs=int(counts[n]),
                residual_m=(float(median_m), float(most_m)),
                xyz_m=middle[own],
            )
        )
    return tuple(found)
