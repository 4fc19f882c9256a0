"""The charts of the exports: matplotlib's axes in the house style, keys, scales and scale bars."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flatcloth.rendering.drawing import FONT, GRID, LINE, SOFT, TEXT, Drawing, Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIZE, SMALL = 12.0, 11.0
"""Sizes of the text (px). Chosen."""
_STEPS = (1, 2, 5, 10)
"""Steps of ticks, times a power of ten: the usual ones."""
_RAMP_WIDTH = 14.0
"""Width (px) of a color ramp. Chosen."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A plot's rectangle on a drawing (points) and its ranges of values; ``log_y`` counts powers of ten."""

    left: float
    top: float
    width: float
    height: float
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    log_y: bool = False


def draw_axes(
    drawing: Drawing,
    frame: Frame,
    x_label: str,
    y_label: str,
    x_ticks: Sequence[tuple[float, str]] | None = None,
) -> Axes:
    """Add axes with grid, ticks and labels; the label of y is above its axis, horizontal."""
    from matplotlib.ticker import MaxNLocator

    axes = drawing.axes(frame.left, frame.top, frame.width, frame.height)
    axes.set(xlim=_widened(frame.x_range), ylim=_widened(frame.y_range))
    axes.patch.set_visible(False)
    axes.spines[["left", "top", "right"]].set_visible(False)
    axes.spines["bottom"].set(color=LINE, linewidth=1.0)
    axes.set_axisbelow(True)
    if frame.log_y:
        axes.set_yscale("log")
    else:
        axes.yaxis.set_major_locator(MaxNLocator(6, steps=_STEPS))
    if x_ticks is None:
        axes.xaxis.set_major_locator(MaxNLocator(8, steps=_STEPS))
    else:
        axes.set_xticks([value for value, _ in x_ticks], [label for _, label in x_ticks])
    axes.grid(axis="y", color=GRID, linewidth=1.0)
    axes.tick_params(which="both", labelsize=SMALL, labelcolor=SOFT, color=LINE)
    axes.tick_params(axis="y", which="both", length=0, pad=6)
    axes.tick_params(axis="x", length=4, pad=4)
    axes.set_title(y_label, loc="left", fontsize=SIZE, color=TEXT, pad=9, y=1.0)
    axes.set_xlabel(x_label, loc="right", fontsize=SIZE, color=TEXT)
    return axes


def draw_key(drawing: Drawing, x: float, y: float, entries: Sequence[tuple[str, str]]) -> None:
    """Draw a key with one (color, label) per line; (x, y) is its upper left corner."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.patches import Patch

    key = drawing.figure.legend(
        handles=[Patch(facecolor=color, edgecolor="none", label=label) for color, label in entries],
        loc="upper left", bbox_to_anchor=(x, y), bbox_transform=drawing.page.transData, frameon=False,
        borderpad=0, borderaxespad=0, handlelength=1, handleheight=1, handletextpad=0.6, labelspacing=0.5,
        labelcolor=TEXT, prop=FontProperties(family=FONT, size=SMALL),
    )  # fmt: skip
    for text in key.get_texts():
        text.set_parse_math(False)


def draw_title(drawing: Drawing, title: str, about: str = "") -> None:
    """Write the title, followed by its explanation."""
    explanation = (Run(about, SIZE, SOFT),) if about else ()
    drawing.runs(16, 26, (Run(title, 15, TEXT, bold=True), *explanation))
    drawing.about = f"{title}. {about}".strip()


def draw_scale_bar(drawing: Drawing, x: float, y: float, points_per_m: float, most: float) -> None:
    """Draw a scale bar of a round length, at most ``most`` points long, with its left end at (x, y)."""
    length_m = nice_below(most / points_per_m)
    width = length_m * points_per_m
    drawing.line(np.array([(x, y - 5), (x, y), (x + width, y), (x + width, y - 5)]), TEXT, 1.5)
    drawing.text(x + width / 2, y - 7, f"{1000 * length_m:g} mm", SMALL, TEXT, "middle")


def draw_ramp(
    drawing: Drawing, x: float, y: float, height: float, colors: Sequence[str], low: float, high: float
) -> None:
    """Draw a colour scale with its ticks, the first colour at the bottom."""
    from matplotlib.colors import to_rgba_array
    from matplotlib.ticker import MaxNLocator

    known = math.isfinite(low) and math.isfinite(high)
    bottom, top = _widened((low, high)) if known else (0.0, 1.0)
    axes = drawing.axes(x, y, _RAMP_WIDTH, height)
    axes.imshow(
        to_rgba_array(colors)[:, None], extent=(0.0, 1.0, bottom, top), origin="lower", aspect="auto",
        interpolation="none",
    )  # fmt: skip
    axes.spines[:].set_visible(False)
    axes.set_xticks([])
    axes.yaxis.tick_right()
    axes.yaxis.set_major_locator(MaxNLocator(6, steps=_STEPS))
    if not (known and high > low):
        axes.set_yticks([low] if known else [])
    axes.tick_params(axis="y", labelsize=SMALL, labelcolor=SOFT, color=LINE, length=4, pad=4)


def nice_below(value: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is at most the value."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(factor * power for factor in (5, 2, 1, 0.5) if factor * power <= value * (1 + 1e-9))


def _widened(values: tuple[float, float]) -> tuple[float, float]:
    return (values[0], values[1] if values[1] > values[0] else values[0] + 1.0)
