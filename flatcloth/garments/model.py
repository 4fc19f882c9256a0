"""Parametric flat outlines: symmetric about the middle line, given by the nodes of their right half.

The garment frame: x to the right of the upright picture as seen from outside, y down, metres. An
outline runs clockwise as drawn, from the middle of the top over the right side to the middle of
the bottom, and back over the left side.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.types import Float64

_CURVE_STEPS = 6
"""Straight pieces that a curved stretch is drawn with. Set by hand."""

ARTF = "ranges of the aRTF templates (Lips et al. 2024, synthetic-cloth-data, cloth_meshes.py), widened"
SIZES = "EN 13402-3 body girths, children 116 to adult 3XL, with 0 to 30 % ease; half of the girth lies flat"
FREE = "no table: wide"
"""Sources of priors and ranges, which are wide: a standard deviation covers small children's to large adults'
sizes."""


@dataclass(frozen=True)
class Parameter:
    """One number of an outline: its prior (``mean``, ``std``) and the range it is held to.

    ``source`` says where prior and range come from; ``unit`` is ``m``, ``rad`` or ``1`` (a ratio).
    """

    name: str
    mean: float
    std: float
    low: float
    high: float
    source: str
    unit: str = "m"


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of garment.

    Parameters
    ----------
    name : str
        The kind's name in files and on the page.
    parameters : tuple of Parameter
        The numbers of its outline.
    nodes : callable
        Takes the parameters (P, n) of n outlines and returns the nodes of the right half and the
        control points of its curves, (M, 2, n).
    stretches : tuple of (int, int) or (int, int, int)
        The right half, from the middle of the top to the middle of the bottom: the nodes where each stretch
        begins and ends, and of a curved one the control point that it is bent towards.
    points : mapping of str to int
        The node of each named point of the right half. A name that ends in ``_right`` has a mirror
        image ``_left``; others lie on the middle line.
    corners : tuple of (str, str), optional
        For a kind without left and right: its points in their order round, as names of ``points``.
    dimensions : mapping of str to (str, str)
        Each dimension as the two named points whose distance it is.
    """

    name: str
    parameters: tuple[Parameter, ...]
    nodes: Callable[[Float64], Float64]
    stretches: tuple[tuple[int, ...], ...]
    points: Mapping[str, int]
    dimensions: Mapping[str, tuple[str, str]]
    corners: Mapping[str, str] | None = None

    @cached_property
    def mean(self) -> Float64:
        """(P,) prior means."""
        return np.array([p.mean for p in self.parameters])

    @cached_property
    def std(self) -> Float64:
        """(P,) prior standard deviations."""
        return np.array([p.std for p in self.parameters])

    @cached_property
    def low(self) -> Float64:
        """(P,) smallest values."""
        return np.array([p.low for p in self.parameters])

    @cached_property
    def high(self) -> Float64:
        """(P,) largest values."""
        return np.array([p.high for p in self.parameters])

    @cached_property
    def _half(self) -> Float64:
        """(V, M) the weights of nodes and control points in each vertex of the right half."""
        unit = np.eye(len(self.nodes(self.mean[:, None])))
        rows: list[Float64] = []
        for begin, end, *control in self.stretches:
            if not control:
                rows.append(unit[begin])
                continue
            a, b, c = unit[[begin, *control, end]]
            steps = np.arange(_CURVE_STEPS) / _CURVE_STEPS
            rows += [(1 - t) ** 2 * a + 2 * t * (1 - t) * b + t**2 * c for t in steps]
        rows.append(unit[self.stretches[-1][1]])
        return np.array(rows)

    def outline(self, parameters: Float64) -> Float64:
        """Return the closed outlines (V, 2, n) of parameters (P, n); the first vertex is not repeated."""
        nodes = self.nodes(parameters)
        half = (self._half @ nodes.reshape(len(nodes), -1)).reshape(-1, *nodes.shape[1:])
        left = half[-1:0:-1] * np.array([-1.0, 1.0])[None, :, None]
        closed: Float64 = np.concatenate([half[:-1], left])
        return closed

    def named(self, parameters: Float64) -> dict[str, Float64]:
        """Return the named points, each (2, n), of parameters (P, n)."""
        nodes = self.nodes(parameters)
        mirror = np.array([-1.0, 1.0])[:, None]
        found: dict[str, Float64] = {}
        for name, node in self.points.items():
            found[name] = nodes[node]
            if name.endswith("_right"):
                found[name.removesuffix("_right") + "_left"] = nodes[node] * mirror
        if self.corners is not None:
            found = {corner: found[name] for corner, name in self.corners.items()}
        return found


def with_slope(function: Callable[[Float64], Float64], x: Float64) -> tuple[Float64, Float64]:
    """Return the values (...) of a function at x (D,) and their derivatives (..., D), by central differences.

    The function takes n arguments at once, (D, n), and returns (..., n).
    """
    step, size = 1e-5, len(x)  # far above rounding, far below any curvature
    values = function(x[:, None] + _moved(size, step))
    slope: Float64 = (values[..., 1 : size + 1] - values[..., size + 1 :]) / (2.0 * step)
    return values[..., 0], slope


@cache
def _moved(size: int, step: float) -> Float64:
    """Return no motion and a step of each argument in either direction, (D, 1 + 2 D)."""
    moved = step * np.eye(size)
    return np.concatenate([np.zeros((size, 1)), moved, -moved], axis=1)


def stacked(*points: tuple[NDArray[np.float64] | float, NDArray[np.float64] | float]) -> Float64:
    """Return nodes (M, 2, n) given as pairs of coordinates, each a number or (n,)."""
    nodes = np.empty((len(points), 2, *np.shape(points[0][0])))
    for node, (x, y) in zip(nodes, points, strict=True):
        node[0], node[1] = x, y
    return nodes.reshape(len(points), 2, -1)
