"""The growth of the shape as an animation: the item turns, and each accepted view extends its shape."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.core.geometry import camera_from_object, wrapped_deg
from flatcloth.core.types import FlattenedView, Float64, Uint8
from flatcloth.export.growth import Growth, Step
from flatcloth.export.session import OpenedSession
from flatcloth.rendering.drawing import BLUE, GRID, SOFT, figure_of, show_picture, style
from flatcloth.rendering.pictures import (
    NEW_RGB,
    PlanePicture,
    camera_around,
    cropped,
    paint_points,
    side_by_side,
)

_WIDTH, _HEIGHT, _FOOT, _PANE = 880, 500, 62, 400
"""Layout (px): image, foot, and the pane of the cloud. Chosen."""
_MOST_TURNING = 72
"""Most frames in which the item turns, shared by all turns. Chosen for the size of the file."""
_TURN_FRAMES, _HELD, _LAST = 6, 5, 15
"""Most frames of a turn, and for how many frames results and the last one are shown. Chosen."""
_FPS = 6
"""Frames a second of the film. Chosen: VP9 takes a tenth of a second for each."""
_POINT_M = 0.0022
"""Size of a drawn point. Chosen: about the distance of neighbours, so that the cloud looks closed."""
_BEHIND_M = 0.006
"""Points this far behind the nearest are hidden. Chosen: above the noise of a D435."""
Scene = tuple[Float64, Uint8, Float64]
"""Points in space (N, 3), their colors (N, 3), and how far behind they count (N,), m."""


def mp4_of(session: OpenedSession) -> bytes:
    """Return the animation as MP4: VP9 if OpenCV writes it, because browsers play it, otherwise MPEG-4.

    Raises
    ------
    FlatclothError
        If OpenCV cannot write MP4, or no folder for its file is writable.
    """
    import cv2

    no_folder = os_errors_as(FlatclothError, "No folder for the animation", "Set TMPDIR to a writable one.")
    with no_folder, tempfile.TemporaryDirectory(prefix="flatcloth-") as folder:
        path = Path(folder) / "growth.mp4"  # OpenCV writes to a name only
        for code in ("vp09", "mp4v"):
            kind = cv2.VideoWriter.fourcc(*code)
            writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, kind, float(_FPS), (_WIDTH, _HEIGHT))
            if writer.isOpened():
                break
        else:
            raise FlatclothError(
                "OpenCV cannot write MP4: pip install --force-reinstall opencv-python-headless"
            )
        try:
            for image, count in frames(session):
                for _ in range(count):
                    writer.write(np.ascontiguousarray(image[..., ::-1]))
        finally:
            writer.release()
        return path.read_bytes()


def frames(session: OpenedSession) -> Iterator[tuple[Uint8, int]]:
    """Yield the pictures (H, W, 3) in order, and for how many frames each is shown."""
    growth, integration, other = session.growth, session.integration, session.view_of("other")
    view, steps = growth.view, growth.steps
    camera = camera_around(view.xyz_m[view.valid], integration.axis, _PANE, _HEIGHT - _FOOT)

    def painted(page: Uint8, scene: Scene, angle_deg: float) -> Uint8:
        image, (points_m, rgb, behind_m) = page.copy(), scene
        seen_m = camera_from_object(integration.axis, angle_deg).apply(points_m)
        paint_points(image[: camera.height], camera, seen_m, rgb, behind_m, size_m=_POINT_M)
        return image

    def drawn(step: Step, order: int, *, tinted: bool = False) -> tuple[Uint8, Scene]:
        shape = _shape(growth, order, tinted=tinted)
        return _page(cropped(shape, view), growth, step, order), _scene(session, steps[order], shape)

    turn_frames = max(1, min(_TURN_FRAMES, _MOST_TURNING // len(steps)))
    for before, step in zip((None, *steps), steps, strict=False):
        session.progress(step.order / len(steps), f"painting step {step.order + 1} of {len(steps)}")
        if before is not None:
            page, scene = drawn(step, before.order)
            turn_deg = wrapped_deg(step.angle_deg - before.angle_deg)
            for n in range(1, turn_frames + 1):
                share = n / (turn_frames + 1)
                eased = share * share * (3 - 2 * share)
                yield painted(page, scene, before.angle_deg + eased * turn_deg), 1
        yield painted(*drawn(step, step.order, tinted=True), step.angle_deg), _HELD
    yield painted(*drawn(step, step.order), step.angle_deg), _LAST
    if other is not None:
        said = "Both sides, each from its own outside"
        page = _page(side_by_side(view, other)[0], growth, step, step.order, said)
        scene = _scene(session, step, _shape(growth, step.order), other)
        yield painted(page, scene, step.angle_deg), _LAST


def _shape(growth: Growth, order: int, *, tinted: bool = False) -> Uint8:
    """Return the shape after a step as a picture (H, W, 4), with what the step added tinted."""
    alpha = np.where(growth.shown_after(order), 255, 0).astype(np.uint8)
    rgba = np.dstack([growth.view.rgb, alpha])
    if tinted:
        new = growth.first_step == order
        rgba[new, :3] = 0.5 * rgba[new, :3] + 0.5 * np.array(NEW_RGB)
    return rgba


def _scene(session: OpenedSession, step: Step, shape: Uint8, other: FlattenedView | None = None) -> Scene:
    """Return a step's view in pale colors, and a picture of the shape and the other side, in space."""
    cloud, shown = session.integration.views.cloud(step.view_index), shape[..., 3] > 0
    xyz = [cloud.xyz_m, session.growth.view.xyz_m[shown]]
    colors = [(0.25 * cloud.rgb + 0.75 * 205.0).astype(np.uint8), shape[shown, :3]]
    if other is not None:
        xyz, colors = [*xyz, other.xyz_m[other.valid]], [*colors, other.rgb[other.valid]]
    points = np.concatenate(xyz).astype(np.float64)
    behind_m = np.where(np.arange(len(points)) < len(cloud.xyz_m), _BEHIND_M, 0.0)
    return points, np.concatenate(colors), behind_m


