"""Refinement of a placement: the motion of samples on the plane that fits them to the surface they cover."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.types import Bool, Float64, Int64, Rigid2


@dataclass(frozen=True, kw_only=True)
class Nodes:
    """Nodes of a surface: ``uv_m`` (N, 2) on its plane, ``xyz_m`` and unit ``normal`` (N, 3) in space.

    ``frames`` (N, 3, 2) are isometries from the plane to the tangent plane of each node, which covers what
    lies within ``within_m`` of it.
    """

    uv_m: Float64
    xyz_m: Float64
    normal: Float64
    frames: Float64
    within_m: float

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.uv_m)

    def surface_at(self, uv_m: Float64) -> tuple[Bool, Int64, Float64]:
        """Return which places (K, 2) of the plane are covered, and by which node (M,) at which xyz (M, 3)."""
        away_m, nearest = self._tree.query(uv_m, distance_upper_bound=self.within_m)
        covered: Bool = np.isfinite(away_m)
        node = nearest[covered]
        offset = np.einsum("nij,nj->ni", self.frames[node], uv_m[covered] - self.uv_m[node])
        return covered, node, self.xyz_m[node] + offset


def fitted(
    nodes: Nodes,
    samples: tuple[Float64, Float64, Float64],
    initial: Rigid2,
    radii_m: tuple[float, float],
    rounds: int,
) -> tuple[Rigid2, Float64 | None]:
    """Fit samples in space to the surface that they cover, by Gauss-Newton with robust weights.

    Parameters
    ----------
    nodes : Nodes
        The surface.
    samples : three float64 arrays
        What covers it: (K, 2) on its own plane, and places and unit normals (K, 3) in space.
    initial : Rigid2
        Motion from the samples' plane to that of the nodes.
    radii_m : (float, float)
        Distance in space, m, at which a sample has a quarter of its weight: at first, and at least.
    rounds : int
        Steps.

    Returns
    -------
    (Rigid2, (3, 3) float64 or None)
        The motion, and its information (rotation about the middle of the covered samples, u, v) in units of
        the weights; None if too few samples cover the surface.
    """
    motion, radius_m, information = initial, radii_m[0], None
    for _ in range(rounds):
        uv = motion.apply(samples[0])
        covered, node, there = nodes.surface_at(uv)
        apart, frames = samples[1][covered] - there, nodes.frames[node]
        weight = 1.0 / (1.0 + np.square(apart / radius_m).sum(axis=1)) ** 2
        weight[np.einsum("ni,ni->n", samples[2][covered], nodes.normal[node]) <= 0.5] = 0.0
        if weight.sum() < 3.0:  # a motion has three unknowns
            return motion, None
        middle = uv[covered].mean(axis=0)
        # On the plane, since the frames are isometries: the step that is wanted, and its derivatives.
        wanted, arm = np.einsum("nij,ni->nj", frames, apart), uv[covered] - middle
        turned = np.stack([-arm[:, 1], arm[:, 0]], axis=1)
        rows = np.concatenate([turned[:, :, None], np.broadcast_to(np.eye(2), (len(arm), 2, 2))], axis=2)
        information = np.einsum("n,nai,naj->ij", weight, rows, rows)
        right = np.einsum("n,nai,na->i", weight, rows, wanted)
        step = np.linalg.solve(information + 1e-9 * np.eye(3), right)
        motion = Rigid2(*step.tolist()).about(middle) @ motion
        radius_m = max(0.5 * radius_m, radii_m[1])
    return motion, information
