"""Figures by matplotlib in one style, as SVG and PNG.

Only matplotlib's objects are used, never pyplot, which keeps figures in global state and would leak them in
a server. The same drawing gives the same bytes: ids have a fixed salt, and no date is written. matplotlib is
part of the ``export`` extra and loads with the first drawing.
"""

from __future__ import annotations

import base64
import io
import math
import re
import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Uint8
from flatcloth.rendering.pictures import PlanePicture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TEXT, SOFT, LINE, GRID, PAPER = "#1a1f26", "#55606d", "#9aa4af", "#e3e7eb", "#ffffff"
BLUE, ORANGE, GREEN, PINK = "#1766c2", "#d9822b", "#1f7a4d", "#d81b72"

SMALL = 11.0
"""Size of the smaller text (points). Chosen."""
_POINTS_PER_INCH = 72.0
"""By definition."""
_RAMP = (14.0, 170.0)
"""Width and height (points) of a colour scale. Chosen."""
_STYLE: Any = {
    "font.family": ["DejaVu Sans"],  # matplotlib brings it along: a text is as wide on every machine
    "font.size": SMALL, "text.color": TEXT,
    "axes.spines.left": False, "axes.spines.top": False, "axes.spines.right": False,
    "axes.edgecolor": LINE, "axes.axisbelow": True, "axes.grid": True, "axes.grid.axis": "y",
    "grid.color": GRID, "grid.linewidth": 1.0,
    "axes.titlelocation": "left", "axes.titlesize": 12.0, "axes.titlepad": 9.0,
    "xaxis.labellocation": "right",
    "xtick.color": LINE, "xtick.labelcolor": SOFT, "ytick.color": LINE, "ytick.labelcolor": SOFT,
    "ytick.major.size": 0.0, "ytick.minor.size": 0.0,
    "lines.linewidth": 1.6, "lines.markeredgewidth": 0.0,
    "legend.frameon": False, "legend.borderaxespad": 0.0,
    "legend.handlelength": 1.0, "legend.handleheight": 1.0,
    "svg.fonttype": "none", "svg.hashsalt": "flatcloth", "image.composite_image": False,
}  # fmt: skip
_RENDERING = threading.RLock()
"""Held while matplotlib's settings, which are global, are those of a drawing."""


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


@contextmanager
def style() -> Iterator[None]:
    """Set matplotlib's settings to those of a drawing, for making and for writing it."""
    check_matplotlib()
    import matplotlib as mpl

    with _RENDERING, warnings.catch_warnings(), mpl.rc_context(_STYLE):
        # In SVG the reader's fonts have the signs that this font lacks.
        warnings.filterwarnings("ignore", r"Glyph .* missing from")
        yield


def svg_of(figure: Figure, about: str) -> str:
    """Return a figure as SVG; pictures keep their own pixels, and text stays text.

    ``about`` is its description for readers who cannot see it.
    """
    metadata = {"Title": about, "Date": None, "Creator": None, "Format": None, "Type": None}
    text = _saved(figure, "svg", 1.0, metadata, "none").decode()
    # A point is a pixel of the screen, so that text is as large as that of a page around it.
    return re.sub(r'(width|height)="([\d.]+)pt"', r'\1="\2"', text, count=2)


def painted(figure: Figure, scale: float = 2.0) -> bytes:
    """Return a figure as PNG on white, with ``scale`` pixels per point."""
    return _saved(figure, "png", scale, {"Software": None}, "auto")


@style()
def _saved(
    figure: Figure, kind: str, scale: float, metadata: dict[str, str | None], interpolation: str
) -> bytes:
    from matplotlib.image import AxesImage

    for image in figure.findobj(AxesImage):
        image.set_interpolation(interpolation)
    file = io.BytesIO()
    # What lies around the axes makes the figure as large as it needs.
    around: dict[str, Any] = {"bbox_inches": "tight", "pad_inches": 0.2}
    figure.savefig(file, format=kind, dpi=_POINTS_PER_INCH * scale, metadata=metadata, **around)
    return file.getvalue()


