"""Hanging a mesh in front of the camera: unit, upward axis, held point, and the pose of every view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from flatcloth.core.errors import SynthesisError
from flatcloth.core.geometry import Rigid3, camera_from_object, rotation_about
from flatcloth.core.types import Float64, Intrinsics, RotationAxis
from flatcloth.recordings.base import apart_deg
from flatcloth.synthesis.meshes import suffix_of
from flatcloth.synthesis.request import Request

_EXTENT_M = (0.05, 4.0)
"""Sizes of garments, from a sock to a bedsheet. Chosen; others are meshes in another unit."""


@dataclass(frozen=True, kw_only=True)
class Hung:
    """A hung mesh: ``points_m`` (N, 3) in the camera frame of view 0, and the true turning axis."""

    points_m: Float64
    held_point_m: Float64
    axis: RotationAxis


@dataclass(frozen=True, kw_only=True)
class Turning:
    """The views: true poses ``camera_from_view0``, twists, and the recorded angles and axis."""

    camera_from_view0: tuple[Rigid3, ...]
    twist_deg: tuple[float, ...]
    recorded_angles_deg: tuple[float, ...]
    recorded_axis: RotationAxis


def hang(vertices: Float64, request: Request) -> Hung:
    """Place the vertices (N, 3) of a file so that the held point is on the axis and the item in the middle.

    ``balance`` of the request turns them rigidly so that their centroid is below the held point; otherwise
    the item keeps the pose of its file.

    Raises
    ------
    SynthesisError
        If the size is not that of a garment, the vertex does not exist, or the held point is not on top.
    """
    extent = float(np.ptp(vertices, axis=0).max()) * request.scale
    if not _EXTENT_M[0] <= extent <= _EXTENT_M[1]:
        raise SynthesisError(
            f"The mesh is {extent:g} m large, a garment has {_EXTENT_M[0]:g} to {_EXTENT_M[1]:g} m. "
            "Give the metres per unit of the file, for example --scale 0.001 for millimetres."
        )
    up = request.up or ("y" if suffix_of(request.mesh) in (".glb", ".gltf") else "z")
    camera_from_file = _camera_axes(up)
    points = vertices @ camera_from_file.T * request.scale
    points = points - _held_point(points, request, camera_from_file * request.scale)
    middle = points.mean(axis=0)
    if request.balance and np.linalg.norm(middle) >= 1e-9:  # the smallest rotation that does it
        points = points @ Rotation.align_vectors(np.array([0.0, 1.0, 0.0]), middle)[0].as_matrix().T
    height = float(points[:, 1].max())  # y is down
    if height < 0.2 * extent:
        raise SynthesisError(
            f"The item extends only {1e3 * height:.0f} mm below the held point. "
            "Choose the upward axis with --up, or rotate the mesh below its held point with --balance."
        )
    held_m = np.array([0.0, round(-height / 2, 4), request.distance_m])
    return Hung(
        points_m=points + held_m,
        held_point_m=held_m,
        axis=RotationAxis(point_m=held_m, direction=np.array([0.0, -1.0, 0.0])),
    )


def turn(hung: Hung, request: Request, random: np.random.Generator) -> Turning:
    """Return the true pose of each view, and the recorded angles and axis."""
    poses, recorded = [], []
    for n, angle in enumerate(request.angles_deg):
        sway, error_deg = astray(hung, request, random) if n > 0 else (Rigid3(np.eye(3), np.zeros(3)), 0.0)
        poses.append(sway @ camera_from_object(hung.axis, angle))
        recorded.append(round(angle + error_deg, 2))
    off = np.array([*random.normal(0, request.axis_error_mm / 1e3, 2), 0.0])[[0, 2, 1]]
    twists = [0.0, *random.normal(0, request.twist_deg, len(poses) - 1)]
    return Turning(
        camera_from_view0=tuple(poses),
        twist_deg=tuple(twists),
        recorded_angles_deg=_apart(recorded),
        recorded_axis=RotationAxis(
            point_m=np.round(hung.axis.point_m + off, 4), direction=hung.axis.direction
        ),
    )


def astray(hung: Hung, request: Request, random: np.random.Generator) -> tuple[Rigid3, float]:
    """Return how an item swings about its held point in one view, and the error of its angle, degrees."""
    length = float((hung.points_m - hung.held_point_m)[:, 1].max())
    sideways, deep = random.normal(0, request.sway_mm / 1e3 / length, 2)
    swing = rotation_about(np.array([0, 0, 1.0]), sideways) @ rotation_about(np.array([1.0, 0, 0]), deep)
    return Rigid3(swing, hung.held_point_m - swing @ hung.held_point_m), random.normal(
        0, request.angle_error_deg
    )


def twisted(hung: Hung, twist_deg: float) -> Float64:
    """Return the vertices (N, 3) of an item that lags in twist: the lowest one by so much, others by less."""
    offset = hung.points_m - hung.held_point_m
    about = np.radians(twist_deg) * offset[:, 1] / offset[:, 1].max()
    x, y, z = offset.T
    cos, sin = np.cos(about), np.sin(about)
    turned = np.stack([cos * x + sin * z, y, cos * z - sin * x], axis=1)
    points: Float64 = hung.points_m + (turned - offset)
    return points


def share_in_image(hung: Hung, camera: Intrinsics) -> float:
    """Return the share of the vertices that are in the image in every view of a full turn."""
    offset = hung.points_m - hung.held_point_m
    radius = np.hypot(offset[:, 0], offset[:, 2])
    depth = hung.held_point_m[2] - radius  # nearest to the camera
    row = camera.fy * hung.points_m[:, 1] / np.maximum(depth, 1e-6) + camera.cy
    radius_px = camera.fx * radius / hung.held_point_m[2]
    inside = (depth > 0.05) & (row >= 0) & (row < camera.height)
    inside &= (camera.cx - radius_px >= 0) & (camera.cx + radius_px < camera.width)
    return float(inside.mean())


def _camera_axes(up: str) -> Float64:
    """Return the rotation (3, 3) camera-from-file: y points down, against the file's upward axis."""
    place = "xyz".index(up[-1])
    right, down = np.eye(3)[place - 1], np.eye(3)[place] * (1.0 if up[0] == "-" else -1.0)
    return np.stack([right, down, np.cross(right, down)])


def _held_point(points: Float64, request: Request, camera_from_file: Float64) -> Float64:
    if request.held is None:
        vertex = int(points[:, 1].argmin()) if request.held_vertex is None else request.held_vertex
        if not 0 <= vertex < len(points):
            raise SynthesisError(
                f"--held-vertex {vertex}: the mesh has vertices 0 to {len(points) - 1}. Choose one of them."
            )
        return np.asarray(points[vertex])
    point: Float64 = camera_from_file @ np.asarray(request.held, dtype=np.float64)
    nearest = float(np.linalg.norm(points - point, axis=1).min())
    if not nearest <= 0.1:  # also if it is no number
        raise SynthesisError(
            f"--held: the mesh is {1e3 * nearest:.0f} mm away from that point. "
            "Give it in the file's frame and unit."
        )
    return point


def _apart(angles_deg: list[float]) -> tuple[float, ...]:
    """Change recorded angles that coincide by a hundredth of a degree, as a recording needs distinct ones."""
    taken: list[float] = []
    for angle in angles_deg:
        moved = angle
        while any(apart_deg(moved, other) < 0.015 for other in taken):
            moved = round(moved + 0.02, 2)
        taken.append(moved)
    return tuple(taken)
