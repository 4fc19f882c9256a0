"""A page of pixels: pictures, lines, dots and text painted directly, for pages that are many and small."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from flatcloth.core.types import Floats, Uint8
from flatcloth.rendering.drawing import TEXT, check_matplotlib

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont

_ANCHORS = {"start": "ls", "middle": "ms", "end": "rs"}
"""The anchors of a text on its baseline, in Pillow's words."""
_BITS = 4
"""Bits of a fraction of a pixel in OpenCV's coordinates. Chosen."""


@dataclass(frozen=True)
class Words:
    """A text on its baseline: position (px), size (px) and color; ``anchor`` is start, middle or end."""

    x: float
    y: float
    text: str
    size: float
    color: str = TEXT
    anchor: str = "start"


def lay_picture(page: Uint8, rgba: Uint8, x: float, y: float, width: float, height: float) -> None:
    """Lay a picture (H, W, 4) uint8 on white on a page (H, W, 3), averaged if it shrinks."""
    on_white = np.where(rgba[..., 3:] > 0, rgba[..., :3], np.uint8(255))
    size = max(1, round(width)), max(1, round(height))
    shrinks = size[0] < rgba.shape[1]
    laid = cv2.resize(on_white, size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_NEAREST)
    left, top = round(x), round(y)
    page[top : top + size[1], left : left + size[0]] = laid


def draw_line(page: Uint8, points: Floats, color: str, width: int) -> None:
    """Draw a polyline through points (N, 2), in px."""
    at = np.rint(np.asarray(points) * (1 << _BITS)).astype(np.int32)
    cv2.polylines(page, [at], False, _rgb(color), width, cv2.LINE_AA, _BITS)


def draw_dot(page: Uint8, x: float, y: float, radius: float, color: str) -> None:
    """Fill a circle, in px."""
    centre = round(x * (1 << _BITS)), round(y * (1 << _BITS))
    inside = round((radius - 0.5) * (1 << _BITS))  # OpenCV smooths outside
    cv2.circle(page, centre, inside, _rgb(color), -1, cv2.LINE_AA, _BITS)


def written(page: Uint8, words: Iterable[Words]) -> Uint8:
    """Return a page (H, W, 3) with texts, in the font of the drawings."""
    from PIL import Image, ImageDraw

    image = Image.fromarray(page)
    pen = ImageDraw.Draw(image)
    for each in words:
        font, anchor = _font(each.size), _ANCHORS[each.anchor]
        pen.text((each.x, each.y), each.text, fill=_rgb(each.color), font=font, anchor=anchor)
    return np.asarray(image)


@lru_cache(maxsize=8)
def _font(size: float) -> FreeTypeFont:
    check_matplotlib()
    import matplotlib as mpl
    from PIL import ImageFont

    return ImageFont.truetype(Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", size)


def _rgb(color: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(color.removeprefix("#"))
    return red, green, blue
