"""Simulated cells with the nine meshes: their views, each rendered once, and the truth about named points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial import cKDTree

from benchmarks.inputs import Remembered
from benchmarks.output import say
from flatcloth.active.incoming import SeenView
from flatcloth.core.geometry import back_project, camera_from_object, fit_rigid2, object_from_camera
from flatcloth.engine.evaluation import read_true_points
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import Truth
from flatcloth.recordings.writer import DEPTH_SCALE_M, depth_units
from flatcloth.synthesis.meshes import read_mesh
from flatcloth.synthesis.recording import Cell
from flatcloth.synthesis.request import Request

SEEN_M = 0.012
"""A point is visible by truth if a pixel of its panel is as near. Chosen: the error of a named point."""
OUTER_FACE = 16
"""Of the truth of a pixel: it is seen from outside (docs/datasets.md)."""
_THINNED = 20
"""Of so many points one tells how the mesh is turned. Chosen for speed."""


class Views:
    """The views of a mesh at any whole angle, each rendered once and kept in a folder."""

    def __init__(self, mesh: Path, folder: Path, sensor: str) -> None:
        self.mesh, self._folder = mesh, folder
        folder.mkdir(parents=True, exist_ok=True)
        self.cell = Cell(
            Request(mesh=mesh, out=Path(), panel="1", texture="floral", noise=sensor, sway_mm=2.0)
        )

    def at(self, panel: int, start_deg: float, angle_deg: float) -> SeenView:
        """Return the view of a panel at an angle after the start angle."""
        turned = round(start_deg + angle_deg) % 360
        color, depth, faces = (self._folder / f"{turned}-{name}.png" for name in ("color", "depth", "face"))
        if not faces.exists():
            seen = self.cell.look(float(turned), turned)
            cv2.imwrite(str(color), seen.color[..., ::-1])
            cv2.imwrite(str(depth), depth_units(seen.depth_units * np.float32(self.cell.depth_scale_m)))
            cv2.imwrite(str(faces), seen.truth_bgr[..., 0].astype(np.uint8))
        depth_m = cv2.imread(str(depth), cv2.IMREAD_UNCHANGED) * np.float32(DEPTH_SCALE_M)
        return SeenView(
            angle_deg=angle_deg,
            color=np.ascontiguousarray(cv2.imread(str(color))[..., ::-1]),
            depth_m=depth_m,
            intrinsics=self.cell.intrinsics,
            mask=(cv2.imread(str(faces), cv2.IMREAD_UNCHANGED) == panel + OUTER_FACE) & (depth_m > 0),
            axis=self.cell.axis,
            held_point_m=self.cell.held_point_m,
        )


def true_points(views: Views, recorded: str, panel: int) -> list[dict[str, Any]]:
    """Return the true places of the named points on the mesh, object frame at start 0, and which are seen.

    The recording's truth says where a point lies on its flat panel; the pattern coordinates of the mesh lead
    from there to a vertex. As seen from outside of the other panel, left and right are exchanged.
    """
    recording, truth = Remembered(open_recording(recorded)), Truth(recorded)
    named = read_true_points(Path(recording.location))
    assert named is not None
    cell, mesh, vertices = views.cell, read_mesh(views.mesh), views.cell.points_m
    own = truth.panel_of_interest
    members = mesh.group == [name.lower() for name in mesh.group_names].index("front" if own == 1 else "back")
    corner = mesh.triangles[members].ravel()
    assert mesh.corner_uv is not None
    pattern = mesh.corner_uv[members].reshape(-1, 2) * (1.0, -1.0)
    seen_xyz, seen_uv = [], []
    for n in range(0, len(recording), 3):
        frame, true = recording[n], truth[n]
        shown = (true.panel == own) & true.outer_face & (frame.depth_m > 0)
        held = object_from_camera(recording.rotation_axis, frame.angle_deg)
        seen_xyz.append(held.apply(back_project(frame.depth_m, frame.intrinsics)[shown][::20].astype(float)))
        seen_uv.append(true.flat_uv_m[shown][::20].astype(float))
    xyz, flat_uv = np.concatenate(seen_xyz), np.concatenate(seen_uv)
    tree = cKDTree(vertices[corner])
    turns = [camera_from_object(cell.axis, angle) for angle in np.arange(0.0, 360.0, 5.0)]
    turn = min(turns, key=lambda each: float(np.median(tree.query(each.apply(xyz[::_THINNED]))[0])))
    off, nearest = tree.query(turn.apply(xyz))
    near = off < 0.006
    fits = []
    for mirror in (1.0, -1.0):
        flat = pattern[nearest[near]] * (mirror, 1.0)
        motion = fit_rigid2(flat, flat_uv[near])
        left = float(np.median(np.linalg.norm(motion.apply(flat) - flat_uv[near], axis=1)))
        fits.append((left, mirror, motion))
    left_m, mirror, motion = min(fits, key=lambda fit: fit[0])
    say(f"{views.mesh.stem}: pattern {1e3 * left_m:.1f} mm off the truth, mesh {1e3 * np.median(off):.1f} mm")
    placed = cKDTree(motion.apply(pattern * (mirror, 1.0)))
    places = {
        (name if own == panel else _swapped(name)): vertices[corner[placed.query(np.array(uv))[1]]].tolist()
        for name, uv in named.points_m.items()
    }
    seen = _seen(views, panel, places)
    return [{"kind": named.kind, "places": places, "seen": seen}]


def _swapped(name: str) -> str:
    for one, other in (("_left", "_right"), ("_right", "_left")):
        if name.endswith(one):
            return name.removesuffix(one) + other
    return name


def _seen(views: Views, panel: int, places: dict[str, list[float]]) -> dict[str, bool]:
    """Return which places a panel shows in any of 36 views."""
    nearest = dict.fromkeys(places, np.inf)
    for angle_deg in np.arange(0.0, 360.0, 10.0).tolist():
        view = views.at(panel, 0.0, angle_deg)
        points = back_project(view.depth_m, view.intrinsics)[view.mask].astype(float)
        if len(points):
            tree = cKDTree(object_from_camera(views.cell.axis, angle_deg).apply(points))
            for name, place in places.items():
                nearest[name] = min(nearest[name], float(tree.query(place)[0]))
    return {name: off <= SEEN_M for name, off in nearest.items()}
