"""The methods compared: flatcloth's solver, its lower bound, and other people's flattenings."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import coo_matrix, csr_matrix, diags_array
from scipy.sparse.linalg import splu

from benchmarks.problems import Problem
from flatcloth.core.types import Float64
from flatcloth.flattening.flatten import MAJORISATIONS
from flatcloth.flattening.minimisation import ENERGY_TOLERANCE, energy_of, minimise

Solver = Callable[[Problem, float], Float64 | None]
"""Takes a problem and the H to reach (m^2; only SciPy needs to be told); returns (N, 2) or None."""


@dataclass(frozen=True, kw_only=True)
class Method:
    """A method with what its rows need: the fit its result is measured by, and how far it scales."""

    name: str
    solve: Solver
    keeps_scale: bool = True
    keeps_side: bool = True
    largest: int = 1_000_000
    note: str = ""


def methods() -> list[Method]:
    """Return flatcloth, the lower bound and the peers."""
    return [
        Method(name=FLATCLOTH, solve=_flatcloth),
        Method(
            name=BOUND,
            solve=_bound,
            note="one N x N Laplacian factorisation and five solves with two columns: no result",
        ),
        Method(name="libigl ARAP", solve=_arap, note="from LSCM, 10 iterations, on the triangle mesh"),
        Method(name="libigl SLIM", solve=_slim, note="from the pixel start, 20 iterations, on the mesh"),
        Method(
            name="SciPy least_squares",
            solve=_least_squares,
            note="trf with lsmr, sparse Jacobian, stopped once H is within 1 % of the best",
        ),
        Method(
            name="Open3D uvatlas",
            solve=_uvatlas,
            keeps_scale=False,
            note="as one chart if it can; its error is after a fit with scale (it loses it)",
        ),
        Method(
            name="scikit-learn Isomap",
            solve=_isomap,
            keeps_side=False,
            largest=5000,
            note="8 neighbours; its error is after a fit that may mirror; its memory grows with N^2",
        ),
    ]


FLATCLOTH = "flatcloth"
BOUND = "lower bound"


def _flatcloth(problem: Problem, _target: float) -> Float64:
    return minimise(
        problem.start_uv_m,
        problem.edges,
        problem.edge_length_m,
        majorisations=MAJORISATIONS,
        energy_tolerance=ENERGY_TOLERANCE,
    ).uv_m


def least_known_energy(problem: Problem) -> float:
    """Return the least H that flatcloth's solver finds when given time, also with the truth to start from."""
    known = np.isfinite(problem.true_uv_m[:, :1])
    energies = [energy_of(problem.start_uv_m, problem.edges, problem.edge_length_m)]
    starts = [problem.start_uv_m] + ([problem.true_uv_m] if known.all() else [])
    for start in starts:
        with contextlib.suppress(RuntimeError):  # a start with coinciding points is singular
            found = minimise(
                start, problem.edges, problem.edge_length_m, majorisations=60, energy_tolerance=1e-9
            )
            energies.append(energy_of(found.uv_m, problem.edges, problem.edge_length_m))
    return min(energies)


def _bound(problem: Problem, _target: float) -> None:
    n = problem.size
    a, b = problem.edges.T
    links = coo_matrix((np.ones(a.size), (a, b)), shape=(n, n)).tocsr()
    links = links + links.T
    laplacian = (diags_array(np.asarray(links.sum(axis=1)).ravel()) - links).tocsc()[1:, 1:]
    factor = splu(
        laplacian, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    right = np.ascontiguousarray(problem.start_uv_m[1:])
    for _ in range(5):
        factor.solve(right)


def _arap(problem: Problem, _target: float) -> Float64:
    import igl

    points, triangles = np.ascontiguousarray(problem.points_m), problem.triangles.astype(np.int64)
    far = np.array([0, np.linalg.norm(points - points[0], axis=1).argmax()])
    place = np.array([[0.0, 0.0], [np.linalg.norm(points[far[1]] - points[0]), 0.0]])
    start, _ = igl.lscm(points, triangles, far, place)
    data = igl.ARAPData()
    data.max_iter = 10
    data.with_dynamics = True
    igl.arap_precomputation(points, triangles, 2, np.zeros(0, dtype=np.int32), data)
    return igl.arap_solve(np.zeros((0, 2)), data, start)[:, :2]


def _slim(problem: Problem, _target: float) -> Float64:
    import igl

    data = igl.slim_precompute(
        np.asfortranarray(problem.points_m),
        np.asfortranarray(problem.triangles, dtype=np.int32),
        np.asfortranarray(problem.start_uv_m),
        igl.MappingEnergyType.SYMMETRIC_DIRICHLET,
        np.zeros(0, dtype=np.int32),
        np.zeros((0, 2), order="F"),
        0.0,
    )
    return igl.slim_solve(data, 20)


class _ReachedError(Exception):
    """Ends SciPy's iteration; carries the solution."""


def _least_squares(problem: Problem, target: float) -> Float64:
    a, b = problem.edges.T
    row = np.arange(a.size)
    rows = np.repeat(row, 4)
    cols = np.stack([2 * a, 2 * a + 1, 2 * b, 2 * b + 1], axis=1).ravel()

    def residual(x: Float64) -> Float64:
        uv = x.reshape(-1, 2)
        found: Float64 = np.linalg.norm(uv[a] - uv[b], axis=1) - problem.edge_length_m
        if found @ found <= target:
            raise _ReachedError(uv.copy())
        return found

    def jacobian(x: Float64) -> csr_matrix:
        uv = x.reshape(-1, 2)
        unit = uv[a] - uv[b]
        unit /= np.linalg.norm(unit, axis=1)[:, None]
        return csr_matrix((np.hstack([unit, -unit]).ravel(), (rows, cols)), shape=(a.size, x.size))

    try:
        result = least_squares(
            residual, problem.start_uv_m.ravel(), jacobian, method="trf", tr_solver="lsmr", max_nfev=200
        )
    except _ReachedError as reached:
        return reached.args[0]
    return result.x.reshape(-1, 2)


def _uvatlas(problem: Problem, _target: float) -> Float64 | None:
    import open3d as o3d

    o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Warning)
    mesh = o3d.t.geometry.TriangleMesh(
        o3d.core.Tensor(problem.points_m.astype(np.float32)),
        o3d.core.Tensor(problem.triangles.astype(np.int32)),
    )
    mesh.compute_uvatlas(size=4096, max_stretch=1.0, parallel_partitions=1, nthreads=1)
    corners = mesh.triangle["texture_uvs"].numpy().reshape(-1, 2).astype(np.float64)
    uv = np.empty((problem.size, 2))
    points = problem.triangles.ravel()
    uv[points] = corners
    # A cut chart has no single place for a point.
    return uv if np.abs(uv[points] - corners).max() < 1e-5 else None


def _isomap(problem: Problem, _target: float) -> Float64:
    from sklearn.manifold import Isomap

    return Isomap(n_neighbors=8, n_components=2).fit_transform(problem.points_m)