@style()
def _page(picture: PlanePicture, growth: Growth, step: Step, order: int, told: str = "") -> Uint8:
    """Paint a picture of the plane into the right pane, with its scale, and the foot below both panes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    count, figure = len(growth.steps), figure_of(_WIDTH, _HEIGHT)
    left, width, bottom, height = _PANE + 16, _WIDTH - _PANE - 32, _FOOT + 36, _HEIGHT - _FOOT - 52
    pane = figure.add_axes((left / _WIDTH, bottom / _HEIGHT, width / _WIDTH, height / _HEIGHT))
    show_picture(pane, picture, most=0.25)
    foot = figure.add_axes((20 / _WIDTH, (_FOOT - 24) / _HEIGHT, 1 - 40 / _WIDTH, 16 / _HEIGHT))
    foot.set_axis_off()
    foot.plot([0, count - 1], [0, 0], color=GRID, linewidth=2)
    colors = [BLUE if n <= order else GRID for n in range(count)]
    sizes = [144 if n == step.order else 64 for n in range(count)]
    foot.scatter(range(count), [0] * count, sizes, colors, linewidth=0, zorder=2, clip_on=False)
    turn = f"{step.angle_deg:g}\u00b0"
    said = told or (
        f"View {step.view_index} at {turn}"
        if order == step.order
        else f"Turning to view {step.view_index}, {turn}"
    )
    area = f"{1e4 * growth.steps[order].area_m2:.0f} cm\u00b2"
    figure.text(20 / _WIDTH, 14 / _HEIGHT, said, fontsize=14)
    figure.text(0.5, 14 / _HEIGHT, f"step {step.order + 1} of {count}", color=SOFT, ha="center")
    figure.text(1 - 20 / _WIDTH, 14 / _HEIGHT, area, ha="right", fontsize=14)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()
