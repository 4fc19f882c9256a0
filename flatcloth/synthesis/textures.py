"""The colors of the cloth: generated patterns in metres of cloth, or the mesh's own colors."""

from __future__ import annotations

import colorsys
from collections.abc import Callable

import numpy as np
from scipy import ndimage

from flatcloth.core.types import Float64, Int32, Int64
from flatcloth.synthesis.meshes import GarmentMesh

PATTERNS = ("checker", "floral", "stripes", "plain")
Texture = str | Callable[[Float64, int], Float64]
"""A pattern's name, or a function of places (N, 2) and panel that returns colors as ``pattern_rgb``."""
_FLOWER_CELL_M = 0.026
"""Size of a flower of the print. Chosen."""


def pattern_rgb(kind: Texture, uv_m: Float64, panel: int, seed: int) -> Float64:
    """Return the colors (N, 3), 0 to 1, of a pattern at positions (N, 2) of a panel.

    The seed chooses the colors and the layout of a generated one; every panel has its own shade.
    """
    if not isinstance(kind, str):
        return kind(uv_m, panel)
    random = np.random.default_rng([seed, panel, PATTERNS.index(kind)])
    hue = np.random.default_rng([seed, PATTERNS.index(kind)]).uniform()  # related between panels
    shade = _color((hue + 0.45 * (panel - 1)) % 1.0, 0.75, 0.65)
    light = _color(random.uniform(), 0.10, 0.92)
    if kind == "checker":
        return _checker(uv_m, shade, light)
    if kind == "stripes":
        return _stripes(uv_m, shade, light, random)
    if kind == "floral":
        return _floral(uv_m, _color((hue + 0.3 * panel) % 1.0, 0.18, 0.88), seed + 97 * panel)
    return _plain(uv_m, _color((hue + 0.02 * panel) % 1.0, 0.30, 0.48), random)


def mesh_rgb(mesh: GarmentMesh, triangle: Int32, weights: Float64) -> Float64:
    """Return the mesh's own colors (N, 3), 0 to 1, at points of triangles.

    A point is given by its ``triangle`` (N,) and the ``weights`` (N, 3) of its corners.
    """
    rgb = np.full((len(triangle), 3), 0.6)
    if mesh.vertex_rgb is not None:
        corners = mesh.vertex_rgb[mesh.triangles[triangle]] / 255.0
        rgb = (corners * weights[..., None]).sum(axis=1)
    if mesh.image is not None and mesh.corner_uv is not None:
        uv = (mesh.corner_uv[triangle] * weights[..., None]).sum(axis=1)
        for n, image in enumerate(mesh.images):
            own, (rows, cols) = mesh.image[triangle] == n, image.shape[:2]
            at = np.stack([rows * (1 - uv[own, 1]) - 0.5, cols * uv[own, 0] - 0.5])
            for k in range(3):
                level = ndimage.map_coordinates(image[..., k], at, np.float64, order=1, mode="grid-wrap")
                rgb[own, k] = level / 255.0
    return rgb


def _color(hue: float, saturation: float, value: float) -> Float64:
    return np.array(colorsys.hsv_to_rgb(hue, saturation, value))


def _checker(uv_m: Float64, shade: Float64, light: Float64, square_m: float = 0.03) -> Float64:
    odd = np.floor(uv_m / square_m).sum(axis=1) % 2 == 1
    rgb = np.where(odd[:, None], shade, light)
    # A thin line every five squares breaks the symmetry, like a seam or a weaving fault.
    beside = np.abs((uv_m + 0.0615) % (5 * square_m)).min(axis=1) < 0.002
    return np.where(beside[:, None], 0.12, rgb)


def _stripes(uv_m: Float64, shade: Float64, light: Float64, random: np.random.Generator) -> Float64:
    angle = random.uniform(-0.4, 0.4)
    along = uv_m @ np.array([np.cos(angle), np.sin(angle)])
    widths = random.uniform(0.006, 0.022, 7)
    edges = np.cumsum(widths)
    band = np.searchsorted(edges, along % edges[-1], side="right").clip(0, 6)
    mix = np.array([0.0, 1.0, 0.15, 0.8, 0.05, 0.55, 1.0])[band, None]
    return np.asarray(light + mix * (shade - light))


def _plain(uv_m: Float64, shade: Float64, random: np.random.Generator) -> Float64:
    """Return the slight unevenness of a weave: a few per cent, over 5 to 60 mm."""
    level = np.zeros(len(uv_m))
    for wave_m in np.repeat((0.06, 0.03, 0.015, 0.008), 4):
        turn, phase = random.uniform(0, 2 * np.pi, 2)
        way = np.array([np.cos(turn), np.sin(turn)]) * 2 * np.pi / wave_m
        level += np.sin(uv_m @ way + phase)
    return shade * (1 + 0.016 * level[:, None])


def _floral(uv_m: Float64, ground: Float64, seed: int) -> Float64:
    """Five-petalled flowers, one in each cell of a grid, with random position, size, rotation and hue."""
    rgb = np.tile(ground, (len(uv_m), 1))
    cell = np.floor(uv_m / _FLOWER_CELL_M).astype(np.int64)
    for step in np.ndindex(3, 3):
        own = cell + np.array(step) - 1
        chance = [_chance(own, seed, k) for k in range(5)]
        center = (own + 0.5 + 0.35 * (np.stack(chance[:2], axis=1) * 2 - 1)) * _FLOWER_CELL_M
        radius = 0.006 + 0.006 * chance[2]
        offset = uv_m - center
        angle = np.arctan2(offset[:, 1], offset[:, 0]) + 6.28 * chance[3]
        distance = np.linalg.norm(offset, axis=1) / radius
        petal = distance < 0.72 + 0.28 * np.cos(5 * angle)
        dye = _DYES[(chance[4] * len(_DYES)).astype(int)]
        rgb = np.where(petal[:, None], dye, rgb)
        rgb = np.where((distance < 0.25)[:, None], (0.95, 0.88, 0.55), rgb)
    return rgb


_DYES = np.array([(0.75, 0.15, 0.20), (0.20, 0.25, 0.60), (0.85, 0.55, 0.08), (0.15, 0.45, 0.28)])
"""Colors of the flowers. Chosen."""


def _chance(cell: Int64, seed: int, number: int) -> Float64:
    """Return a number in [0, 1) that is fixed for each cell and independent of what is drawn."""
    x = cell[:, 0].astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    x ^= cell[:, 1].astype(np.uint64) * np.uint64(0xC2B2AE3D27D4EB4F)
    x += np.uint64((seed * 0x165667B19E3779F9 + number * 0x27D4EB2F165667C5) % 2**64)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        x = (x ^ (x >> np.uint64(shift))) * np.uint64(factor)
    return ((x ^ (x >> np.uint64(31))) >> np.uint64(11)).astype(np.float64) / 2**53
