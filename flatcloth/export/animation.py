"""The growth of the shape as an animation: the item turns, and each accepted view extends its shape."""

from __future__ import annotations

import tempfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.plain_files import replacing
from flatcloth.core.types import Bool, Uint8
from flatcloth.export.growth import Growth, Step
from flatcloth.export.session import OpenedSession
from flatcloth.rendering.charts import SMALL, draw_scale_bar
from flatcloth.rendering.drawing import BLUE, GRID, SOFT, TEXT, Drawing
from flatcloth.rendering.pictures import NEW_RGB, cropped
from flatcloth.rendering.points import Camera, camera_around, paint_points

if TYPE_CHECKING:
    from PIL import Image as PillowImage

    from flatcloth.engine.views import ViewCloud

SUFFIXES = (".gif", ".mp4")

_WIDTH, _HEIGHT, _FOOT, _PANE = 880, 500, 62, 400
"""Layout (px): image, foot, and the pane of the cloud. Chosen."""
_TURN_FRAMES, _TURN_MS, _HOLD_MS, _LAST_MS = 6, 60, 900, 2600
"""Frames of a turn, and how long (ms) frames of it, results and the last one are shown. Chosen."""
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


@dataclass(frozen=True)
class _Packed:
    """A frame, compressed without loss: a page of flat colors takes a tenth of its pixels."""

    data: bytes
    size: tuple[int, int]
    duration_ms: int

    @classmethod
    def of(cls, frame: Frame) -> _Packed:
        return cls(zlib.compress(frame.image.tobytes(), 1), frame.image.size, frame.duration_ms)

    @property
    def image(self) -> PillowImage.Image:
        from PIL import Image

        return Image.frombytes("RGB", self.size, zlib.decompress(self.data))


