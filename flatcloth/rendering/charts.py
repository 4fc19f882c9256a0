"""The charts of the exports: curves, steps and scales with plain axes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flatcloth.core.types import Float64, Floats
from flatcloth.rendering.drawing import BLUE, GRID, LINE, SOFT, TEXT, Drawing, Run

SIZE, SMALL = 12.0, 11.0


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

    def place(self, x: Floats, y: Floats) -> Float64:
        """Return the positions of values on the drawing, (N, 2)."""
        low, high = self.y_range
        values = np.asarray(y, dtype=np.float64)
        if self.log_y:
            values = np.log10(np.maximum(values, 1e-300))
            low, high = math.log10(low), math.log10(high)
        across = (np.asarray(x, dtype=np.float64) - self.x_range[0]) / _span(self.x_range)
        up = (values - low) / (high - low if high > low else 1.0)
        return np.stack([self.left + self.width * across, self.top + self.height * (1 - up)], axis=1)


def draw_axes(
    drawing: Drawing,
    frame: Frame,
    x_label: str,
    y_label: str,
    x_ticks: Sequence[tuple[float, str]] | None = None,
) -> None:
    """Draw grid, axes, ticks and labels; the label of y is above its axis, horizontal."""
    y_ticks = _powers(frame.y_range) if frame.log_y else ticks(*frame.y_range)
    for value, label in y_ticks:
        y = float(frame.place(np.array([frame.x_range[0]]), np.array([value]))[0, 1])
        drawing.line(np.array([(frame.left, y), (frame.left + frame.width, y)]), GRID, 1.0)
        drawing.text(frame.left - 7, y + 4, label, SMALL, SOFT, "end")
    bottom = frame.top + frame.height
    for value, label in x_ticks if x_ticks is not None else ticks(*frame.x_range):
        x = float(frame.place(np.array([value]), np.array([frame.y_range[0]]))[0, 0])
        drawing.line(np.array([(x, bottom), (x, bottom + 4)]), LINE, 1.0)
        for n, line in enumerate(label.split("\n")):
            drawing.text(x, bottom + 17 + 13 * n, line, SMALL, SOFT, "middle")
    drawing.line(np.array([(frame.left, bottom), (frame.left + frame.width, bottom)]), LINE, 1.0)
    drawing.text(frame.left - 7, frame.top - 12, y_label, SIZE, TEXT)
    drawing.text(frame.left + frame.width, bottom + 34, x_label, SIZE, TEXT, "end")


def draw_key(drawing: Drawing, x: float, y: float, entries: Sequence[tuple[str, str]]) -> None:
    """Draw a key with one (color, label) per line."""
    for n, (color, label) in enumerate(entries):
        drawing.box(x, y + 18 * n - 9, 11, 11, color)
        drawing.text(x + 17, y + 18 * n, label, SMALL, TEXT)


def draw_title(drawing: Drawing, title: str, about: str = "") -> None:
    """Write the title, with its explanation beside it."""
    beside = (Run(about, SIZE, SOFT),) if about else ()
    drawing.runs(16, 26, (Run(title, 15, TEXT, bold=True), *beside))
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
    step = height / len(colors)
    for n, color in enumerate(colors):
        # Slightly higher than its share, so that no background shows between two colours.
        drawing.box(x, y + height - step * (n + 1) - 0.3, 14, step + 0.3, color)
    for value, label in ticks(low, high, most=6):
        at = y + height * (1 - (value - low) / (high - low if high > low else 1.0))
        drawing.line(np.array([(x + 14, at), (x + 18, at)]), LINE, 1.0)
        drawing.text(x + 22, at + 4, label, SMALL, SOFT)


def bars(drawing: Drawing, frame: Frame, x: Floats, low: Floats, high: Floats, color: str = BLUE) -> None:
    """Draw a bar from ``low`` to ``high`` (N,) about each x (N,), spaced by 1."""
    half = 0.36 * frame.width / _span(frame.x_range)
    for (at, bottom), (_, top) in zip(frame.place(x, low), frame.place(x, high), strict=True):
        drawing.box(at - half, min(top, bottom), 2 * half, abs(bottom - top), color)


def ticks(low: float, high: float, most: int = 6) -> list[tuple[float, str]]:
    """Return round values from low to high with their labels, at most ``most`` + 1."""
    if not (math.isfinite(low) and math.isfinite(high)) or high <= low:
        return [(low, f"{low:g}")] if math.isfinite(low) else []
    step = nice_below((high - low) / most * 1.9999)
    while (high - low) / step > most:
        step = nice_below(step * 2.5)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    return [(n * step, f"{n * step:.{digits}f}".replace("-", "\u2212")) for n in range(first, last + 1)]


def nice_below(value: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is at most the value."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(factor * power for factor in (5, 2, 1, 0.5) if factor * power <= value * (1 + 1e-9))


def _powers(values: tuple[float, float]) -> list[tuple[float, str]]:
    low, high = math.floor(math.log10(values[0]) + 1e-9), math.ceil(math.log10(values[1]) - 1e-9)
    step = max(1, math.ceil((high - low) / 6))
    return [
        (10.0**n, f"1e{n}")
        for n in range(low, high + 1, step)
        if values[0] <= 10.0**n * 1.0001 <= values[1] * 1.001
    ]


def _span(values: tuple[float, float]) -> float:
    return values[1] - values[0] if values[1] > values[0] else 1.0
