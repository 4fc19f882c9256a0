"""Refinement of a placement: the motion of samples on the plane that fits them to the surface they cover."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flatcloth.core.compiled import njit
from flatcloth.core.graphs import cell_of
from flatcloth.core.types import Float64, Int32, Rigid2

_STILL = 1e-5
"""The rounds end after a smaller step than this (rad, m). Chosen: far below the errors of a placement."""


class Samples(NamedTuple):
    """Points of cloth: ``uv_m`` (K, 2) on their plane, ``xyz_m`` and unit ``normal`` (K, 3) in space."""

    uv_m: Float64
    xyz_m: Float64
    normal: Float64


class Nodes(NamedTuple):
    """Nodes of a surface, as :class:`Samples`; ``frames`` (N, 3, 2) isometries from the plane to space.

    ``first`` (cells + 1,) and ``by_cell`` (N,) are the table of :class:`.nearest.NearPoints`, which finds
    them within ``within_m``; ``cell_uv_m`` (N, 2) are their places in the order of ``by_cell``.
    """

    uv_m: Float64
    xyz_m: Float64
    normal: Float64
    frames: Float64
    cell_uv_m: Float64
    first: Int32
    by_cell: Int32
    within_m: float


def fitted(
    nodes: Nodes, samples: Samples, initial: Rigid2, radii_m: tuple[float, float], rounds: int
) -> tuple[Rigid2, Float64 | None]:
    """Fit the samples in space to the surface that they cover, by Gauss-Newton with robust weights.

    Parameters
    ----------
    nodes, samples : Nodes, Samples
        The surface, and what covers it.
    initial : Rigid2
        Motion from the samples' plane to that of the nodes.
    radii_m : (float, float)
        Distance in space, m, at which a sample has a quarter of its weight: at first, and at least.
    rounds : int
        Most steps.

    Returns
    -------
    (Rigid2, (3, 3) float64 or None)
        The motion, and its information (rotation about the middle of the covered samples, u, v) in units of
        the weights; None if too few samples cover the surface.
    """
    motion, sums = _fitted(nodes, samples, (initial.theta_rad, initial.u_m, initial.v_m), radii_m, rounds)
    total, arm_u, arm_v, square = sums
    found = Rigid2() @ Rigid2(*motion)  # with the angle in (-pi, pi]
    if total <= 0.0:
        return found, None
    return found, np.array([[square, -arm_v, arm_u], [-arm_v, total, 0.0], [arm_u, 0.0, total]])


@njit(cache=True, nogil=True, error_model="numpy")
def _fitted(
    nodes: Nodes,
    samples: Samples,
    motion: tuple[float, float, float],
    radii: tuple[float, float],
    rounds: int,
) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    """Return the motion, and the sums over the samples of weight, arm (u, v) and squared arm; see `fitted`.

    A sample keeps its nearest node until it has moved so far that another one may be nearer.
    """
    count, sums, radius = len(samples.uv_m), (0.0, 0.0, 0.0, 0.0), radii[0]
    place, room = np.zeros((count, 2)), np.full(count, -1.0)
    nearest, under = np.full(count, -1, dtype=np.int32), np.empty(count, dtype=np.int32)
    for _ in range(rounds):
        cos, sin = math.cos(motion[0]), math.sin(motion[0])
        covered, middle_u, middle_v = 0, 0.0, 0.0
        for k in range(count):
            u = cos * samples.uv_m[k, 0] - sin * samples.uv_m[k, 1] + motion[1]
            v = sin * samples.uv_m[k, 0] + cos * samples.uv_m[k, 1] + motion[2]
            room[k] -= math.sqrt((u - place[k, 0]) ** 2 + (v - place[k, 1]) ** 2)
            if room[k] < 0.0:
                nearest[k], room[k] = _nearest_for_long(u, v, nodes)
            place[k, 0], place[k, 1], under[k], n = u, v, -1, nearest[k]
            if n >= 0 and (nodes.uv_m[n, 0] - u) ** 2 + (nodes.uv_m[n, 1] - v) ** 2 < nodes.within_m**2:
                under[k] = n
                covered, middle_u, middle_v = covered + 1, middle_u + u, middle_v + v
        middle = (middle_u / max(covered, 1), middle_v / max(covered, 1))
        sums, right = _summed(nodes, samples, place, under, middle, radius)
        total, arm_u, arm_v, square = sums
        if total < 3.0:
            # A motion has three unknowns.
            return motion, (0.0, 0.0, 0.0, 0.0)
        each = total + 1e-9  # so that a step is found for samples at one place
        turn = right[0] + (arm_v * right[1] - arm_u * right[2]) / each
        turn /= square + 1e-9 - (arm_u * arm_u + arm_v * arm_v) / each
        shift_u, shift_v = (right[1] + arm_v * turn) / each, (right[2] - arm_u * turn) / each
        cos, sin = math.cos(turn), math.sin(turn)
        off_u, off_v = motion[1] - middle[0], motion[2] - middle[1]
        motion = (
            motion[0] + turn,
            cos * off_u - sin * off_v + middle[0] + shift_u,
            sin * off_u + cos * off_v + middle[1] + shift_v,
        )
        radius = max(0.5 * radius, radii[1])
        if max(abs(turn), math.hypot(shift_u, shift_v)) < _STILL:
            break
    return motion, sums


@njit(cache=True, nogil=True, error_model="numpy")
def _nearest_for_long(u: float, v: float, nodes: Nodes) -> tuple[int, float]:
    """Return the node nearest to a place, -1 if none is near, and how far it may move before that changes."""
    within, cells = nodes.within_m, nodes.first.size - 1
    column, row = math.floor(u / within), math.floor(v / within)
    right, down = u - column * within, v - row * within
    least, second, found = np.inf, np.inf, -1
    for c in range(-1, 2):
        for r in range(-1, 2):
            cell = cell_of(column + c, row + r, 0, cells)
            for p in range(nodes.first[cell], nodes.first[cell + 1]):
                du, dv = nodes.cell_uv_m[p, 0] - u, nodes.cell_uv_m[p, 1] - v
                apart = du * du + dv * dv
                if apart < least:
                    least, second, found = apart, least, nodes.by_cell[p]
                elif apart < second:
                    second = apart
    # Beyond the nine squares there may be others.
    known = within + min(min(right, within - right), min(down, within - down))
    least, second = math.sqrt(least), min(math.sqrt(second), known)
    if least < within:
        return found, 0.5 * (second - least)
    return -1, min(least, known) - within


@njit(cache=True, nogil=True, error_model="numpy")
def _summed(
    nodes: Nodes, samples: Samples, place: Float64, under: Int32, middle: tuple[float, float], radius: float
) -> tuple[tuple[float, float, float, float], tuple[float, float, float]]:
    """Sum the normal equations over the samples that have a node ``under`` them (K,), -1 for none.

    The columns of a frame are unit vectors, perpendicular to each other, so that few of the sums differ.
    """
    total, arms_u, arms_v, square, turn, pull_u, pull_v = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(under.size):
        n = under[k]
        if n < 0:
            continue
        facing, apart, along_u, along_v = 0.0, 0.0, 0.0, 0.0
        off_u, off_v = place[k, 0] - nodes.uv_m[n, 0], place[k, 1] - nodes.uv_m[n, 1]
        for a in range(3):
            one, other = nodes.frames[n, a, 0], nodes.frames[n, a, 1]
            facing += samples.normal[k, a] * nodes.normal[n, a]
            off = samples.xyz_m[k, a] - nodes.xyz_m[n, a] - one * off_u - other * off_v
            apart += off * off
            along_u += one * off
            along_v += other * off
        if facing <= 0.5:
            continue
        weight = 1.0 / (1.0 + apart / (radius * radius)) ** 2
        arm_u, arm_v = place[k, 0] - middle[0], place[k, 1] - middle[1]
        total += weight
        arms_u += weight * arm_u
        arms_v += weight * arm_v
        square += weight * (arm_u * arm_u + arm_v * arm_v)
        turn += weight * (along_v * arm_u - along_u * arm_v)
        pull_u += weight * along_u
        pull_v += weight * along_v
    return (total, arms_u, arms_v, square), (turn, pull_u, pull_v)
