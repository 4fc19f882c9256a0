"""What holds the parts of a shape: where the least evidence joins them, and the views that saw it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flatcloth.core.types import Bool, Float64, Int64
from flatcloth.flattening.cloth import Cloth
from flatcloth.garments.deciding import is_same_part, kept_parts
from flatcloth.garments.links import DoubtedLink, evidence_per_row, weakly_joined
from flatcloth.session.garment import DoubtedPart

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
    """Where a part of the shape is joined to the rest.

    ``part`` (N,) are its samples; ``evidence`` joins it for each row of samples; ``probability`` that the
    link is right, None if no garment was fitted without it; ``seam_uv_m`` (K, 2) and ``seam_xyz_m`` (K, 3)
    are the middles of the different pairs across; ``views`` have most pairs first. ``is_kept``: the operator
    decided so.
    """

    part: Bool
    evidence: float
    probability: float | None
    seam_uv_m: Float64
    seam_xyz_m: Float64
    views: tuple[HeldBy, ...]
    is_kept: bool

    @property
    def link(self) -> DoubtedLink:
        """The joint as a link to decide about; without a garment, either is as likely."""
        chance = 0.5 if self.probability is None else self.probability
        return DoubtedLink(part=self.part, probability=chance, area_m2=0.0, evidence=self.evidence)


def joints_of(
    cloth: Cloth, doubted: Sequence[DoubtedLink] = (), decisions: Sequence[DoubtedPart] = ()
) -> list[Joint]:
    """Return where parts of a shape are joined by the least evidence, the weakest first.

    Parameters
    ----------
    cloth : Cloth
        How the shape hangs together, with lengths and views of its pairs.
    doubted : sequence of DoubtedLink
        Links that no garment allows.
    decisions : sequence of DoubtedPart
        What was decided about parts.
    """
    parts = [link.part for link in doubted]
    for part in weakly_joined(cloth):
        if not any(is_same_part(part, other) for other in parts):
            parts.append(part)
    kept = kept_parts(cloth, decisions) if decisions else []
    joints = []
    for part in parts:
        across = np.flatnonzero(cloth.joined & (part[cloth.edges[:, 0]] != part[cloth.edges[:, 1]]))
        if not across.size:
            continue
        chance = next((link.probability for link in doubted if is_same_part(link.part, part)), None)
        once = np.unique(np.sort(cloth.edges[across], axis=1), axis=0)
        joints.append(
            Joint(
                part=part,
                evidence=evidence_per_row(cloth, part),
                probability=chance,
                seam_uv_m=cloth.uv_m[once].mean(axis=1),
                seam_xyz_m=cloth.xyz_m[once].mean(axis=1),
                views=_views(cloth, across),
                is_kept=any(is_same_part(part, other) for other in kept),
            )
        )
    return sorted(joints, key=lambda joint: joint.evidence)


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
