"""How sure each place of a joint shape is: the spread that strain and noise give it.

Cloth stretches by a percent or so, alike over some centimetres, and differently from what the
flattening can know; each pair carries noise besides. Both are drawn at random, and the linearised
minimisation tells how the nodes would move: far where much hangs on a narrow neck of seen cloth.
"""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, eye_array
from scipy.spatial import cKDTree

from flatcloth.config import UncertaintyConfig
from flatcloth.joint import JointShape, factor
from flatcloth.types import FlattenedView, Float64

Int64 = NDArray[np.int64]


def placement_std_m(shape: JointShape, config: UncertaintyConfig) -> Float64:
    """Return the standard deviation (N,) of each node's place, relative to the start view's main piece.

    Parameters
    ----------
    shape : JointShape
        The shape.
    config : UncertaintyConfig
        Strain, its extent, and the number of draws.

    Returns
    -------
    (N,) float64
        Root mean square of the displacement on the plane, m; NaN for nodes without a place.
    """
    links = shape.links
    placed = np.flatnonzero(shape.placed)
    number = np.full(len(shape.nodes), -1, dtype=np.int64)
    number[placed] = np.arange(placed.size)
    inside = np.flatnonzero(shape.placed[links.edges].all(axis=1))
    edges = number[links.edges[inside]]
    uv = shape.uv_m[placed]
    along = uv[edges[:, 1]] - uv[edges[:, 0]]
    unit = along / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    weight = shape.weight[inside] / np.square(links.std_m[inside])
    random = np.random.default_rng(0)
    change = _strained(uv[edges].mean(axis=1), unit, config, random) * links.length_m[inside][:, None]
    normed = (np.linalg.norm(along, axis=1) - links.length_m[inside]) / links.std_m[inside]
    noise = config.noise_share * float(np.sqrt(np.minimum(np.square(normed), 9.0).mean()))
    change += noise * links.std_m[inside][:, None] * random.standard_normal(change.shape)
    turns = config.turn_rad * _smooth(uv[edges].mean(axis=1), 1, config, random)[0]
    moved = _displaced(len(uv), edges, along, weight, change, turns, config.bending)
    anchor = number[shape.sightings[0].node]
    anchor = anchor[anchor >= 0]
    spread = np.empty((len(uv), config.draws))
    for k in range(config.draws):
        spread[:, k] = np.square(_without_rigid(moved[:, :, k], uv, anchor)).sum(axis=1)
    std = np.full(len(shape.nodes), np.nan)
    std[placed] = np.sqrt(spread.mean(axis=1))
    result: Float64 = np.hypot(std, config.least_m)
    return result


def with_placement_std(view: FlattenedView, shape: JointShape, std_m: Float64) -> FlattenedView:
    """Return a view of a joint shape that says how sure the place of each pixel is.

    Each pixel takes the standard deviation (N,) of the node nearest to it on the plane.
    """
    nodes = np.flatnonzero(np.isfinite(shape.all_uv_m[:, 0]) & np.isfinite(std_m))
    rows, cols = view.shape
    along = (np.arange(0, size + _BLOCK_PX, _BLOCK_PX) for size in (rows, cols))
    coarse = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1)
    _, nearest = cKDTree(shape.all_uv_m[nodes]).query(view.uv_from_rc(coarse))
    values = std_m[nodes][nearest].astype(np.float32)
    smooth = cv2.resize(values, None, fx=_BLOCK_PX, fy=_BLOCK_PX, interpolation=cv2.INTER_LINEAR)
    # cv2 aligns the corners of the pixels: the value of a coarse pixel lies in the middle of its block.
    shift = _BLOCK_PX // 2
    std = smooth[shift : shift + rows, shift : shift + cols]
    return replace(view, placement_std_m=np.where(view.valid, std, np.float32(np.nan)))


_BLOCK_PX = 3


def _strained(at: Float64, unit: Float64, config: UncertaintyConfig, random: np.random.Generator) -> Float64:
    """Draw relative changes of length (M, draws): smooth random strain fields, seen along each pair."""
    share = (np.square(unit[:, 0]), math.sqrt(2.0) * unit[:, 0] * unit[:, 1], np.square(unit[:, 1]))
    fields = _smooth(at, 3, config, random)
    return config.strain * sum((s[:, None] * f for s, f in zip(share, fields, strict=True)), np.zeros(1))


def _smooth(at: Float64, count: int, config: UncertaintyConfig, random: np.random.Generator) -> list[Float64]:
    """Draw ``count`` smooth random fields of unit variance at places (M, 2) of the plane: (M, draws) each."""
    phase = at @ (random.standard_normal((config.waves, 2)) / config.extent_m).T
    features = np.concatenate([np.cos(phase), np.sin(phase)], axis=1)
    scale = 1.0 / math.sqrt(config.waves)
    return [
        features @ (scale * random.standard_normal((2 * config.waves, config.draws))) for _ in range(count)
    ]


def _displaced(
    n: int, edges: Int64, along: Float64, weight: Float64, change: Float64, turns: Float64, bending: float
) -> Float64:
    """Solve for the displacements (n, 2, draws) that changes of length and turns (M, draws) bring about.

    What the pairs leave free (a string of nodes, a hinge) is held by their directions, softly, and
    follows as these turn.
    """
    i, j = edges[:, 0], edges[:, 1]
    unit = along / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    rows, cols, values = [], [], []
    for p in range(2):
        for q in range(2):
            stiffness = weight * (unit[:, p] * unit[:, q] + (bending if p == q else 0.0))
            rows += [2 * i + p, 2 * j + p, 2 * i + p, 2 * j + p]
            cols += [2 * i + q, 2 * j + q, 2 * j + q, 2 * i + q]
            values += [stiffness, stiffness, -stiffness, -stiffness]
    matrix = coo_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(cols))), shape=(2 * n, 2 * n)
    ).tocsc()
    held = 1e-9 * float(np.median(matrix.diagonal()))
    solve = factor(matrix + held * eye_array(2 * n, format="csc"))
    force = np.zeros((2 * n, change.shape[1]))
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    for p in range(2):
        pull = (weight * unit[:, p])[:, None] * change + (bending * weight * across[:, p])[:, None] * turns
        for k in range(change.shape[1]):
            force[p::2, k] = np.bincount(j, pull[:, k], n) - np.bincount(i, pull[:, k], n)
    displaced: Float64 = solve.solve(force).reshape(n, 2, -1)
    return displaced


def _without_rigid(moved: Float64, uv: Float64, anchor: Int64) -> Float64:
    """Take off (N, 2) the small rigid motion that leaves the anchors where they are, on average."""
    center = uv[anchor].mean(axis=0)
    offset = uv - center
    shift = moved[anchor].mean(axis=0)
    own = offset[anchor]
    turning = (own[:, 0] * moved[anchor, 1] - own[:, 1] * moved[anchor, 0]).sum()
    turned = float(turning / np.square(own).sum()) * np.stack([-offset[:, 1], offset[:, 0]], axis=1)
    rest: Float64 = moved - shift - turned
    return rest
