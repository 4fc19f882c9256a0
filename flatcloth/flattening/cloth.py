"""The cloth of a shape as a graph: its samples, and the pairs of them that were seen to belong together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.types import Bool, Float64, Int32


@dataclass(frozen=True, kw_only=True)
class Cloth:
    """How the shape hangs together, by a method that weighs its edges; samples of other pieces have no place.

    ``uv_m`` (N, 2), ``xyz_m`` (N, 3, object frame) of the samples, NaN without a position; ``edges`` (M, 2)
    int32 are those of Eq. (2) at their present position on the plane; ``length_m`` (M,) along the cloth.
    ``evidence`` (M,) that a pair is one sheet; ``view_index`` (M,) saw it; noise may join layers that touch.
    """

    uv_m: Float64
    xyz_m: Float64
    edges: Int32
    length_m: Float64
    evidence: Float64
    view_index: Int32
    is_noisy: bool = False

    @property
    def placed(self) -> Bool:
        """(N,) which samples lie on the shape."""
        placed: Bool = np.isfinite(self.uv_m[:, 0])
        return placed

    @property
    def joined(self) -> Bool:
        """(M,) which pairs join samples of the shape."""
        joined: Bool = self.placed[self.edges].all(axis=1) & (self.evidence > 0.0)
        return joined

    @property
    def spacing_m(self) -> float:
        """Median distance of joined samples on the plane."""
        ends = self.uv_m[self.edges[self.joined]]
        return float(np.median(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)))

    def at(self, uv_m: Float64, part: Bool) -> Bool:
        """Return whether the samples nearest to places (K, 2) of the plane belong to a part (N,)."""
        nearest = cKDTree(self.uv_m[self.placed]).query(uv_m)[1]
        found: Bool = part[self.placed][nearest]
        return found
