"""Synthesis of a recording folder with truth from a mesh."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np

from flatcloth.core.errors import SynthesisError
from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import Float64, Intrinsics, Progress, no_progress
from flatcloth.recordings.writer import RecordingWriter
from flatcloth.registration.axis import THREADS
from flatcloth.synthesis.flat import FlatPanel, flatten_panel
from flatcloth.synthesis.hanging import Hung, PoseErrors, hang, share_in_image, turn, twisted
from flatcloth.synthesis.meshes import GarmentMesh, inside_out, read_mesh, suffix_of
from flatcloth.synthesis.panels import split_panels
from flatcloth.synthesis.rendering import MESH_COLORS, Rendered, Scene
from flatcloth.synthesis.sensor import DepthSensor, measure_color, measure_depth
from flatcloth.synthesis.stereo import Exposure, aligned_color, color_camera, measure_stereo, projector
from flatcloth.synthesis.textures import PATTERNS

_T = TypeVar("_T")
CAMERA = Intrinsics(width=480, height=848, fx=425.0, fy=425.0, cx=239.5, cy=423.5)
"""The depth camera of a D435 at 848 x 480 px, upright, 59 by 90 degrees (datasheet: 58 by 87)."""
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
_LARGEST_M = 100.0
"""A larger mesh is in another unit. Chosen."""
_FOLDED_SHARE = 0.005
"""Share of mirrored triangles from which a panel's truth is reported as unreliable. Chosen."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """The options of a synthesis; see the command ``synthesize``.

    ``up`` None: y for glTF, z for other files. ``held``: a point in the file's frame and unit, a
    vertex, or None for the highest vertex. ``panel``: the side of interest, by name or number from 1.
    ``texture`` None: the mesh's own colors if it has any, otherwise a checker.
    """

    mesh: Path
    out: Path
    name: str | None = None
    up: str | None = None
    scale: float = 1.0
    held: tuple[float, float, float] | int | None = None
    balanced: bool = False
    inside_out: bool = False
    panel: str = "1"
    texture: str | None = None
    camera: Intrinsics = CAMERA
    distance_m: float = 0.85
    step_deg: float = 10.0
    noise: str = "none"
    loose: PoseErrors = field(default_factory=PoseErrors)
    exposure: Exposure = field(default_factory=Exposure)
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class Synthesized:
    """The result: ``folder``, number of ``views``, the panels, and ``warnings`` for the user."""

    folder: Path
    views: int
    panels: tuple[FlatPanel, ...]
    panel_of_interest: int
    warnings: tuple[str, ...]


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


def synthesize(request: Request, progress: Progress = no_progress) -> Synthesized:
    """Synthesize a recording folder from a mesh.

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
    item = hung_item(request, progress)
    random = np.random.default_rng([request.seed, 1])
    angles = tuple(float(a) for a in np.arange(0, 360 - 1e-6, request.step_deg))
    turning = turn(item.hung, angles, request.loose, random)
    hung, panels, of_interest = item.hung, item.panels, item.panel_of_interest
    look = sensor_of(request, item)

    def seen(n: int) -> tuple[Rendered, np.ndarray, np.ndarray]:
        twist_deg = turning.twist_deg[n]
        points = twisted(hung, twist_deg) if twist_deg else None
        return look(turning.camera_from_view0[n], points, np.random.default_rng([request.seed, 2, n]))

    name = request.name or request.out.resolve().name
    with RecordingWriter(
        request.out,
        name=name,
        description=_description(request),
        intrinsics=request.camera,
        depth_scale_m=depth_unit_m(request),
        rotation_axis=turning.recorded_axis,
        held_point_m=np.round(hung.held_point_m, 4),
        truth_header=truth_header(request, item),
    ) as writer:
        for n, ((view, depth, rgb), angle) in enumerate(
            zip(_ahead(seen, len(angles)), turning.recorded_angles_deg, strict=True)
        ):
            progress(n / len(angles), f"view {n + 1} of {len(angles)}")
            if not view.depth_m.any():
                raise SynthesisError(
                    f"{request.mesh}: the item is not in view {n}. Choose another --distance or --scale."
                )
            mask = (view.panel == of_interest) & view.outer & (depth > 0)
            writer.add(angle, rgb, depth, mask, view.truth_bgr())
    return Synthesized(
        folder=request.out,
        views=len(angles),
        panels=panels,
        panel_of_interest=of_interest,
        warnings=(*item.notes, *_warnings(hung, panels, request.camera)),
    )


