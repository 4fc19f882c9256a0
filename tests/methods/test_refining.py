"""The refinement of a placement, against steps of Gauss-Newton with all derivatives in space."""

from __future__ import annotations

import numpy as np
import pytest

from flatcloth.core.types import Float64, Rigid2
from flatcloth.methods.refining import Nodes, fitted

WITHIN_M = 0.01
Samples = tuple[Float64, Float64, Float64]


def bent_cloth(random: np.random.Generator, places: Float64) -> tuple[Float64, Float64, Float64]:
    """Return points (N, 3) of a cylinder of radius 0.1 m, normals, and isometries (N, 3, 2) to it."""
    angle, none = places[:, 0] / 0.1, np.zeros(len(places))
    normal = np.stack([np.sin(angle), none, np.cos(angle)], axis=1)
    xyz = 0.1 * normal
    xyz[:, 1] = places[:, 1]
    across = np.stack([np.cos(angle), none, -np.sin(angle)], axis=1)
    frames = np.stack([across, np.tile([0.0, 1.0, 0.0], (len(places), 1))], axis=2)
    return xyz + random.normal(0.0, 2e-4, xyz.shape), normal, frames


def given(seed: int) -> tuple[Nodes, Samples]:
    random = np.random.default_rng(seed)
    uv = random.uniform(-0.15, 0.15, (2000, 2))
    xyz, normal, frames = bent_cloth(random, uv)
    nodes = Nodes(uv_m=uv, xyz_m=xyz, normal=normal, frames=frames, within_m=WITHIN_M)
    own = random.uniform(-0.05, 0.16, (400, 2))
    there, facing, _ = bent_cloth(random, own)
    return nodes, (own, there, facing)


def plain_step(nodes: Nodes, samples: Samples, motion: Rigid2, radius_m: float) -> tuple[Rigid2, Float64]:
    """Return the motion after one step of Gauss-Newton, and its information."""
    uv = motion.apply(samples[0])
    away = np.linalg.norm(uv[:, None] - nodes.uv_m, axis=2)
    on, n = np.flatnonzero(away.min(axis=1) < WITHIN_M), away.argmin(axis=1)
    n = n[on]
    off = uv[on] - nodes.uv_m[n]
    apart = samples[1][on] - nodes.xyz_m[n] - np.einsum("nij,nj->ni", nodes.frames[n], off)
    weight = 1.0 / (1.0 + np.square(apart).sum(axis=1) / radius_m**2) ** 2
    weight[(samples[2][on] * nodes.normal[n]).sum(axis=1) <= 0.5] = 0.0
    middle = uv[on].mean(axis=0)
    arm = uv[on] - middle
    turn = np.einsum("nij,nj->ni", nodes.frames[n], np.stack([-arm[:, 1], arm[:, 0]], axis=1))
    rows = np.concatenate([turn[:, :, None], nodes.frames[n]], axis=2)
    hessian = np.einsum("n,nai,naj->ij", weight, rows, rows)
    step = np.linalg.solve(hessian, np.einsum("n,nai,na->i", weight, rows, apart))
    return Rigid2(*step.tolist()).about(middle) @ motion, hessian


@pytest.mark.parametrize("initial", [Rigid2(), Rigid2(0.1, 0.01, -0.004), Rigid2(-0.4, 0.03, 0.05)])
def test_the_rounds_are_steps_of_gauss_newton(initial: Rigid2) -> None:
    nodes, samples = given(4)
    motion, radius_m = initial, 0.02
    for rounds in range(1, 6):
        motion, hessian = plain_step(nodes, samples, motion, radius_m)
        found, information = fitted(nodes, samples, initial, (0.02, 0.004), rounds)
        corners = np.array([[-0.1, -0.1], [0.1, 0.1]])
        np.testing.assert_allclose(found.apply(corners), motion.apply(corners), atol=1e-9)
        assert information is not None
        np.testing.assert_allclose(information, hessian, atol=1e-6 * hessian.max())
        radius_m = max(0.5 * radius_m, 0.004)


def test_samples_beside_the_surface_tell_no_motion() -> None:
    nodes, samples = given(5)
    beside = Rigid2(0.0, 3.0, 0.0)
    assert fitted(nodes, samples, beside, (0.02, 0.004), 8) == (beside, None)


def test_samples_of_the_other_side_of_the_cloth_tell_no_motion() -> None:
    nodes, samples = given(6)
    motion, information = fitted(nodes, (*samples[:2], -samples[2]), Rigid2(), (0.02, 0.004), 8)
    assert motion == Rigid2()
    assert information is None
