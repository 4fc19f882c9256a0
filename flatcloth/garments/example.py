"""Evidence as if an outline had been seen: for what is explained or measured without a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flatcloth.core.types import Float64, Rigid2
from flatcloth.flattening.borders import SPACING_M
from flatcloth.garments.distance import inside_outline
from flatcloth.garments.evidence import INSIDE_M, PieceEvidence
from flatcloth.garments.kinds import kind_named


def seen_outline(loops: Sequence[Float64], noise_m: float = 0.004) -> PieceEvidence:
    """Return the evidence of a flat shape whose whole border was seen, off at random.

    Parameters
    ----------
    loops : sequence of (K, 2) float64
        The outline, clockwise as drawn with v down, then its holes the other way round.
    noise_m : float
        Standard deviation of the edges.
    """
    random = np.random.default_rng(0)
    places, normals = [], []
    for loop in loops:
        for a, b in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            length = float(np.linalg.norm(b - a))
            count = max(1, int(length / SPACING_M))
            share = (np.arange(count) + 0.5) / count
            places.append(a + share[:, None] * (b - a))
            normals.append(np.tile([(b - a)[1] / length, -(b - a)[0] / length], (count, 1)))
    low, high = loops[0].min(axis=0), loops[0].max(axis=0)
    axes = (np.arange(a, b, INSIDE_M) for a, b in zip(low, high, strict=True))
    inside = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    inside = inside[inside_outline(inside, loops[0])]
    for hole in loops[1:]:
        inside = inside[~inside_outline(inside, hole)]
    edges = np.concatenate(places)
    round_holes = [np.linalg.norm(hole - np.roll(hole, 1, axis=0), axis=1).sum() for hole in loops[1:]]
    return PieceEvidence(
        edge_uv_m=edges + noise_m * random.standard_normal(edges.shape),
        edge_normal=np.concatenate(normals),
        edge_std_m=np.zeros(len(edges)),
        edge_trust=np.ones(len(edges)),
        unseen_uv_m=np.zeros((0, 2)),
        inside_uv_m=inside,
        inside_std_m=np.zeros(len(inside)),
        inside_xyz_m=np.concatenate([inside, np.zeros((len(inside), 1))], axis=1),
        area_m2=len(inside) * INSIDE_M**2,
        hole_edge_m=float(sum(round_holes)),
        depth_m=np.zeros((1, 1), dtype=np.float32),
        depth_origin_uv_m=low - 9.0,
        depth_pixel_m=0.002,
    )


def half_seen_tshirt() -> PieceEvidence:
    """Return the evidence of a turned T-shirt of which a sleeve and a part of the hem were not seen."""
    kind = kind_named("tshirt")
    outline = Rigid2(0.4, 0.1, 0.05).apply(kind.outline(kind.mean[:, None])[:, :, 0])
    whole = seen_outline([outline])
    edges, insides = (uv_m[:, 0] < 0.25 for uv_m in (whole.edge_uv_m, whole.inside_uv_m))
    rows = np.arange(outline[:, 1].min(), outline[:, 1].max(), SPACING_M)
    cut = np.stack(np.broadcast_arrays(0.25, rows), axis=1)
    seen = whole.part(edges, insides, np.zeros((0, 2), dtype=np.int64))
    return replace(seen, unseen_uv_m=cut[inside_outline(cut, outline)], area_m2=INSIDE_M**2 * insides.sum())
