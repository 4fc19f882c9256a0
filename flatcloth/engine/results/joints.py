"""Weak joints of a shape: where little evidence joins a part, how probably rightly, seen by which views."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flatcloth.core.types import Bool, Float64, Int64
from flatcloth.flattening.cloth import Cloth
from flatcloth.garments.deciding import decided_parts, is_same_part, last_decisions
from flatcloth.garments.evidence import LEAST_AREA_M2
from flatcloth.garments.links import DoubtedLink
from flatcloth.session.garment import DoubtedPart
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


@dataclass(frozen=True, kw_only=True)
class Joint:
    """Where a part of the shape hangs on the rest.

    ``part`` (N,) are the samples behind the joint, ``share`` their share of all; ``evidence`` is that of the
    pairs across, ``probability`` that the joint is right. ``seam_uv_m`` (K, 2), ``seam_xyz_m`` (K, 3) are the
    middles of the different pairs across; ``views`` have most pairs first. ``is_kept``: the operator says so.
    """

    part: Bool
    share: float
    evidence: float
    probability: float
    seam_uv_m: Float64
    seam_xyz_m: Float64
    views: tuple[HeldBy, ...]
    is_kept: bool


def joints_of(
    cloth: Cloth, doubted: Sequence[DoubtedLink] = (), decisions: Sequence[DoubtedPart] = ()
) -> list[Joint]:
    """Return the weak joints of a shape, the one with the most doubtful cloth first.

    ``cloth`` says how the shape hangs together, ``doubted`` are links that no garment allows, ``decisions``
    are about parts. A part that a garment or a seam contradicts has the probability that these leave it; one
    that the operator keeps is right. Without noise, no part is joined falsely.
    """
    joined = np.flatnonzero(cloth.joined)
    pairs, pair = pairs_once(cloth.edges[joined])
    evidence = np.bincount(pair, cloth.evidence[joined]).astype(np.float64)
    counted = seen_often(evidence, np.bincount(pair))
    parts = [(link.part, link.probability) for link in doubted]
    parts += [
        (part, decided.probability) for decided, part in last_decisions(cloth, decisions) if decided.std_m
    ]
    for joint in weak_joints(pairs, counted, cloth.placed):
        if not any(is_same_part(joint.part, part) for part, _ in parts):
            parts.append((joint.part, 1.0 - joint.false * cloth.is_noisy))
    kept, least = decided_parts([cloth], decisions).kept, LEAST_AREA_M2 / cloth.spacing_m**2
    found = []
    for part, probability in parts:
        across = np.flatnonzero(cloth.joined & (part[cloth.edges[:, 0]] != part[cloth.edges[:, 1]]))
        if not across.size or np.count_nonzero(part) < least:
            continue
        apart = part[pairs[:, 0]] != part[pairs[:, 1]]
        is_kept = any(is_same_part(part, other) for other in kept)
        found.append(
            Joint(
                part=part,
                share=np.count_nonzero(part) / np.count_nonzero(cloth.placed),
                evidence=float(counted[apart].sum()),
                probability=1.0 if is_kept else probability,
                seam_uv_m=cloth.uv_m[pairs[apart]].mean(axis=1),
                seam_xyz_m=cloth.xyz_m[pairs[apart]].mean(axis=1),
                views=_views(cloth, across),
                is_kept=is_kept,
            )
        )
    return sorted(found, key=lambda joint: (-joint.share * (1.0 - joint.probability), joint.evidence))


def alternatives(found: Sequence[Joint]) -> list[tuple[float, Joint | None]]:
    """Return what the shape may be, the most probable first, each with its probability.

    None stands for the shape as it is; a joint for the shape in which this joint is false and its part lies
    elsewhere. Shapes with several false joints are not listed: they have the rest of the probability.
    """
    right = math.prod(joint.probability for joint in found)
    wrong = [
        (right * (1.0 - j.probability) / max(j.probability, 1e-9), j) for j in found if j.probability < 1.0
    ]
    return sorted([(right, None), *wrong], key=lambda each: -each[0])


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
