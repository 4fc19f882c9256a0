"""A simulated robot cell: a mesh hangs from a turntable before a depth camera, rendered at any angle."""

from __future__ import annotations

import numpy as np

from flatcloth.core.geometry import camera_from_object
from flatcloth.core.types import Float64, Intrinsics, RotationAxis
from flatcloth.synthesis.hanging import astray
from flatcloth.synthesis.recording import CellView, HungItem, Request


class Cell:
    """A mesh on a simulated turntable; see the command ``active --cell``.

    ``points_m`` are its vertices (N, 3) as they hang at the start angle 0, camera frame; for evaluation.

    Parameters
    ----------
    request : Request
        The mesh, its panel of interest, the camera and the noise. ``loose.swing_m`` sways the item at
        random for each view, ``loose.angle_deg`` is the error of the turntable; ``out`` and ``step_deg`` are
        not used.
    start_deg : float
        How the item is turned when the cell stands at 0 degrees.
    most_seen : bool
        The panel of interest is the one that shows most of its outer face, not that of the request.

    Raises
    ------
    SynthesisError
        If the mesh cannot be read or hung, or an option does not match it.

    Notes
    -----
    A look takes about 0.5 s for 480x848 px. The same request, angle and number of the look give the same
    pictures, so that a loop that was killed goes on as if it had not been.
    """

    def __init__(self, request: Request, start_deg: float = 0.0, *, most_seen: bool = False) -> None:
        self._request, self._start_deg = request, start_deg
        self._item = HungItem(request)
        if most_seen:
            self._item.panel_of_interest = _most_seen(self._item, request.camera)
        self.name = f"cell with {request.mesh.name.partition('.')[0]}"
        self.intrinsics: Intrinsics = request.camera
        self.depth_scale_m = self._item.depth_unit_m
        self.axis: RotationAxis = self._item.hung.axis
        self.held_point_m: Float64 = self._item.hung.held_point_m
        self.points_m: Float64 = self._item.hung.points_m

    def look(self, angle_deg: float, number: int) -> CellView:
        """Turn the item to an angle, and return what the camera sees.

        Parameters
        ----------
        angle_deg : float
            As a recording's angles, from 0 where the cell started.
        number : int
            The number of the look; the noise and the sway depend on it.

        Raises
        ------
        SynthesisError
            If the item is not in the image.
        """
        seed, hung = self._request.seed, self._item.hung
        sway, error_deg = astray(hung, self._request.loose, np.random.default_rng([seed, 1, number]))
        pose = sway @ camera_from_object(self.axis, self._start_deg + angle_deg + error_deg)
        return self._item.look(pose, hung.points_m, np.random.default_rng([seed, 2, number]))


def _most_seen(item: HungItem, camera: Intrinsics) -> int:
    """Return the panel, 1 or 2, whose outer face covers more pixels of four views round the item."""
    pixels = np.zeros(2)
    for angle_deg in (0.0, 90.0, 180.0, 270.0):
        pose = camera_from_object(item.hung.axis, angle_deg)
        view = item.scene.view(camera, *pose.apply_with_normal(item.hung.points_m, item.normals))
        pixels += [(view.outer & (view.panel == panel)).sum() for panel in (1, 2)]
    return int(pixels.argmax()) + 1
