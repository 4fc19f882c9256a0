"""A page of lines, areas, text, pictures and charts that is written as SVG or PNG, by matplotlib.

Only matplotlib's objects are used, never pyplot, which keeps figures in global state and would leak them in
a server. The same drawing gives the same bytes: its ids are salted with its description, and no date is
written. matplotlib is part of the ``export`` extra and loads with the first drawing.
"""

from __future__ import annotations

import base64
import io
import re
import threading
import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Floats, Uint8

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

TEXT, SOFT, LINE, GRID, PAPER = "#1a1f26", "#55606d", "#9aa4af", "#e3e7eb", "#ffffff"
BLUE, ORANGE, GREEN, PINK = "#1766c2", "#d9822b", "#1f7a4d", "#d81b72"

FONT = "DejaVu Sans"
"""matplotlib brings this font along, so a text has the same width on every machine."""
_GAP = 10
"""Space between two parts of a line of text, in points."""
_POINTS_PER_INCH = 72.0
"""By definition."""
_PROLOG = re.compile(r"^.*?<svg\b[^>]*>", re.DOTALL)
_STYLE = re.compile(r"\s*<defs>\s*<style\b.*?</style>\s*</defs>", re.DOTALL)
_GROUP_ID = re.compile(r'<g id="[^"]*"')
_RENDERING = threading.RLock()
"""Held while matplotlib's settings, which are global, are those of a drawing."""


@dataclass(frozen=True)
class Run:
    """A part of a line of text."""

    text: str
    size: float = 12.0
    color: str = TEXT
    bold: bool = False


@dataclass(frozen=True)
class _Picture:
    """A picture on a page: as drawn, its pixels (H, W, 4), and its place: x, y, width, height."""

    drawn: AxesImage
    rgba: Uint8
    place: tuple[float, float, float, float]
    png: bytes | None

    @property
    def svg(self) -> str:
        """The picture as an element of SVG: its own pixels, not those of a screen."""
        x, y, width, height = (f"{value:.6g}" for value in self.place)
        return (
            f'<image x="{x}" y="{y}" width="{width}" height="{height}" preserveAspectRatio="none"'
            ' style="image-rendering:crisp-edges;image-rendering:pixelated"'
            f' xlink:href="{data_url(self.png or png_of(self.rgba), "image/png")}"/>'
        )