def write_animation(session: OpenedSession, path: Path) -> None:
    """Write the growth as an animation; the suffix of the name selects GIF or MP4.

    Raises
    ------
    FlatclothError
        If the suffix is another one, or the file cannot be written.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise FlatclothError(
            f"{path}: the name of an animation ends in {' or '.join(SUFFIXES)}; choose one of these."
        )
    shown = [_Packed.of(frame) for frame in frames(session)]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix.lower() == ".gif":
            with replacing(path) as file:
                _write_gif(shown, file)
        else:
            # OpenCV writes to a name only, and would follow a link.
            with replacing(path) as file, tempfile.TemporaryDirectory(prefix="flatcloth-") as folder:
                made = Path(folder) / "growth.mp4"
                _write_mp4(shown, made)
                file.write(made.read_bytes())
    except OSError as error:
        raise FlatclothError(f"{path}: cannot be written ({error.strerror}); choose another file.") from error


def frames(session: OpenedSession) -> Iterator[Frame]:
    """Yield the frames in order."""
    growth, integration = session.growth, session.integration
    view = growth.view
    xyz = view.xyz_m[view.valid]
    camera = camera_around(xyz, integration.axis, _PANE, _HEIGHT - _FOOT)
    last = growth.steps[-1].order
    angle_deg, cloud = growth.steps[0].angle_deg, integration.cloud(growth.steps[0].view_index)
    for step in growth.steps:
        session.progress(step.order / (last + 1), f"painting step {step.order + 1} of {last + 1}")
        if step.order:
            turn = (step.angle_deg - angle_deg + 180.0) % 360.0 - 180.0
            for n in range(1, _TURN_FRAMES + 1):
                share = n / (_TURN_FRAMES + 1)
                eased = share * share * (3 - 2 * share)
                scene = _scene(growth, camera, cloud, angle_deg + eased * turn, step.order - 1, False)
                yield Frame(image=_page(growth, scene, step, step.order - 1, False), duration_ms=_TURN_MS)
        angle_deg, cloud = step.angle_deg, integration.cloud(step.view_index)
        scene = _scene(growth, camera, cloud, angle_deg, step.order, True)
        yield Frame(image=_page(growth, scene, step, step.order, True), duration_ms=_HOLD_MS)
    scene = _scene(growth, camera, cloud, angle_deg, last, False)
    yield Frame(image=_page(growth, scene, growth.steps[-1], last, False), duration_ms=_LAST_MS)


def _scene(
    growth: Growth, camera: Camera, cloud: ViewCloud, angle_deg: float, order: int, tinted: bool
) -> Uint8:
    """Draw the cloud of the last view in pale colors, and over it the shape so far in space."""
    image = np.full((camera.height, camera.width, 3), _PAPER, dtype=np.uint8)
    shown = growth.shown_after(order)
    pale = (0.25 * cloud.rgb + 0.75 * 205.0).astype(np.uint8)
    xyz = np.concatenate([cloud.xyz_m, growth.view.xyz_m[shown]])
    rgb = np.concatenate([pale, _colors(growth, shown, order, tinted)])
    behind_m = np.concatenate([np.full(len(cloud.xyz_m), _BEHIND_M), np.zeros(int(shown.sum()))])
    paint_points(image, camera, angle_deg, xyz, rgb, _POINT_M, behind_m)
    return image


def _colors(growth: Growth, shown: Bool, order: int, tinted: bool) -> Uint8:
    rgb = growth.view.rgb[shown].astype(np.float64)
    if tinted:
        new = growth.first_step[shown] == order
        rgb[new] = 0.5 * rgb[new] + 0.5 * np.array(NEW_RGB, dtype=np.float64)
    colors: Uint8 = rgb.astype(np.uint8)
    return colors


def _page(growth: Growth, scene: Uint8, step: Step, order: int, tinted: bool) -> PillowImage.Image:
    """Place the two panes side by side, with the step as text and on a timeline."""
    from PIL import Image

    drawing = Drawing(_WIDTH, _HEIGHT)
    pane = _HEIGHT - _FOOT
    alpha = np.full((*scene.shape[:2], 1), 255, dtype=np.uint8)
    drawing.picture(np.concatenate([scene, alpha], axis=-1), 0, 0, _PANE, pane)
    shown = growth.shown_after(order)
    flat = np.zeros((*growth.view.shape, 4), dtype=np.uint8)
    flat[shown, :3] = _colors(growth, shown, order, tinted)
    flat[shown, 3] = 255
    picture = cropped(flat, growth.view)
    rows, cols = picture.rgba.shape[:2]
    room = (_WIDTH - _PANE - 32, pane - 56)
    per_pixel = min(room[0] / cols, room[1] / rows)
    width, height = cols * per_pixel, rows * per_pixel
    left, top = _PANE + 16 + (room[0] - width) / 2, 16 + (room[1] - height) / 2
    drawing.picture(picture.rgba, left, top, width, height)
    draw_scale_bar(drawing, _PANE + 16, pane - 8, per_pixel / picture.pixel_size_m, 120)
    _draw_foot(drawing, growth, step, order)
    return Image.fromarray(drawing.paint(1.0))


def _draw_foot(drawing: Drawing, growth: Growth, step: Step, order: int) -> None:
    count = len(growth.steps)
    y = _HEIGHT - _FOOT + 16
    ends = np.array([(20.0, y), (_WIDTH - 20.0, y)])
    drawing.line(ends, GRID, 3)
    for n in range(count):
        x = 20.0 + (_WIDTH - 40.0) * (n / max(count - 1, 1))
        drawing.dot(x, y, 6.0 if n == step.order else 4.0, BLUE if n <= order else GRID)
    turn = f"{step.angle_deg:g}\u00b0"
    said = (
        f"View {step.view_index} at {turn}"
        if order == step.order
        else f"Turning to view {step.view_index}, {turn}"
    )
    drawing.text(20, _HEIGHT - 14, said, 14, TEXT)
    area = f"{1e4 * growth.steps[order].area_m2:.0f} cm\u00b2"
    drawing.text(_WIDTH - 20, _HEIGHT - 14, area, 14, TEXT, "end")
    drawing.text(_WIDTH / 2, _HEIGHT - 14, f"step {step.order + 1} of {count}", SMALL, SOFT, "middle")


def _write_gif(shown: list[_Packed], file: BinaryIO) -> None:
    """Write a GIF with one palette for all frames, so that only changes are stored."""
    from PIL import Image

    tinted, last = shown[0].image, shown[-1].image
    both = Image.new("RGB", (tinted.width, 2 * tinted.height))
    both.paste(tinted, (0, 0))
    both.paste(last, (0, tinted.height))
    palette = both.quantize(colors=192, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    images = (frame.image.quantize(palette=palette, dither=Image.Dither.NONE) for frame in shown)
    next(images).save(
        file,
        "GIF",
        save_all=True,
        append_images=images,
        duration=[frame.duration_ms for frame in shown],
        loop=0,
        optimize=False,
    )


def _write_mp4(shown: list[_Packed], path: Path) -> None:
    """Write an MP4: VP9 if OpenCV supports it, because browsers play it, otherwise MPEG-4."""
    import cv2

    size = shown[0].size
    for code in ("vp09", "mp4v"):
        writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*code), float(_FPS), size)
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
