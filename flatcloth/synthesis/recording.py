"""Synthesis of a recording folder with truth from a mesh."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from flatcloth.core.errors import SynthesisError
from flatcloth.core.geometry import Rigid3, camera_from_object
from flatcloth.core.types import Bool, Float64, Intrinsics, Progress, Uint8, no_progress
from flatcloth.recordings.writer import RecordingWriter, Uint16
from flatcloth.registration.axis import THREADS
from flatcloth.synthesis.flat import FlatPanel, flatten_panel
from flatcloth.synthesis.hanging import Hung, astray, hang, share_in_image, turn, twisted
from flatcloth.synthesis.meshes import GarmentMesh, inside_out, read_mesh
from flatcloth.synthesis.panels import split_panels
from flatcloth.synthesis.rendering import MESH_COLORS, Scene, vertex_normals
from flatcloth.synthesis.request import Request
from flatcloth.synthesis.sensor import (
    COLOR_ABOVE_M,
    UNIT_M,
    aligned_color,
    exposed,
    measure_color,
    measure_depth,
    measure_stereo,
    projector,
)
from flatcloth.synthesis.textures import PATTERNS

NOISES = {
    "none": "no sensor noise",
    "d435": "D435-like sensor noise",
    "stereo": "depth matched between two rendered infrared images",
}
_CLEAN_UNIT_M = 0.0001
"""Depth unit of recordings without noise. Chosen: rounding is then a tenth of a D435's."""
_MOST_FLAT_M = 1.5
"""The range of the truth's 16 bits: twice this, in twentieths of a millimetre."""
_BESIDE_M, _NEAREST_M = 0.05, 0.25
"""A stereo sensor searches from the nearest to the farthest point of the item with this margin, but not
nearer than this. Chosen: an item that sways stays within it; a D435 measures from 0.2 to 0.3 m on."""
_FOLDED_SHARE = 0.005
"""Share of mirrored triangles from which a panel's truth is reported as unreliable. Chosen."""


def camera_of(
    size_px: tuple[int, int], focal_px: float, center_px: tuple[float, float] | None = None
) -> Intrinsics:
    """Return a camera; without a center, the principal point is the middle of the image.

    Raises
    ------
    SynthesisError
        If the values are not those of a camera.
    """
    width, height = size_px
    if not (64 <= width <= 4096 and 64 <= height <= 4096):
        raise SynthesisError(f"--size {width} {height}: choose 64 to 4096 pixels for each.")
    if not 0.2 * max(size_px) <= focal_px <= 20 * max(size_px):
        raise SynthesisError(f"--focal {focal_px:g}: impossible for {width}x{height} px. Give pixels.")
    cx, cy = center_px or ((width - 1) / 2, (height - 1) / 2)
    if not (0 <= cx < width and 0 <= cy < height):
        raise SynthesisError(f"--center {cx:g} {cy:g}: choose a point in the {width}x{height} px image.")
    return Intrinsics(width=width, height=height, fx=focal_px, fy=focal_px, cx=cx, cy=cy)


def synthesize(request: Request, progress: Progress = no_progress) -> Cell:
    """Synthesize a recording folder from a mesh; return the item, which has warnings for the user.

    Raises
    ------
    SynthesisError
        If the mesh cannot be read, hung or flattened, or an option does not match it.
    RecordingError
        If the folder is not empty or cannot be written.

    Notes
    -----
    It takes about 0.5 s per view of 480x848 px with noise, two thirds for noise and PNG files.
    """
    item = Cell(request, progress=progress)
    turning = turn(item.hung, request, np.random.default_rng([request.seed, 1]))
    recorded_deg, count = turning.recorded_angles_deg, len(request.angles_deg)
    is_at_the_top = request.held is None and request.held_vertex is None
    described = [
        f"synthetic, from the mesh {request.mesh.name}, {NOISES[request.noise]}",
        "angles and axis recorded with errors" if request.angle_error_deg or request.axis_error_mm else "",
        "it sways from view to view" if request.sway_mm or request.twist_deg else "",
        "exposure and white balance waver" if request.exposure_percent else "",
    ]

    def seen(n: int) -> CellView:
        points_m = twisted(item.hung, turning.twist_deg[n])
        return item.seen(turning.camera_from_view0[n], points_m, np.random.default_rng([request.seed, 2, n]))

    with (
        RecordingWriter(
            request.out,
            name=request.name or request.out.resolve().name,
            description=", ".join(filter(None, described)),
            intrinsics=item.intrinsics,
            depth_scale_m=item.depth_scale_m,
            rotation_axis=turning.recorded_axis,
            held_point_m=np.round(item.hung.held_point_m, 4),
            truth_header={
                "garment": request.mesh.name.partition(".")[0],
                "held_at": "highest point" if is_at_the_top else "chosen point",
                "panel_of_interest": item.panel_of_interest,
            },
        ) as writer,
        ThreadPoolExecutor(THREADS) as pool,
    ):
        for first in range(0, count, THREADS):  # not all at once: that would fill the memory
            numbers = range(first, min(first + THREADS, count))
            for n, view in zip(numbers, pool.map(seen, numbers), strict=True):
                progress(n / count, f"view {n + 1} of {count}")
                writer.add(recorded_deg[n], view.color, view.depth_units, view.mask, view.truth_bgr)
    return item