@dataclass
class Drawing:
    """Items drawn one over the other on a page; lengths in points, x to the right, y down.

    ``about`` is the description for readers who cannot see the drawing.

    Raises
    ------
    FlatclothError
        If matplotlib is not installed.
    """

    width: float
    height: float
    about: str = ""
    figure: Figure = field(init=False, repr=False)
    page: Axes = field(init=False, repr=False)
    _pictures: list[_Picture] = field(init=False, repr=False, default_factory=list)
    _items: list[Artist] = field(init=False, repr=False, default_factory=list)

    def __post_init__(self) -> None:
        with _settings(""):
            from matplotlib.figure import Figure

            size = (self.width / _POINTS_PER_INCH, self.height / _POINTS_PER_INCH)
            self.figure = Figure(figsize=size, dpi=_POINTS_PER_INCH)
            # The page lies above the charts, which stand in axes of their own.
            self.page = self.figure.add_axes((0.0, 0.0, 1.0, 1.0), zorder=1)
            self.page.set(xlim=(0.0, self.width), ylim=(self.height, 0.0), autoscale_on=False)
            self.page.set_axis_off()

    def axes(self, left: float, top: float, width: float, height: float) -> Axes:
        """Add axes for a chart: the plot's rectangle in points."""
        bottom = self.height - top - height
        share = (left / self.width, bottom / self.height, width / self.width, height / self.height)
        with _settings(""):
            return self.figure.add_axes(share)

    def line(self, points: Floats, color: str = TEXT, width: float = 1.5) -> None:
        """Draw a polyline through points (N, 2); it is broken where they are not finite."""
        from matplotlib.lines import Line2D

        x, y = np.asarray(points, dtype=np.float64).reshape(-1, 2).T
        self._add(Line2D(x, y, color=color, linewidth=width, solid_capstyle="butt"))

    def box(self, x: float, y: float, width: float, height: float, color: str, opacity: float = 1.0) -> None:
        """Fill a rectangle."""
        from matplotlib.patches import Polygon

        corners = np.array([(x, y), (x + width, y), (x + width, y + height), (x, y + height)], np.float64)
        self._add(Polygon(corners, closed=True, facecolor=color, edgecolor="none", alpha=opacity))

    def dot(self, x: float, y: float, radius: float, color: str) -> None:
        """Fill a circle."""
        from matplotlib.patches import Circle

        self._add(Circle((x, y), radius, facecolor=color, edgecolor="none"))

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
        from matplotlib.text import Text

        side: Any = {"start": "left", "middle": "center", "end": "right"}[anchor]
        weight = "bold" if bold else "normal"
        written = Text(
            x, y, " ".join(text.split()), color=color, fontsize=size, fontweight=weight, fontfamily=FONT,
            horizontalalignment=side, verticalalignment="baseline", parse_math=False,
        )  # fmt: skip
        self._add(written)

    def runs(self, x: float, y: float, runs: tuple[Run, ...], anchor: str = "start") -> None:
        """Write several parts of text in one line, with gaps between them."""
        widths = [text_width(run.text, run.size, run.bold) for run in runs]
        x -= {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor] * (sum(widths) + _GAP * (len(runs) - 1))
        for run, width in zip(runs, widths, strict=True):
            self.text(x, y, run.text, run.size, run.color, bold=run.bold)
            x += width + _GAP

    def picture(
        self, rgba: Uint8, x: float, y: float, width: float, height: float, png: bytes | None = None
    ) -> None:
        """Draw a picture (H, W, 4) uint8 below all other items; ``png`` is the same as PNG, if known."""
        from matplotlib.image import AxesImage

        picture = AxesImage(self.page, extent=(x, x + width, y + height, y), origin="upper")
        picture.set_data(rgba)
        self._pictures.append(_Picture(picture, rgba, (x, y, width, height), png))
        self._add(picture)
        picture.set_zorder(0)

    def svg(self, paper: str | None = PAPER) -> str:
        """Return the drawing as SVG text; ``paper`` None leaves the background transparent.

        The text has no document type, no style sheet and no ids of groups, so that several drawings can
        be parts of one HTML page.
        """
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        file = io.StringIO()
        for picture in self._pictures:
            picture.drawn.set_visible(False)
        with _settings(self.about):
            self.figure.savefig(file, format="svg", dpi=_POINTS_PER_INCH, facecolor="none", metadata=nothing)
        for picture in self._pictures:
            picture.drawn.set_visible(True)
        size = f"{self.width:.6g}", f"{self.height:.6g}"
        head = (
            '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
            f' viewBox="0 0 {size[0]} {size[1]}" width="{size[0]}" height="{size[1]}" role="img"'
            f' aria-label="{escape(self.about)}" stroke-linejoin="round" stroke-linecap="butt">'
        )
        if paper is not None:
            head += f'<rect width="{size[0]}" height="{size[1]}" fill="{paper}"/>'
        body = _PROLOG.sub("", _STYLE.sub("", file.getvalue(), count=1), count=1)
        return head + "".join(picture.svg for picture in self._pictures) + _GROUP_ID.sub("<g", body)

    def png(self, scale: float = 2.0) -> bytes:
        """Return the drawing as PNG on white, with ``scale`` pixels per point."""
        return png_of(self.paint(scale))

    def paint(self, scale: float) -> Uint8:
        """Return the drawing as pixels (H, W, 3) on white, with ``scale`` pixels per point."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        for picture in self._pictures:
            grown = picture.place[2] * scale >= picture.rgba.shape[1]
            picture.drawn.set_interpolation("nearest" if grown else "antialiased")
        with _settings(self.about):
            self.figure.set_facecolor(PAPER)
            self.figure.set_dpi(_POINTS_PER_INCH * scale)
            canvas: Any = FigureCanvasAgg(self.figure)
            canvas.draw()
            painted: Uint8 = np.asarray(canvas.buffer_rgba())[..., :3].copy()
            self.figure.set_dpi(_POINTS_PER_INCH)
        return painted

    def _add(self, item: Artist) -> None:
        """Lay an item over those before it."""
        self._items.append(item)
        item.set_zorder(len(self._items))
        self.page.add_artist(item).set_clip_on(False)


def text_width(text: str, size: float, bold: bool = False) -> float:
    """Return the width of a text, in points."""
    with _settings(""):
        from matplotlib.font_manager import FontProperties
        from matplotlib.textpath import text_to_path

        font = FontProperties(family=FONT, size=size, weight="bold" if bold else "normal")
        width, _, _ = text_to_path.get_text_width_height_descent(text, font, ismath=False)
    return float(width)


def png_of(pixels: Uint8) -> bytes:
    """Return a picture (H, W, 3 or 4) uint8 as PNG."""
    from PIL import Image

    file = io.BytesIO()
    # Runs of equal bytes only: a third faster, and 3 % larger. Measured on the figures of a session.
    Image.fromarray(pixels).save(file, "PNG", compress_type=zlib.Z_RLE)
    return file.getvalue()


def webp_of(pixels: Uint8) -> bytes:
    """Return a picture (H, W, 4) uint8 as WebP without loss; a third smaller than a PNG."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "WEBP", lossless=True)
    return file.getvalue()


def data_url(data: bytes, kind: str) -> str:
    """Return bytes as a data URL."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def check_matplotlib() -> None:
    """Check that drawings can be made.

    Raises
    ------
    FlatclothError
        If matplotlib is not installed.
    """
    try:
        import matplotlib as mpl  # noqa: F401
    except ImportError as error:
        raise FlatclothError("Figures need matplotlib: pip install 'flatcloth[export]'") from error


def load_matplotlib() -> None:
    """Load what drawings need of matplotlib, which takes half a second."""
    check_matplotlib()
    from matplotlib.backends import backend_agg, backend_svg  # noqa: F401
    from matplotlib.figure import Figure  # noqa: F401


@contextmanager
def _settings(salt: str) -> Iterator[None]:
    """Set matplotlib's settings to those of a drawing."""
    check_matplotlib()
    import matplotlib as mpl

    ours: Any = {
        "font.family": [FONT],
        "svg.fonttype": "none",
        "svg.hashsalt": f"flatcloth {salt}",
        "svg.image_inline": True,
        "image.composite_image": False,
    }
    with _RENDERING, warnings.catch_warnings(), mpl.rc_context(ours):
        # In SVG the reader's fonts have the signs that this font lacks.
        warnings.filterwarnings("ignore", r"Glyph .* missing from")
        yield