def _ahead(make: Callable[[int], _T], count: int) -> Iterator[_T]:
    """Yield what is made of each number below ``count``, in order; ``THREADS`` are made at the same time."""
    with ThreadPoolExecutor(THREADS) as pool:
        for n in range(0, count, THREADS):  # not all at once: that would fill the memory
            yield from pool.map(make, range(n, min(n + THREADS, count)))


@dataclass(frozen=True, kw_only=True)
class HungItem:
    """A mesh that hangs before the camera, ready to be rendered: its panels and the side of interest.

    ``notes`` are for the user.
    """

    hung: Hung
    panels: tuple[FlatPanel, ...]
    panel_of_interest: int
    scene: Scene
    notes: tuple[str, ...] = ()


def hung_item(request: Request, progress: Progress = no_progress) -> HungItem:
    """Read, hang and texture the mesh of a request.

    Raises
    ------
    SynthesisError
        If the mesh cannot be read, hung or flattened, or an option does not match it.
    """
    _check(request)
    mesh = read_mesh(request.mesh, with_images=request.texture in (None, MESH_COLORS))
    if request.inside_out:
        mesh = inside_out(mesh)
    up = request.up or ("y" if suffix_of(request.mesh) in (".glb", ".gltf") else "z")
    try:
        hung = hang(
            mesh.vertices,
            up=up,
            scale=request.scale,
            held=request.held,
            distance_m=request.distance_m,
            balanced=request.balanced,
        )
        progress(0.0, "flattening the truth")
        panels = _flat_panels(mesh, hung)
    except SynthesisError as error:
        raise SynthesisError(f"{request.mesh}: {error}") from error
    texture = request.texture or (MESH_COLORS if _has_colors(mesh) else PATTERNS[0])
    if texture == MESH_COLORS and not _has_colors(mesh):
        why = f" ({'; '.join(mesh.notes)})" if mesh.notes else ""
        raise SynthesisError(f"{request.mesh}: has no colors{why}. Choose --texture {', '.join(PATTERNS)}.")
    return HungItem(
        hung=hung,
        panels=panels,
        panel_of_interest=_panel_number(request.panel, panels),
        notes=tuple(f"{note}: its colors may be others." for note in mesh.notes),
        scene=Scene(mesh, hung.points_m, panels, texture, request.seed),
    )


def truth_header(request: Request, item: HungItem) -> dict[str, object]:
    """Return what ``recording.json`` says of the truth."""
    return {
        "garment": request.mesh.name.partition(".")[0],
        "held_at": "highest point" if request.held is None else "chosen point",
        "panel_of_interest": item.panel_of_interest,
    }


def depth_unit_m(request: Request) -> float:
    """Return the unit of the depth images of a request."""
    return DepthSensor().unit_m if request.noise != "none" else _CLEAN_UNIT_M


def _check(request: Request) -> None:
    for value, name, low, high in (
        (request.distance_m, "--distance", 0.2, 5.0),
        (request.step_deg, "--step", 1.0, 90.0),
        (request.scale, "--scale", 1e-6, 1e6),
        (request.loose.angle_deg, "--angle-error", 0.0, 10.0),
        (request.loose.axis_m * 1e3, "--axis-error", 0.0, 100.0),
        (request.loose.swing_m * 1e3, "--sway", 0.0, 100.0),
        (request.loose.twist_deg, "--twist", 0.0, 10.0),
        (request.exposure.share * 100, "--exposure", 0.0, 50.0),
    ):
        if not low <= value <= high:
            raise SynthesisError(f"{name} {value:g}: choose a number from {low:g} to {high:g}.")
    if request.noise not in NOISES:
        raise SynthesisError(f"--sensor {request.noise}: unknown. Choose {' or '.join(NOISES)}.")
    if request.texture not in (None, MESH_COLORS, *PATTERNS):
        raise SynthesisError(
            f"--texture {request.texture}: unknown. Choose {', '.join((*PATTERNS, MESH_COLORS))}."
        )
    if request.seed < 0:
        raise SynthesisError(f"--seed {request.seed}: choose a number from 0.")