@dataclass(frozen=True, kw_only=True)
class CellView:
    """What the camera delivers of an item.

    ``color`` (H, W, 3) uint8 RGB; ``depth_units`` (H, W) uint16; ``mask`` (H, W) True on the outer face of
    the panel of interest; ``truth_bgr`` (H, W, 3) uint16, as the recording format describes.
    """

    color: Uint8
    depth_units: Uint16
    mask: Bool
    truth_bgr: Uint16


class Cell:
    """A mesh that hangs on a simulated turntable, before its camera and sensor.

    ``points_m`` (N, 3) are its vertices at 0 degrees, camera frame; ``warnings`` are for the user.

    Parameters
    ----------
    request : Request
        The mesh, its panel of interest, the camera and the noise.
    start_deg : float
        How the item is turned when the cell stands at 0 degrees.
    most_seen : bool
        The panel of interest is the one, 1 or 2, whose outer face covers more pixels of four views round the
        item, not that of the request.
    progress : callable
        Called with the progress of opening it.

    Raises
    ------
    SynthesisError
        If the mesh cannot be read, hung or flattened, or an option does not match it.
    """

    def __init__(
        self,
        request: Request,
        start_deg: float = 0.0,
        *,
        most_seen: bool = False,
        progress: Progress = no_progress,
    ) -> None:
        _check(request)
        self.request, self._start_deg = request, start_deg
        self.name = f"cell with {request.mesh.name.partition('.')[0]}"
        self.intrinsics = camera_of(request.size_px, request.focal_px, request.center_px)
        mesh = read_mesh(request.mesh, with_images=request.texture in (None, MESH_COLORS))
        if request.inside_out:
            mesh = inside_out(mesh)
        try:
            self.hung = hung = hang(mesh.vertices, request)
            progress(0.0, "flattening the truth")
            self.panels = _flat_panels(mesh, hung)
        except SynthesisError as error:
            raise SynthesisError(f"{request.mesh}: {error}") from error
        self.axis, self.held_point_m, self.points_m = hung.axis, hung.held_point_m, hung.points_m
        texture = request.texture or (MESH_COLORS if mesh.has_colors else PATTERNS[0])
        if texture == MESH_COLORS and not mesh.has_colors:
            why = f" ({'; '.join(mesh.notes)})" if mesh.notes else ""
            raise SynthesisError(
                f"{request.mesh}: has no colors{why}. Choose --texture {', '.join(PATTERNS)}."
            )
        self.panel_of_interest = _panel_number(request.panel, self.panels)
        self.warnings = [f"{note}: its colors may be others." for note in mesh.notes]
        self.warnings += _warnings(hung, self.panels, self.intrinsics)
        self.normals = vertex_normals(hung.points_m, mesh.triangles)  # as it hangs, not swaying
        self.scene = Scene(mesh, self.panels, texture, request.seed)
        self.depth_scale_m = _CLEAN_UNIT_M if request.noise == "none" else UNIT_M
        self._dots = projector(request.seed)
        offset_m = hung.points_m - hung.held_point_m
        reach_m = float(np.hypot(offset_m[:, 0], offset_m[:, 2]).max()) + _BESIDE_M
        self._range_m = (max(request.distance_m - reach_m, _NEAREST_M), request.distance_m + reach_m)
        if most_seen:
            pixels = np.zeros(2)
            for angle_deg in (0.0, 90.0, 180.0, 270.0):
                turned = camera_from_object(self.axis, angle_deg)
                placed = turned.apply_with_normal(hung.points_m, self.normals)
                view = self.scene.view(self.intrinsics, *placed)
                pixels += [(view.outer & (view.panel == panel)).sum() for panel in (1, 2)]
            self.panel_of_interest = int(pixels.argmax()) + 1

    def look(self, angle_deg: float, number: int) -> CellView:
        """Turn the item to an angle, as a recording's, and return what the camera sees; it takes about 0.5 s.

        The noise, the sway and the error of the turntable depend on the ``number`` of the look. The same
        request, angle and number give the same pictures, so that a loop that was killed goes on as if it had
        not been.

        Raises
        ------
        SynthesisError
            If the item is not in the image.
        """
        seed = self.request.seed
        sway, error_deg = astray(self.hung, self.request, np.random.default_rng([seed, 1, number]))
        pose = sway @ camera_from_object(self.axis, self._start_deg + angle_deg + error_deg)
        return self.seen(pose, self.points_m, np.random.default_rng([seed, 2, number]))

    def seen(self, pose: Rigid3, points_m: Float64, random: np.random.Generator) -> CellView:
        """Return what the camera sees of the vertices (N, 3), moved from where they hang into a pose.

        Raises
        ------
        SynthesisError
            If the item is not in the image.
        """
        camera, noise = self.intrinsics, self.request.noise
        points_m, normals = pose.apply_with_normal(points_m, self.normals)
        view = self.scene.view(camera, points_m, normals)
        if not view.depth_m.any():
            raise SynthesisError(
                f"{self.request.mesh}: the item is not in the image. Choose another --distance or --scale."
            )
        depth_m, rgb = view.depth_m, view.rgb
        if noise == "d435":
            depth_m = measure_depth(depth_m, camera.fx, random)
        elif noise == "stereo":
            depth_m = measure_stereo(self.scene, camera, points_m, normals, self._dots, self._range_m, random)
            rgb = self.scene.view(camera, points_m + np.array([0.0, COLOR_ABOVE_M, 0.0]), normals).rgb
        rgb = rgb if noise == "none" else measure_color(rgb, random)
        rgb = exposed(rgb, self.request.exposure_percent / 100, random)
        units = np.rint(depth_m / self.depth_scale_m).astype(np.uint16)
        return CellView(
            color=aligned_color(rgb, depth_m, camera) if noise == "stereo" else rgb,
            depth_units=units,
            mask=(view.panel == self.panel_of_interest) & view.outer & (units > 0),
            truth_bgr=view.truth_bgr(),
        )


