"""Links that no garment allows: a part of the shape that fits a garment only where it is not joined.

Layers that touch are taken for one sheet now and then: a sleeve lies flush on the body, and grows from it
in the flattened shape. Candidates of such parts are areas of well connected cloth that meet others where
less evidence joins them (a watershed), cut off where the least does (a minimum cut). For each, garments are
fitted to the rest of the shape, with the part wherever else it belongs. Joined or not is then decided as
kinds are: by the evidence of both fits, where a part that lies freely costs its three degrees of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.special import expit

from flatcloth.core.graphs import cut_between
from flatcloth.core.types import Bool, Int64, Rigid2
from flatcloth.flattening.cloth import Cloth
from flatcloth.garments.evidence import LEAST_AREA_M2, PieceEvidence
from flatcloth.garments.fit import APART_M, TEMPERATURE, Fit, refine
from flatcloth.garments.placing import contradiction, place_piece
from flatcloth.segmentation.settings import SURE

WRONG_PROBABILITY = 0.5
"""A link less probable than this is taken for wrong without asking: it is more probably so. By definition;
the operator sees the part next to the shape, and can undo that."""
WEAK_EVIDENCE = 2.0
"""... and if less evidence joins it for each row of samples along the seam. Set by hand: wrong
links have 0.2 to 1.8, right ones 0.2 and more, most of them more than this (docs/garments.md)."""


class GarmentPlace(NamedTuple):
    """Where else a part belongs by a garment: the motion there, how far its farthest place moves, how
    probable it is against other places; and the evidence of that garment, with the part there.
    """

    shape_from_part: Rigid2
    moved_m: float
    probability: float
    log_evidence: float


@dataclass(frozen=True, kw_only=True)
class DoubtedLink:
    """A part of the shape that no garment allows where it is joined.

    ``part`` (N,) are its samples; ``probability`` that the link is right; ``area_m2`` of the part;
    ``evidence`` that joins it, for each row of samples along the seam; ``place`` where else it belongs.
    """

    part: Bool
    probability: float
    area_m2: float
    evidence: float = 0.0
    place: GarmentPlace | None = None

    @property
    def std_m(self) -> float:
        """Root mean square error of where the part is shown: joined, and elsewhere if that is wrong."""
        return 0.0 if self.place is None else math.sqrt(1.0 - self.probability) * self.place.moved_m


def is_offered(link: DoubtedLink) -> bool:
    """Return whether an operator is asked about a link."""
    return link.probability < SURE


def is_wrong(link: DoubtedLink) -> bool:
    """Return whether a part may be taken off without asking the operator.

    A garment of an unknown kind fits nothing where it is joined, so the link must be weak besides.
    """
    return link.probability < WRONG_PROBABILITY and link.evidence < WEAK_EVIDENCE


def doubted_links(fits: Sequence[Fit], main: PieceEvidence, cloth: Cloth) -> list[DoubtedLink]:
    """Return the links of a shape that no garment allows, the least probable first; they do not overlap.

    Parameters
    ----------
    fits : sequence of Fit
        The best fits to the shape as it is, the most probable first.
    main : PieceEvidence
        Of the shape.
    cloth : Cloth
        How it hangs together.
    """
    together = max(fit.log_evidence for fit in fits)
    found: list[DoubtedLink] = []
    for part in weakly_joined(cloth):
        own, rest = split(main, cloth, part)
        if own.area_m2 < LEAST_AREA_M2:
            continue
        place = place_elsewhere(fits, rest, own)
        apart = -math.inf if place is None else place.log_evidence
        chance = float(expit((together - apart) / TEMPERATURE))
        found.append(
            DoubtedLink(
                part=part,
                probability=chance,
                area_m2=own.area_m2,
                evidence=evidence_per_row(cloth, part),
                place=place,
            )
        )
    return sorted(found, key=lambda link: link.probability)


def weakly_joined(cloth: Cloth) -> Iterator[Bool]:
    """Yield the smaller side (N,) of each cut of least evidence between areas of well connected cloth."""
    for core, other in basins(cloth):
        part = side_of(cloth, core, other)
        if 2 * part.sum() > cloth.placed.sum():  # the core lies on the larger side
            part = cloth.placed & ~part
        if part.any():
            yield part


def basins(cloth: Cloth) -> list[tuple[Int64, Int64]]:
    """Return pairs of areas of well connected samples that meet where less evidence joins them.

    The watershed of the evidence: samples are added in the order of how much evidence joins them to their
    neighbours; where two areas meet that are both large, the smaller one is a candidate of a part.
    """
    n = len(cloth.uv_m)
    kept = cloth.joined
    ends = cloth.edges[kept]
    rows, columns = np.concatenate([ends, ends[:, ::-1]]).T
    joined = coo_matrix((np.tile(cloth.evidence[kept], 2), (rows, columns)), shape=(n, n)).tocsr()
    counts = np.diff(joined.indptr)
    strength = np.asarray(joined.sum(axis=1)).ravel()
    strength = (strength + (joined > 0).astype(np.float64) @ strength) / (1 + counts)
    least = LEAST_AREA_M2 / cloth.spacing_m**2
    area = np.full(n, -1)
    members: dict[int, list[int]] = {}
    found = []
    for node in np.argsort(-strength)[: int((counts > 0).sum())].tolist():
        area[node], members[node] = node, [node]
        for other in joined.indices[joined.indptr[node] : joined.indptr[node + 1]].tolist():
            one, two = int(area[node]), int(area[other])
            if two < 0 or one == two:
                continue
            if len(members[one]) < len(members[two]):
                one, two = two, one  # an area is called by its first sample
            if len(members[two]) >= least and strength[node] < strength[two]:
                found.append((np.array(members[two]), np.array(members[one])))
            area[members[two]] = one
            members[one] += members.pop(two)
    return found


def side_of(cloth: Cloth, own: Int64, others: Int64) -> Bool:
    """Return the samples (N,) on the side of ``own`` of the cut with the least evidence to ``others``."""
    joined = cloth.joined
    side = cut_between(len(cloth.uv_m), cloth.edges[joined], cloth.evidence[joined], own, others)
    return side & cloth.placed


def evidence_per_row(cloth: Cloth, part: Bool) -> float:
    """Return the evidence that joins a part (N,) for each row of samples along the seam.

    Layers that touch are joined by a false pair here and there: the longer they touch, the more there are.
    """
    across = cloth.joined & (part[cloth.edges[:, 0]] != part[cloth.edges[:, 1]])
    ends = cloth.uv_m[cloth.edges]
    middles = ends[across].mean(axis=1)
    along = np.linalg.svd(middles - middles.mean(axis=0), full_matrices=False)[2][0]
    rows = 1.0 + np.ptp(middles @ along) / cloth.spacing_m
    return float(cloth.evidence[across].sum() / rows)


def split(main: PieceEvidence, cloth: Cloth, part: Bool) -> tuple[PieceEvidence, PieceEvidence]:
    """Return the evidence of a part (N,) of the samples, and that of the rest."""
    edges, insides = cloth.at(main.edge_uv_m, part), cloth.at(main.inside_uv_m, part)
    pixels = np.argwhere(main.depth_m > 0)
    there = cloth.at(main.depth_origin_uv_m + main.depth_pixel_m * pixels[:, ::-1], part)
    return main.part(edges, insides, pixels[there]), main.part(~edges, ~insides, pixels[~there])


def place_elsewhere(fits: Sequence[Fit], rest: PieceEvidence, own: PieceEvidence) -> GarmentPlace | None:
    """Return where else than joined a part belongs by the best kind of garment, None if nowhere."""
    best: GarmentPlace | None = None
    for fit in fits:
        begun = [fit, *(other for _, other in fit.others)]
        alone = max(
            (refine(fit.kind, (rest,), f.parameters, f.garment_from_piece[:1]) for f in begun),
            key=lambda f: f.log_evidence,
        )
        placed = place_piece(alone, rest, own, 0)
        if placed is not None:
            both = refine(
                fit.kind, (rest, own), placed.fit.parameters, placed.fit.garment_from_piece,
                annealed=(1.0,),
            )  # fmt: skip
            evidence = both.log_evidence - contradiction(both, rest, own)
            motion = both.garment_from_piece[0].inverse() @ both.garment_from_piece[1]
            off_m = np.linalg.norm(motion.apply(own.inside_uv_m) - own.inside_uv_m, axis=1)
            # Flattened sleeves and legs are turned by some degrees, which moves them 2 to 5 cm.
            if off_m.mean() > APART_M and (best is None or evidence > best.log_evidence):
                best = GarmentPlace(motion, float(off_m.max()), placed.probability, evidence)
    return best