def _flat_panels(mesh: GarmentMesh, hung: Hung) -> tuple[FlatPanel, ...]:
    panels = []
    size_m = float(np.ptp(hung.points_m, axis=0).max())
    if size_m > _LARGEST_M:
        raise SynthesisError(f"The mesh is {size_m:g} m large. Check --scale.")
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
    names = [panel.name for panel in panels]
    if wanted in names:
        number = names.index(wanted) + 1
    elif wanted.isdecimal() and 1 <= int(wanted) <= len(panels):
        number = int(wanted)
    else:
        number = 0
    if number not in (1, 2):  # the format allows only two panels
        offered = [f"{i} ({name})" for i, name in enumerate(names[:2], start=1)]
        raise SynthesisError(f"--panel {wanted}: not a side of this mesh. Choose {' or '.join(offered)}.")
    return number


Look = Callable[[Rigid3, Float64 | None, np.random.Generator], tuple[Rendered, np.ndarray, np.ndarray]]
"""From a pose camera-from-points, and vertices (N, 3) if they are not at rest: a rendered view, what is
measured of its depth (H, W), in units, and of its color (H, W, 3)."""


def sensor_of(request: Request, item: HungItem) -> Look:
    """Return what looks at an item with the sensor of a request."""
    sensor, camera, scene = DepthSensor(), request.camera, item.scene
    dots = projector(sensor.baseline_m, request.seed) if request.noise == "stereo" else None
    offset_m = item.hung.points_m - item.hung.held_point_m
    reach_m = float(np.hypot(offset_m[:, 0], offset_m[:, 2]).max()) + _BESIDE_M
    range_m = (max(request.distance_m - reach_m, _NEAREST_M), request.distance_m + reach_m)

    def look(
        pose: Rigid3, points_m: Float64 | None, random: np.random.Generator
    ) -> tuple[Rendered, np.ndarray, np.ndarray]:
        view = scene.view(camera, pose, points_m)
        if request.noise == "none":
            rgb = request.exposure.apply(view.rgb, random)
            return view, np.rint(view.depth_m / _CLEAN_UNIT_M).astype(np.uint16), rgb
        if dots is None:
            depth_m = measure_depth(view.depth_m, camera.fx, random, sensor)
            rgb = request.exposure.apply(measure_color(view.rgb, random), random)
        else:
            depth_m = measure_stereo(scene, camera, pose, points_m, dots, range_m, random, sensor)
            above = scene.view(camera, color_camera() @ pose, points_m).rgb
            rgb = request.exposure.apply(measure_color(above, random), random)
            rgb = aligned_color(rgb, depth_m, camera)
        return view, np.rint(depth_m / sensor.unit_m).astype(np.uint16), rgb

    return look


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


def _description(request: Request) -> str:
    loose, moves = request.loose, request.loose.swing_m or request.loose.twist_deg
    more = [
        "angles and axis recorded with errors" if loose.angle_deg or loose.axis_m else "",
        "it sways from view to view" if moves else "",
        "exposure and white balance waver" if request.exposure.share else "",
    ]
    parts = ["synthetic", f"from the mesh {request.mesh.name}", NOISES[request.noise], *filter(None, more)]
    return ", ".join(parts)


def _has_colors(mesh: GarmentMesh) -> bool:
    return mesh.image is not None or mesh.vertex_rgb is not None
