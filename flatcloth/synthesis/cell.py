"""A simulated robot cell: a mesh hangs from a turntable before a depth camera, rendered at any angle."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flatcloth.core.errors import SynthesisError
from flatcloth.core.geometry import Rigid3, camera_from_object
from flatcloth.core.types import Bool, Float64, Intrinsics, RotationAxis, Uint8
from flatcloth.recordings.writer import Uint16
from flatcloth.synthesis.hanging import swung
from flatcloth.synthesis.recording import HungItem, Request, depth_unit_m, hung_item, sensor_of, truth_header


@dataclass(frozen=True, kw_only=True)
class CellView:
    """What the camera of a cell delivers at an angle.

    ``color`` (H, W, 3) uint8 RGB; ``depth_units`` (H, W) uint16; ``mask`` (H, W) True on the outer face of
    the panel of interest; ``truth_bgr`` (H, W, 3) uint16, as the recording format describes.
    """

    angle_deg: float
    color: Uint8
    depth_units: Uint16
    mask: Bool
    truth_bgr: Uint16


class Cell:
    """A mesh on a simulated turntable; see the command ``active --cell``.

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

    def __init__(
        self,
        request: Request,
        start_deg: float = 0.0,
        *,
        most_seen: bool = False,
    ) -> None:
        self._request, self._start_deg = request, start_deg
        self._item = hung_item(request)
        if most_seen:
            self._item = replace(self._item, panel_of_interest=_most_seen(self._item, request.camera))
        self._look = sensor_of(request, self._item)
        self.name = f"cell with {request.mesh.name.partition('.')[0]}"
        self.intrinsics: Intrinsics = request.camera
        self.depth_scale_m = depth_unit_m(request)
        self.axis: RotationAxis = self._item.hung.axis
        self.held_point_m: Float64 = self._item.hung.held_point_m
        self.truth_header = truth_header(request, self._item)

    @property
    def points_m(self) -> Float64:
        """The vertices (N, 3) of the mesh as they hang at the start angle 0, camera frame; for evaluation."""
        return self._item.hung.points_m

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
        request = self._request
        random = np.random.default_rng([request.seed, 2, number])
        view, depth, rgb = self._look(self._pose(angle_deg, number), None, random)
        if not view.depth_m.any():
            raise SynthesisError(f"{request.mesh}: the item is not in the image. Choose another --distance.")
        return CellView(
            angle_deg=angle_deg,
            color=rgb,
            depth_units=depth,
            mask=(view.panel == self._item.panel_of_interest) & view.outer & (depth > 0),
            truth_bgr=view.truth_bgr(),
        )

    def _pose(self, angle_deg: float, number: int) -> Rigid3:
        """Return the pose of the item, with the sway and the error of the turntable of this look."""
        loose, hung = self._request.loose, self._item.hung
        random = np.random.default_rng([self._request.seed, 1, number])
        length = float((hung.points_m - hung.held_point_m)[:, 1].max())
        tilt = random.normal(0, loose.swing_m / length, 2)
        error = random.normal(0, loose.angle_deg)
        return swung(hung, tilt) @ camera_from_object(self.axis, self._start_deg + angle_deg + error)


def _most_seen(item: HungItem, camera: Intrinsics) -> int:
    """Return the panel, 1 or 2, whose outer face covers more pixels of four views round the item."""
    pixels = np.zeros(2)
    for angle_deg in (0.0, 90.0, 180.0, 270.0):
        view = item.scene.view(camera, camera_from_object(item.hung.axis, angle_deg))
        pixels += [(view.outer & (view.panel == panel)).sum() for panel in (1, 2)]
    return int(pixels.argmax()) + 1
