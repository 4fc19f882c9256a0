"""A drawing of lines, text and pictures that can be written as SVG or PNG with the same result.

The few plots need no plotting library: they are part of the report and the exported page as SVG, in every
installation, with reproducible bytes. PNG is drawn by Pillow, which viser installs, with its built-in
font; that font has no exponents and few typographic characters, which are therefore drawn specially.
"""

from __future__ import annotations

import base64
import functools
import io
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from flatcloth.core.types import Floats, Uint8

if TYPE_CHECKING:
    from PIL import Image as PillowImage
    from PIL import ImageDraw, ImageFont

TEXT, SOFT, LINE, GRID, PAPER = "#1a1f26", "#55606d", "#9aa4af", "#e3e7eb", "#ffffff"
BLUE, ORANGE, GREEN, RED, PINK = "#1766c2", "#d9822b", "#1f7a4d", "#b3261e", "#d81b72"

FONTS = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Noto Sans', 'DejaVu Sans', sans-serif"
_SMOOTHING = 2
"""PNG is drawn at this scale and then reduced."""
_GAP = 10
"""Space between two parts of a line of text."""
_MINUS = str.maketrans({"\u2212": "-", "\u2013": "-", "\u00d7": "x", "\u2026": "..."})
_SQUARED = "\u00b2"


@dataclass(frozen=True)
class _Line:
    points: tuple[tuple[float, float], ...]
    color: str
    width: float
    dashed: bool


@dataclass(frozen=True)
class _Area:
    points: tuple[tuple[float, float], ...]
    color: str
    opacity: float


@dataclass(frozen=True)
class Run:
    """A part of a line of text."""

    text: str
    size: float = 12.0
    color: str = TEXT
    bold: bool = False


@dataclass(frozen=True)
class _Text:
    x: float
    y: float
    runs: tuple[Run, ...]
    anchor: str


@dataclass(frozen=True)
class _Picture:
    rgba: Uint8 = field(repr=False)
    x: float
    y: float
    width: float
    height: float


@dataclass
class Drawing:
    """Items drawn one over the other; lengths in points, x to the right, y down.

    ``about`` is the description for readers who cannot see the drawing.
    """

    width: float
    height: float
    about: str = ""
    _items: list[_Line | _Area | _Text | _Picture] = field(default_factory=list)

    def line(self, points: Floats, color: str = TEXT, width: float = 1.5, dashed: bool = False) -> None:
        """Draw a polyline through points (N, 2); it is broken where they are not finite."""
        known = np.isfinite(np.asarray(points, dtype=np.float64)).all(axis=1)
        breaks = np.flatnonzero(np.diff(known.astype(int))) + 1
        for part, kept in zip(np.split(np.asarray(points), breaks), np.split(known, breaks), strict=True):
            if len(part) > 1 and kept[0]:
                self._items.append(_Line(_pairs(part), color, width, dashed))

    def area(self, points: Floats, color: str, opacity: float = 1.0) -> None:
        """Fill a polygon (N, 2)."""
        self._items.append(_Area(_pairs(points), color, opacity))

    def box(self, x: float, y: float, width: float, height: float, color: str, opacity: float = 1.0) -> None:
        """Fill a rectangle."""
        corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
        self.area(np.array(corners), color, opacity)

    def dot(self, x: float, y: float, radius: float, color: str) -> None:
        """Fill a circle."""
        turn = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
        self.area(np.stack([x + radius * np.cos(turn), y + radius * np.sin(turn)], axis=1), color)

    def text(
        self,
        x: float,
        y: float,
        text: str,
        size: float = 12.0,
        color: str = TEXT,
        anchor: str = "start",
        bold: bool = False,
    ) -> None:
        """Write a line of text; ``y`` is its base line, ``anchor`` is ``start``, ``middle`` or ``end``."""
        self.runs(x, y, (Run(text, size, color, bold),), anchor)

    def runs(self, x: float, y: float, runs: tuple[Run, ...], anchor: str = "start") -> None:
        """Write several parts of text in one line, with gaps between them."""
        self._items.append(_Text(x, y, runs, anchor))

    def picture(self, rgba: Uint8, x: float, y: float, width: float, height: float) -> None:
        """Draw a picture (H, W, 4) uint8."""
        self._items.append(_Picture(rgba, x, y, width, height))

    def svg(self, paper: str | None = PAPER) -> str:
        """Return the drawing as SVG text; ``paper`` None leaves the background transparent."""
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_n(self.width)} {_n(self.height)}"'
            f' width="{_n(self.width)}" height="{_n(self.height)}" role="img"'
            f' aria-label="{escape(self.about)}" font-family="{FONTS}">'
        )
        ground = [] if paper is None else [f'<rect width="100%" height="100%" fill="{paper}"/>']
        return "\n".join([head, *ground, *(_svg(item) for item in self._items), "</svg>"]) + "\n"

    def png(self, scale: float = 2.0) -> bytes:
        """Return the drawing as PNG on white, with ``scale`` pixels per point."""
        file = io.BytesIO()
        self.paint(scale).save(file, "PNG", optimize=False)
        return file.getvalue()

    def paint(self, scale: float) -> PillowImage.Image:
        """Return the drawing as a Pillow image (RGB), with ``scale`` pixels per point."""
        from PIL import Image, ImageDraw

        size = (round(self.width * scale), round(self.height * scale))
        large = scale * _SMOOTHING
        image = Image.new("RGB", (size[0] * _SMOOTHING, size[1] * _SMOOTHING), PAPER)
        pen = ImageDraw.Draw(image, "RGBA")
        for item in self._items:
            _paint(item, image, pen, large)
        return image.resize(size, Image.Resampling.LANCZOS)