def _check(request: Request) -> None:
    for value, name, low, high in (
        (request.distance_m, "--distance", 0.2, 5.0),
        (request.step_deg, "--step", 1.0, 90.0),
        (request.scale, "--scale", 1e-6, 1e6),
        (request.angle_error_deg, "--angle-error", 0.0, 10.0),
        (request.axis_error_mm, "--axis-error", 0.0, 100.0),
        (request.sway_mm, "--sway", 0.0, 100.0),
        (request.twist_deg, "--twist", 0.0, 10.0),
        (request.exposure_percent, "--exposure", 0.0, 50.0),
    ):
        if not low <= value <= high:
            raise SynthesisError(f"{name} {value:g}: choose a number from {low:g} to {high:g}.")
    if isinstance(request.texture, str) and request.texture not in (MESH_COLORS, *PATTERNS):
        raise SynthesisError(
            f"--texture {request.texture}: unknown. Choose {', '.join((*PATTERNS, MESH_COLORS))}."
        )
    if request.seed < 0:
        raise SynthesisError(f"--seed {request.seed}: choose a number from 0.")


def _flat_panels(mesh: GarmentMesh, hung: Hung) -> tuple[FlatPanel, ...]:
    panels = []
    for name, members in split_panels(mesh):
        if len(members) == 0:
            raise SynthesisError(f"The mesh has no group named {name}. Name both sides, front and back.")
        panel = flatten_panel(name, members, hung.points_m, mesh.triangles, mesh.corner_uv)
        if np.abs(panel.corner_uv_m).max() > _MOST_FLAT_M:
            raise SynthesisError(
                f"Panel {name} is over {2 * _MOST_FLAT_M:g} m large when flat, more than the truth of "
                "a recording can store. Check --scale, or split the panel."
            )
        panels.append(panel)
    return tuple(panels)


def _panel_number(wanted: str, panels: tuple[FlatPanel, ...]) -> int:
    names = [panel.name for panel in panels[:2]]  # the format allows only two
    for number, name in enumerate(names, start=1):
        if wanted in (name, str(number)):
            return number
    offered = [f"{i} ({name})" for i, name in enumerate(names, start=1)]
    raise SynthesisError(f"--panel {wanted}: not a side of this mesh. Choose {' or '.join(offered)}.")


def _warnings(hung: Hung, panels: tuple[FlatPanel, ...], camera: Intrinsics) -> list[str]:
    found = []
    shown = share_in_image(hung, camera)
    if shown < 0.999:
        found.append(
            f"{1 - shown:.1%} of the item leaves the image in some views: choose a larger --distance."
        )
    found += [
        f"{panel.name}: {panel.flipped_share:.1%} of it is folded on the plane; its truth is unreliable "
        "there. Give the mesh groups front and back, or pattern coordinates."
        for panel in panels
        if panel.flipped_share > _FOLDED_SHARE
    ]
    return found
