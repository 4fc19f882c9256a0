"""Observations: the nodes of the shape that one view shows, and the lengths between them.

A node is a point of the cloth, stored by its position in the object frame. A view sees it if the node,
transformed to the view, lies on the visible surface with the same normal: then it is the same cloth,
whatever the texture. Where a view shows cloth without nodes, it adds nodes.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.compiled import njit
from flatcloth.core.config import SurfaceConfig
from flatcloth.core.errors import SurfaceError
from flatcloth.core.geometry import Rigid3, project, tangent_basis
from flatcloth.core.types import Bool, Complex128, Float64, Int32, Intrinsics
from flatcloth.flattening.sampling import (
    BENT_DEG,
    MAX_CHORD_SLOPE,
    fit_samples,
    lengths_along_surface,
    path_on_surface,
)
from flatcloth.flattening.surface import NOISELESS_STD_M, Surface

_SAME_PLACE_M = 0.0015
"""A view sees a node that lies within this plus three times the view's noise of the view's surface,
and faces as it does. Set by hand."""
_SAME_NORMAL_COS = 0.85
"""The cosine of the angle between the normals of the same cloth is at least this. Set by hand."""
INCIDENCE_LIMIT_DEG = SurfaceConfig().grazing_limit_deg
"""Cloth at a larger incidence angle adds no nodes: the usual limit of the surface."""
WELL_SEEN_DEG = 55.0
"""Cloth at a smaller incidence angle is seen well; with noisy depth, known cloth at a larger one is not
observed there. Set by hand."""
_NEW_NODE_DISTANCE = 0.65
"""A view adds nodes at this distance (in sampling intervals) from the nodes it sees. Set by hand."""
FRONTAL_NOISE = 0.4
"""Error of a pair seen frontally, as a share of the view's noise; the squared tangent of the incidence angle
is added. Set by hand."""
PAIR_INTERVALS = 1.5
"""Pairs are at most this many sampling intervals long: neighbours on the grid, and diagonals. Chosen."""
_SMOOTH_COS = 0.95
"""A pair whose normals have a smaller cosine crosses a crease, or two layers: ..."""
_CREASED_EVIDENCE = 0.25
"""... its evidence that its ends are one piece of cloth is multiplied by this. Set by hand."""


@dataclass(frozen=True, kw_only=True)
class Nodes:
    """Points of the cloth: ``xyz_m`` and unit ``normal`` (N, 3), object frame; ``weight`` (N,) of both."""

    xyz_m: Float64
    normal: Float64
    weight: Float64

    def __len__(self) -> int:
        """Return the number of nodes."""
        return len(self.xyz_m)


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """The nodes that one view sees, and the pairs between them. Two are equal only if they are the same.

    ``node`` (K,) int32 their indices; ``rc`` (K, 2) their positions in the view's (cropped) image;
    ``points_m``, ``normal`` (K, 3) camera frame; ``incidence_deg`` (K,); ``is_new`` (K,) whether
    this view added the node. ``edges`` (M, 2) int32 index these K; ``edge_length_m`` (M,) along the
    surface, ``edge_std_m`` (M,) its standard deviation; ``edge_evidence`` (M,) from 0 to 1, the
    evidence of a pair that its ends are one piece of cloth; ``offset`` (M, 2) complex, the way from the
    first end to the second in the tangent plane of each, right and down the image. ``is_noisy``: its depth
    was smoothed.
    """

    view_index: int
    node: Int32
    rc: Float64
    points_m: Float64
    normal: Float64
    incidence_deg: Float64
    is_new: Bool
    edges: Int32
    edge_length_m: Float64
    edge_std_m: Float64
    edge_evidence: Float64
    offset: Complex128
    is_noisy: bool


@dataclass(frozen=True, kw_only=True)
class PlacedView:
    """A view: its ``surface``, and the pose of its camera."""

    surface: Surface
    object_from_camera: Rigid3


@dataclass(frozen=True, kw_only=True)
class Observed:
    """The nodes of all views; what each view sees of them, and the poses of their cameras."""

    nodes: Nodes
    observations: tuple[Observation, ...]
    object_from_camera: tuple[Rigid3, ...]


@dataclass(frozen=True, kw_only=True)
class Association:
    """The nodes that a view shows: indices (K,), positions (K, 2) in its image, incidence (K,) in degrees."""

    node: Int32
    rc: Float64
    incidence_deg: Float64


def observe_all(views: Sequence[PlacedView], interval_px: int) -> Observed:
    """Observe views one after the other; a view that shows too little is left out.

    The nodes depend on the order of the views; who wants the same nodes gives the same order.
    """
    none = Nodes(xyz_m=np.zeros((0, 3)), normal=np.zeros((0, 3)), weight=np.zeros(0))
    seen = Observed(nodes=none, observations=(), object_from_camera=())
    for view in views:
        shown = associate(seen.nodes, view.surface, view.object_from_camera)
        with contextlib.suppress(SurfaceError):
            seen = with_view(seen, view, shown, interval_px)
    return seen


def with_view(seen: Observed, view: PlacedView, shown: Association, interval_px: int) -> Observed:
    """Return all views with one more, which shows the nodes ``shown``.

    Raises
    ------
    SurfaceError
        If the view shows no pair of nodes.
    """
    nodes, own = observe(seen.nodes, shown, view.surface, view.object_from_camera, interval_px)
    return Observed(
        nodes=nodes,
        observations=(*seen.observations, own),
        object_from_camera=(*seen.object_from_camera, view.object_from_camera),
    )


def associate(nodes: Nodes, surface: Surface, object_from_camera: Rigid3) -> Association:
    """Find the nodes that lie on the visible surface of a view.

    Parameters
    ----------
    nodes : Nodes
        The nodes, object frame.
    surface : Surface
        The view's surface.
    object_from_camera : Rigid3
        Pose of the view's camera.

    Returns
    -------
    Association
        The position is the foot of the node on the surface along its normal. With noise, which moves the
        surface along the view's rays, it is where the ray to the node meets the surface: the foot would
        wander along steep cloth by the noise times the sine of the incidence angle.
    """
    k = surface.frame.intrinsics
    points, normal = object_from_camera.inverse().apply_with_normal(nodes.xyz_m, nodes.normal)
    tolerance = _SAME_PLACE_M + 3.0 * surface.noise_m
    rc = project(points, k)
    for round_ in range(2):
        in_rows, in_cols = ((rc > -0.5) & (rc < np.array(surface.usable.shape) - 0.5)).T
        inside: Bool = in_rows & in_cols
        pixel = np.rint(np.where(inside[:, None], rc, 0.0)).astype(np.int32)
        seen = surface.xyz_m[pixel[:, 0], pixel[:, 1]].astype(np.float64)
        seen_normal = surface.normal[pixel[:, 0], pixel[:, 1]].astype(np.float64)
        with np.errstate(invalid="ignore"):
            above = np.einsum("ij,ij->i", seen - points, seen_normal)
            same = inside & (np.abs(above) <= tolerance)
            same &= np.einsum("ij,ij->i", seen_normal, normal) >= _SAME_NORMAL_COS
        if round_ == 0 and not surface.noisy:
            foot = points + np.where(same, above, 0.0)[:, None] * np.nan_to_num(seen_normal)
            rc = project(foot, k)
    found = np.flatnonzero(same).astype(np.int32)
    return Association(
        node=found,
        rc=rc[found],
        incidence_deg=_incidence_deg(rc[found], seen_normal[found], k),
    )


def observe(
    nodes: Nodes,
    associated: Association,
    surface: Surface,
    object_from_camera: Rigid3,
    interval_px: int,
) -> tuple[Nodes, Observation]:
    """Observe the associated nodes in a view, and add nodes where it shows other cloth.

    Returns the nodes, moved to the mean of all views' measurements, and the observation.

    Raises
    ------
    SurfaceError
        If the view shows no pair of nodes.
    """
    d = interval_px
    limit = WELL_SEEN_DEG if surface.noisy else INCIDENCE_LIMIT_DEG
    grid = np.zeros_like(surface.usable)
    grid[d // 2 :: d, d // 2 :: d] = True
    fresh = np.argwhere(grid & surface.usable).astype(np.float64)
    if len(associated.rc):
        distance, _ = cKDTree(associated.rc).query(fresh)
        fresh = fresh[distance > _NEW_NODE_DISTANCE * d]
    # Known cloth is not measured again at large incidence angles.
    steep = associated.incidence_deg > limit
    node = np.concatenate([associated.node[~steep], np.full(len(fresh), -1, dtype=np.int32)])
    rc = np.concatenate([associated.rc[~steep], fresh])
    points, normal, known = fit_samples(surface, rc)
    incidence = _incidence_deg(rc, normal, surface.frame.intrinsics)
    known &= (node >= 0) | (incidence <= INCIDENCE_LIMIT_DEG)
    rc, points, normal, incidence = (a[known] for a in (rc, points, normal, incidence))
    node = node[known]
    is_new = node < 0
    node[is_new] = len(nodes) + np.arange(int(is_new.sum()))
    edges, length, std, offset = _pairs(rc, points, normal, incidence, d, surface)
    if not len(edges):
        raise SurfaceError(
            f"View {surface.frame.view_index}: it shows no two places of cloth side by side; use another."
        )
    smooth = np.einsum("ij,ij->i", normal[edges[:, 0]], normal[edges[:, 1]]) >= _SMOOTH_COS
    evidence = np.square(NOISELESS_STD_M / std) * np.where(smooth, 1.0, _CREASED_EVIDENCE)
    observation = Observation(
        view_index=surface.frame.view_index,
        node=node,
        rc=rc,
        points_m=points,
        normal=normal,
        incidence_deg=incidence,
        is_new=is_new,
        edges=edges,
        edge_length_m=length,
        edge_std_m=std,
        edge_evidence=evidence,
        offset=offset,
        is_noisy=surface.noisy,
    )
    return averaged(nodes, observation, object_from_camera), observation


def _incidence_deg(rc: Float64, normal: Float64, k: Intrinsics) -> Float64:
    ray = np.stack([(rc[:, 1] - k.cx) / k.fx, (rc[:, 0] - k.cy) / k.fy, np.ones(len(rc))], axis=1)
    cos = -np.einsum("ij,ij->i", ray, normal) / np.sqrt(np.einsum("ij,ij->i", ray, ray))
    angle: Float64 = np.degrees(np.arccos(np.clip(cos, -1.0, 1.0)))
    return angle


def _pairs(
    rc: Float64,
    points: Float64,
    normal: Float64,
    incidence_deg: Float64,
    interval_px: int,
    surface: Surface,
) -> tuple[Int32, Float64, Float64, Complex128]:
    pixel = np.rint(rc).astype(np.int32)
    reach_px = PAIR_INTERVALS * interval_px
    edges = cKDTree(pixel).query_pairs(reach_px, output_type="ndarray").astype(np.int32)
    edges = edges[path_on_surface(surface.usable, surface.steps, pixel, edges)]
    edges, length = lengths_along_surface(edges, points, normal, MAX_CHORD_SLOPE)
    apart = length > surface.pixel_pitch_m
    edges, length = edges[apart], length[apart]
    steepness = np.tan(np.radians(np.minimum(incidence_deg, INCIDENCE_LIMIT_DEG))) ** 2
    one, other = edges.T
    noise = surface.noise_m * (FRONTAL_NOISE + 0.5 * (steepness[one] + steepness[other]))
    bent_rad = math.radians(BENT_DEG)
    offset = _offsets(edges, points, normal, np.stack(tangent_basis(normal)), length, bent_rad)
    return edges, length, np.hypot(NOISELESS_STD_M, noise), offset


@njit(cache=True, nogil=True)
def _offsets(
    edges: Int32, points: Float64, normal: Float64, tangent: Float64, length: Float64, bent_rad: float
) -> Complex128:
    """Return the position of the other end of each pair (M, 2) in the tangent plane of each end.

    Cloth between two normals that differ by more than ``bent_rad`` is unrolled as a cylinder: the
    component along its rulings is kept, the component across them takes the length of the arc. Cloth
    that is bent less has no defined ruling; there the chord is rotated into the tangent plane.
    ``tangent`` (2, N, 3) is right and down in each node's tangent plane.
    """
    offset = np.empty((len(edges), 2), dtype=np.complex128)
    for e in range(len(edges)):
        i, j = edges[e, 0], edges[e, 1]
        x, y, z = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
        rx = normal[i, 1] * normal[j, 2] - normal[i, 2] * normal[j, 1]
        ry = normal[i, 2] * normal[j, 0] - normal[i, 0] * normal[j, 2]
        rz = normal[i, 0] * normal[j, 1] - normal[i, 1] * normal[j, 0]
        sine = math.sqrt(rx * rx + ry * ry + rz * rz)
        whole = max(sine, 1e-12)
        rx, ry, rz = rx / whole, ry / whole, rz / whole
        ruled = x * rx + y * ry + z * rz
        half = 0.5 * math.asin(min(sine, 1.0))
        across = math.sqrt((x - ruled * rx) ** 2 + (y - ruled * ry) ** 2 + (z - ruled * rz) ** 2)
        arc = across * half / max(math.sin(half), 1e-12)
        bent = (2.0 * half / bent_rad) ** 2
        bent = bent / (1.0 + bent)
        for end in range(2):
            at = edges[e, end]
            nx, ny, nz = normal[at, 0], normal[at, 1], normal[at, 2]
            ax, ay, az = ry * nz - rz * ny, rz * nx - rx * nz, rx * ny - ry * nx
            unrolled = math.copysign(arc, x * ax + y * ay + z * az)
            off = x * nx + y * ny + z * nz
            fx, fy, fz = x - off * nx, y - off * ny, z - off * nz
            flat = (1.0 - bent) * length[e] / max(math.sqrt(fx * fx + fy * fy + fz * fz), 1e-12)
            px = bent * (ruled * rx + unrolled * ax) + flat * fx
            py = bent * (ruled * ry + unrolled * ay) + flat * fy
            pz = bent * (ruled * rz + unrolled * az) + flat * fz
            right = px * tangent[0, at, 0] + py * tangent[0, at, 1] + pz * tangent[0, at, 2]
            down = px * tangent[1, at, 0] + py * tangent[1, at, 1] + pz * tangent[1, at, 2]
            scale = length[e] / max(math.hypot(right, down), 1e-9)
            offset[e, end] = complex(right * scale, down * scale)
    return offset


def averaged(nodes: Nodes, observation: Observation, object_from_camera: Rigid3) -> Nodes:
    """Nodes at the weighted mean of the views' measurements; frontal views, which are best, weigh most."""
    added = int(observation.is_new.sum())
    xyz = np.concatenate([nodes.xyz_m, np.zeros((added, 3))])
    normal = np.concatenate([nodes.normal, np.zeros((added, 3))])
    weight = np.concatenate([nodes.weight, np.zeros(added)])
    object_points, object_normal = object_from_camera.apply_with_normal(
        observation.points_m, observation.normal
    )
    own = np.cos(np.radians(observation.incidence_deg))[:, None] ** 2
    at = observation.node
    before = weight[at][:, None]
    xyz[at] = (before * xyz[at] + own * object_points) / (before + own)
    mean = before * normal[at] + own * object_normal
    normal[at] = mean / np.linalg.norm(mean, axis=1)[:, None]
    weight[at] += own[:, 0]
    return Nodes(xyz_m=xyz, normal=normal, weight=weight)
