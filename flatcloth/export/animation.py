"""The growth of the shape as an animation: the item turns, and each accepted view extends its shape."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.core.geometry import wrapped_deg
from flatcloth.core.plain_files import replacing
from flatcloth.core.types import Bool, FlattenedView, Float64, Uint8
from flatcloth.export.growth import Growth, Step
from flatcloth.export.session import OpenedSession
from flatcloth.rendering.charts import SMALL, nice_below
from flatcloth.rendering.drawing import BLUE, GRID, SOFT, TEXT
from flatcloth.rendering.painting import Words, draw_dot, draw_line, lay_picture, written
from flatcloth.rendering.pictures import NEW_RGB, PlanePicture, cropped, side_by_side
from flatcloth.rendering.points import camera_around, paint_points

if TYPE_CHECKING:
    from PIL import Image as PillowImage

SUFFIXES = (".gif", ".mp4")

_WIDTH, _HEIGHT, _FOOT, _PANE = 880, 500, 62, 400
"""Layout (px): image, foot, and the pane of the cloud. Chosen."""
_SCALE = 120.0
"""Longest scale bar (px). Chosen."""
_MOST_TURNING = 72
"""Most frames in which the item turns, shared by all turns. Chosen for the size of the file."""
_TURN_FRAMES, _TURN_MS, _HOLD_MS, _LAST_MS = 6, 60, 900, 2600
"""Most frames of a turn, and how long (ms) frames of it, results and the last one are shown. Chosen."""
_COLORS = (128, 64, 32)
"""Colours of a GIF: the most with which it is small enough. Chosen."""
_MOST_GIF_BYTES = 2_000_000
"""A GIF of more bytes gets fewer colours. Chosen: what slides and mail take."""
_FPS = 10
"""Frames a second of the film. Chosen."""
_POINT_M = 0.0022
"""Size of a drawn point. Chosen: about the distance of neighbours, so that the cloud looks closed."""
_BEHIND_M = 0.006
"""Points this far behind the nearest are hidden. Chosen: above the noise of a D435."""
_PAPER = 255
"""Grey of the background: white."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A frame and its duration."""

    image: PillowImage.Image
    duration_ms: int


def write_animation(session: OpenedSession, path: Path) -> None:
    """Write the growth as an animation; the suffix of the name selects GIF or MP4.

    Raises
    ------
    FlatclothError
        If the suffix is another one, or the file cannot be written.
    """
    check_suffix(path)
    shown = frames(session)
    with os_errors_as(FlatclothError, f"{path}: cannot be written", "Choose another file."):
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix.lower() == ".gif":
            with replacing(path) as file:
                file.write(_gif(shown, _colorful(session)))
        else:
            # OpenCV writes to a name only, and would follow a link.
            with replacing(path) as file, tempfile.TemporaryDirectory(prefix="flatcloth-") as folder:
                made = Path(folder) / "growth.mp4"
                _write_mp4(shown, made)
                file.write(made.read_bytes())


def check_suffix(path: Path) -> None:
    """Check that a name is that of a format which can be written; raises ``FlatclothError`` if not."""
    if path.suffix.lower() not in SUFFIXES:
        raise FlatclothError(
            f"{path}: the name of an animation ends in {' or '.join(SUFFIXES)}; choose one of these."
        )