def figure_of(width: float, height: float) -> Figure:
    """Return an empty figure of this size (points).

    Raises
    ------
    FlatclothError
        If matplotlib is not installed.
    """
    check_matplotlib()
    from matplotlib.figure import Figure

    return Figure(figsize=(width / _POINTS_PER_INCH, height / _POINTS_PER_INCH), dpi=_POINTS_PER_INCH)


@style()
def drawn(
    width: float, height: float, title: str, about: str = "", rows: int = 1
) -> tuple[Figure, list[Axes]]:
    """Return a figure with axes one above the other, which fill this size (points).

    Title, labels and legends lie around the axes; ``about`` is below the title.
    """
    figure = figure_of(width, height)
    whole = {"left": 0.0, "right": 1.0, "bottom": 0.0, "top": 1.0, "hspace": 0.4}
    axes = figure.subplots(rows, sharex=True, squeeze=False, gridspec_kw=whole)[:, 0].tolist()
    axes[0].set_title(about, parse_math=False)
    axes[0].annotate(
        title, (0.0, 1.0), (0.0, 30.0 if about else 10.0), "axes fraction", "offset points",
        fontsize=15, fontweight="bold", parse_math=False,
    )  # fmt: skip
    return figure, axes


@style()
def show_picture(axes: Axes, picture: PlanePicture, most: float) -> None:
    """Show a picture of the plane, whose u and v (m) are then the data, with a scale bar below it.

    ``most`` is the share of the picture's width that the scale bar has at most.
    """
    rows, cols = picture.rgba.shape[:2]
    left, top = np.array(picture.origin_uv_m) - picture.pixel_size_m / 2
    right, bottom = left + cols * picture.pixel_size_m, top + rows * picture.pixel_size_m
    axes.imshow(picture.rgba, extent=(left, right, bottom, top))
    axes.set_axis_off()
    length_m = nice_below(most * (right - left))
    axes.plot(
        [left, left + length_m], [-0.04, -0.04], "|-", color=TEXT, markeredgewidth=1.6, clip_on=False,
        transform=axes.get_xaxis_transform(),
    )  # fmt: skip
    axes.annotate(
        f"{1000 * length_m:g} mm", (left + length_m / 2, -0.04), (0.0, -6.0), ("data", "axes fraction"),
        "offset points", ha="center", va="top",
    )  # fmt: skip


@style()
def add_key(axes: Axes, entries: Sequence[tuple[str, str]], title: str = "") -> None:
    """Add a key to the right of the axes, with one (color, label) per line."""
    from matplotlib.patches import Patch

    patches = [Patch(facecolor=color, label=label) for color, label in entries]
    axes.legend(handles=patches, title=title, loc="upper left", bbox_to_anchor=(1.04, 1.0), alignment="left")


@style()
def add_ramp(axes: Axes, title: str, colors: Sequence[str], low: float, high: float) -> None:
    """Add a colour scale with its ticks to the right of the axes, the first colour at the bottom."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    known = math.isfinite(low) and math.isfinite(high)
    width, height = axes.bbox.width, axes.bbox.height  # in points, as figures have one pixel for each
    scale = axes.inset_axes((1.06, 1.0 - (_RAMP[1] + 16.0) / height, _RAMP[0] / width, _RAMP[1] / height))
    values = Normalize(low, high if high > low else low + 1.0) if known else Normalize(0.0, 1.0)
    axes.figure.colorbar(ScalarMappable(values, ListedColormap(colors)), scale)
    if not (known and high > low):
        scale.set_yticks([low] if known else [])
    scale.set_title(title, fontsize=SMALL)


def nice_below(value: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is at most the value."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(factor * power for factor in (5, 2, 1, 0.5) if factor * power <= value * (1 + 1e-9))


def webp_of(pixels: Uint8) -> bytes:
    """Return a picture (H, W, 4) uint8 as WebP without loss; a third smaller than a PNG."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "WEBP", lossless=True)
    return file.getvalue()


def data_url(data: bytes, kind: str) -> str:
    """Return bytes as a data URL."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"