def text_width(text: str, size: float) -> float:
    """Return the approximate width of a text."""
    return float(_font(100.0).getlength(text.translate(_MINUS).replace(_SQUARED, ""))) * size / 100.0


def png_of(rgba: Uint8) -> bytes:
    """Return a picture (H, W, 3 or 4) uint8 as PNG."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(rgba).save(file, "PNG", optimize=False)
    return file.getvalue()


def data_url(data: bytes, kind: str) -> str:
    """Return bytes as a data URL."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _pairs(points: Floats) -> tuple[tuple[float, float], ...]:
    return tuple((float(x), float(y)) for x, y in np.asarray(points))


def _n(value: float) -> str:
    """Return a number with at most two decimals."""
    return f"{value:.2f}".rstrip("0").rstrip(".")


def _path(points: tuple[tuple[float, float], ...]) -> str:
    return " ".join(f"{_n(x)},{_n(y)}" for x, y in points)


def _svg(item: _Line | _Area | _Text | _Picture) -> str:
    match item:
        case _Line():
            dashes = ' stroke-dasharray="5 4"' if item.dashed else ""
            return (
                f'<polyline points="{_path(item.points)}" fill="none" stroke="{item.color}"'
                f' stroke-width="{_n(item.width)}" stroke-linejoin="round"{dashes}/>'
            )
        case _Area():
            opacity = "" if item.opacity >= 1 else f' fill-opacity="{_n(item.opacity)}"'
            return f'<polygon points="{_path(item.points)}" fill="{item.color}"{opacity}/>'
        case _Text():
            pieces = "".join(_svg_run(run, n > 0) for n, run in enumerate(item.runs))
            return f'<text x="{_n(item.x)}" y="{_n(item.y)}" text-anchor="{item.anchor}">{pieces}</text>'
        case _Picture():
            place = f'x="{_n(item.x)}" y="{_n(item.y)}" width="{_n(item.width)}" height="{_n(item.height)}"'
            address = data_url(png_of(item.rgba), "image/png")
            return f'<image {place} preserveAspectRatio="none" href="{address}"/>'


def _paint(
    item: _Line | _Area | _Text | _Picture,
    image: PillowImage.Image,
    pen: ImageDraw.ImageDraw,
    scale: float,
) -> None:
    match item:
        case _Line():
            points = [(x * scale, y * scale) for x, y in item.points]
            width = max(1, round(item.width * scale))
            for stroke in _dashes(points, 5 * scale, 4 * scale) if item.dashed else [points]:
                pen.line(stroke, fill=item.color, width=width, joint="curve")
        case _Area():
            alpha = f"{round(255 * item.opacity):02x}"
            pen.polygon([(x * scale, y * scale) for x, y in item.points], fill=item.color + alpha)
        case _Text():
            _write(item, pen, scale)
        case _Picture():
            from PIL import Image

            size = (max(1, round(item.width * scale)), max(1, round(item.height * scale)))
            grown = size[0] >= item.rgba.shape[1]
            way = Image.Resampling.NEAREST if grown else Image.Resampling.BOX
            picture = Image.fromarray(item.rgba).convert("RGBa").resize(size, way).convert("RGBA")
            image.paste(picture, (round(item.x * scale), round(item.y * scale)), picture)


def _svg_run(run: Run, gap: bool) -> str:
    more = ' font-weight="600"' if run.bold else ""
    more += f' dx="{_GAP}"' if gap else ""
    return f'<tspan font-size="{_n(run.size)}" fill="{run.color}"{more}>{escape(run.text)}</tspan>'


def _write(item: _Text, pen: ImageDraw.ImageDraw, scale: float) -> None:
    """Write a line part by part; exponents are small raised figures."""
    pieces: list[tuple[str, float, float, Run]] = []
    gaps: list[float] = []
    for run in item.runs:
        size = run.size * scale
        gap = _GAP * scale if pieces else 0.0
        for n, part in enumerate(run.text.translate(_MINUS).split(_SQUARED)):
            for text, size_px, raised in [("2", 0.65 * size, 0.35 * size)] * (n > 0) + [(part, size, 0.0)]:
                pieces.append((text, size_px, raised, run))
                gaps.append(gap)
                gap = 0.0
    widths = [float(_font(size_px).getlength(text)) for text, size_px, _, _ in pieces]
    whole = sum(widths) + sum(gaps)
    x = item.x * scale - {"start": 0.0, "middle": 0.5, "end": 1.0}[item.anchor] * whole
    for (text, size_px, raised, run), width, gap in zip(pieces, widths, gaps, strict=True):
        x += gap
        stroke = max(1, round(0.015 * size_px)) if run.bold else 0
        place = (x, item.y * scale - raised)
        pen.text(place, text, fill=run.color, font=_font(size_px), anchor="ls", stroke_width=stroke)
        x += width


@functools.lru_cache(maxsize=64)
def _font(size_px: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    from PIL import ImageFont

    return ImageFont.load_default(size_px)


def _dashes(points: list[tuple[float, float]], on: float, off: float) -> list[list[tuple[float, float]]]:
    """Cut a polyline into dashes."""
    path = np.array(points)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    strokes = []
    for start in np.arange(0.0, along[-1], on + off):
        at = np.array([start, min(start + on, along[-1])])
        ends = np.stack([np.interp(at, along, path[:, k]) for k in (0, 1)], axis=1)
        strokes.append([(float(x), float(y)) for x, y in ends])
    return strokes