def frames(session: OpenedSession) -> Iterator[Frame]:
    """Yield the frames in order."""
    growth, painter = session.growth, _Painter(session)
    first, last = growth.steps[0], growth.steps[-1]
    turn_frames = max(1, min(_TURN_FRAMES, _MOST_TURNING // len(growth.steps)))
    angle_deg, scene = first.angle_deg, painter.scene(first, first.order, False)
    for step in growth.steps:
        session.progress(step.order / (last.order + 1), f"painting step {step.order + 1} of {last.order + 1}")
        if step.order:
            turn = wrapped_deg(step.angle_deg - angle_deg)
            page = painter.page(step, step.order - 1, False)
            for n in range(1, turn_frames + 1):
                share = n / (turn_frames + 1)
                eased = share * share * (3 - 2 * share)
                yield painter.frame(page, scene, angle_deg + eased * turn, _TURN_MS)
        angle_deg = step.angle_deg
        page, scene = painter.page(step, step.order, True), painter.scene(step, step.order, True)
        yield painter.frame(page, scene, angle_deg, _HOLD_MS)
        scene = painter.scene(step, step.order, False)
    yield painter.frame(painter.page(last, last.order, False), scene, angle_deg, _LAST_MS)
    if painter.other is not None:
        page, scene = painter.both_page(last, painter.other), painter.with_other(scene, painter.other)
        yield painter.frame(page, scene, angle_deg, _LAST_MS)


@dataclass(frozen=True)
class _Scene:
    """Points in space: ``xyz_m`` (N, 3), ``rgb`` (N, 3), and how far behind (N,) they count, m."""

    xyz_m: Float64
    rgb: Uint8
    behind_m: Float64


class _Painter:
    """Paints the frames of a session; what several frames have in common is painted once."""

    def __init__(self, session: OpenedSession) -> None:
        self._growth, self._integration = session.growth, session.integration
        view = self._growth.view
        self._camera = camera_around(view.xyz_m[view.valid], self._integration.axis, _PANE, _HEIGHT - _FOOT)
        self.other = session.view_of("other")

    def frame(self, page: Uint8, scene: _Scene, angle_deg: float, duration_ms: int) -> Frame:
        """Paint a scene next to the shape on its page."""
        from PIL import Image

        image = page.copy()
        pane = np.full((self._camera.height, self._camera.width, 3), _PAPER, dtype=np.uint8)
        paint_points(pane, self._camera, angle_deg, scene.xyz_m, scene.rgb, _POINT_M, scene.behind_m)
        image[: pane.shape[0], : pane.shape[1]] = pane
        return Frame(image=Image.fromarray(image), duration_ms=duration_ms)

    def scene(self, step: Step, order: int, tinted: bool) -> _Scene:
        """Return the cloud of a step's view in pale colors, and the shape so far in space."""
        growth, cloud = self._growth, self._integration.views.cloud(step.view_index)
        shown = growth.shown_after(order)
        pale = (0.25 * cloud.rgb + 0.75 * 205.0).astype(np.uint8)
        xyz = np.concatenate([cloud.xyz_m, growth.view.xyz_m[shown]])
        behind_m = np.zeros(len(xyz))
        behind_m[: len(pale)] = _BEHIND_M
        rgb = np.concatenate([pale, _colors(growth, shown, order, tinted)])
        return _Scene(xyz.astype(np.float64), rgb, behind_m)

    def page(self, step: Step, order: int, tinted: bool) -> Uint8:
        """Paint the shape next to an empty pane, with the step as text and on a timeline."""
        growth = self._growth
        shown = growth.shown_after(order)
        flat = np.zeros((*growth.view.shape, 4), dtype=np.uint8)
        flat[shown, :3] = _colors(growth, shown, order, tinted)
        flat[shown, 3] = 255
        return _page(cropped(flat, growth.view), growth, step, order)

    def both_page(self, last: Step, other: FlattenedView) -> Uint8:
        """Paint both sides side by side, each as seen from its own outside."""
        picture = side_by_side(self._growth.view, other)[0]
        return _page(picture, self._growth, last, last.order, "Both sides, each from its own outside")

    def with_other(self, scene: _Scene, other: FlattenedView) -> _Scene:
        """Return a scene with the cloth of the other side."""
        xyz, rgb = other.xyz_m[other.valid], other.rgb[other.valid]
        behind_m = np.concatenate([scene.behind_m, np.zeros(len(xyz))])
        return _Scene(np.concatenate([scene.xyz_m, xyz]), np.concatenate([scene.rgb, rgb]), behind_m)


def _colors(growth: Growth, shown: Bool, order: int, tinted: bool) -> Uint8:
    rgb = growth.view.rgb[shown]
    if tinted:
        new = growth.first_step[shown] == order
        rgb[new] = (0.5 * rgb[new] + 0.5 * np.array(NEW_RGB, dtype=np.float64)).astype(np.uint8)
    return rgb


def _page(picture: PlanePicture, growth: Growth, step: Step, order: int, told: str = "") -> Uint8:
    """Paint a picture of the plane into the right pane, with its scale, and the foot below both panes."""
    page = np.full((_HEIGHT, _WIDTH, 3), _PAPER, dtype=np.uint8)
    left, pane = _PANE + 16, _HEIGHT - _FOOT
    rows, cols = picture.rgba.shape[:2]
    room = (_WIDTH - _PANE - 32, pane - 56)
    per_pixel = min(room[0] / cols, room[1] / rows)
    width, height = cols * per_pixel, rows * per_pixel
    x, y = left + (room[0] - width) / 2, 16 + (room[1] - height) / 2
    lay_picture(page, picture.rgba, x, y, width, height)
    length_m = nice_below(_SCALE * picture.pixel_size_m / per_pixel)
    right, y = left + length_m * per_pixel / picture.pixel_size_m, pane - 8
    draw_line(page, np.array([(left, y - 5), (left, y), (right, y), (right, y - 5)]), TEXT, 1)
    scale = Words((left + right) / 2, y - 7, f"{1000 * length_m:g} mm", SMALL, TEXT, "middle")
    return written(page, [scale, *_foot(page, growth, step, order, told)])


def _foot(page: Uint8, growth: Growth, step: Step, order: int, told: str) -> list[Words]:
    """Draw the timeline, and return the words below it."""
    count = len(growth.steps)
    y = _HEIGHT - _FOOT + 16
    draw_line(page, np.array([(20.0, y), (_WIDTH - 20.0, y)]), GRID, 2)
    for n in range(count):
        x = 20.0 + (_WIDTH - 40.0) * (n / max(count - 1, 1))
        draw_dot(page, x, y, 6.0 if n == step.order else 4.0, BLUE if n <= order else GRID)
    turn = f"{step.angle_deg:g}\u00b0"
    said = told or (
        f"View {step.view_index} at {turn}"
        if order == step.order
        else f"Turning to view {step.view_index}, {turn}"
    )
    below = _HEIGHT - 14
    area = f"{1e4 * growth.steps[order].area_m2:.0f} cm\u00b2"
    return [
        Words(20, below, said, 14),
        Words(_WIDTH - 20, below, area, 14, TEXT, "end"),
        Words(_WIDTH / 2, below, f"step {step.order + 1} of {count}", SMALL, SOFT, "middle"),
    ]


def _colorful(session: OpenedSession) -> PillowImage.Image:
    """Return a picture with the colours of all frames: the first and the last."""
    from PIL import Image

    painter, steps = _Painter(session), session.growth.steps
    both = Image.new("RGB", (_WIDTH, 2 * _HEIGHT))
    for n, (step, tinted) in enumerate(((steps[0], True), (steps[-1], False))):
        page, scene = painter.page(step, step.order, tinted), painter.scene(step, step.order, tinted)
        both.paste(painter.frame(page, scene, step.angle_deg, _HOLD_MS).image, (0, n * _HEIGHT))
    return both


def _gif(shown: Iterable[Frame], colorful: PillowImage.Image) -> bytes:
    """Return a GIF with one palette for all frames, of fewer colours where it would be too large.

    Pillow writes what changes from frame to frame. It has all of them in memory, 0.4 MB each.
    """
    from PIL import Image

    durations_ms: list[int] = []
    images: list[PillowImage.Image] = []
    for count in _COLORS:
        palette = colorful.quantize(count, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
        if not images:
            for frame in shown:
                durations_ms.append(frame.duration_ms)
                images.append(frame.image.quantize(palette=palette, dither=Image.Dither.NONE))
        else:
            images = [
                image.convert("RGB").quantize(palette=palette, dither=Image.Dither.NONE) for image in images
            ]
        file = io.BytesIO()
        images[0].save(file, "GIF", save_all=True, append_images=images[1:], duration=durations_ms, loop=0)
        if file.tell() <= _MOST_GIF_BYTES:
            break
    return file.getvalue()


def _write_mp4(shown: Iterable[Frame], path: Path) -> None:
    """Write an MP4: VP9 if OpenCV supports it, because browsers play it, otherwise MPEG-4."""
    import cv2

    for code in ("vp09", "mp4v"):
        writer = cv2.VideoWriter(
            str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*code), float(_FPS), (_WIDTH, _HEIGHT)
        )
        if writer.isOpened():
            break
    else:
        raise FlatclothError(
            f"{path}: the installed OpenCV cannot write MP4; choose a name that ends in .gif."
        )
    try:
        for frame in shown:
            bgr = np.asarray(frame.image)[..., ::-1]
            for _ in range(max(1, round(frame.duration_ms * _FPS / 1000))):
                writer.write(np.ascontiguousarray(bgr))
    finally:
        writer.release()
