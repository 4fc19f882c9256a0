"""The canonical view, rasterised from a shape: each pixel comes from the view that saw it best."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flatcloth.core.compiled import njit
from flatcloth.core.config import Config, FlatteningConfig
from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import Bool, FlattenedView, Float32, Float64, Int32, RotationAxis, Uint8
from flatcloth.flattening.pixel_states import PixelState
from flatcloth.flattening.ramps import RAMP_HALF_WIDTH_PX
from flatcloth.flattening.raster import BLOCK_TRIANGLES, cloth_triangles, grid_around
from flatcloth.flattening.reading import read_attributes
from flatcloth.flattening.sampling import LEAST_INTERVAL_M, Samples
from flatcloth.flattening.surface import Surface
from flatcloth.flattening.upsampling import Carrier, nearest_samples
from flatcloth.shape.graph import both_ends
from flatcloth.shape.observations import FRONTAL_NOISE, INCIDENCE_LIMIT_DEG, Observation
from flatcloth.shape.shape import TWO_ROWS_M, Shape

_WIDEST_PX = TWO_ROWS_M / FlatteningConfig().pixel_size_m
"""A wider triangle joins parts of the cloth that lie apart: neighbouring pixels are two pixels of the plane
apart, four times that at the largest incidence angle."""
_RIM_NOISE = 3.0
"""Additional cost of a pixel at the outline of the surface, decreasing over a few pixels. Set by hand."""


def draw(
    shape: Shape,
    surfaces: Mapping[int, Surface],
    axis: RotationAxis,
    config: Config,
    costs: Mapping[int, Float32],
    taken_off: Bool | None = None,
) -> tuple[FlattenedView, tuple[FlattenedView, ...], frozenset[int]]:
    """Composite the main piece of a shape, with its deviations, and each floating piece.

    Parameters
    ----------
    shape, surfaces, axis, costs
        As in :func:`composite`.
    config : Config
        Sampling interval, pixel size, and the least area of a floating piece.
    taken_off : (N,) bool, optional
        Nodes that were taken off the shape.

    Returns
    -------
    main : FlattenedView
    floating : tuple of FlattenedView
        The largest first.
    are_off : frozenset of int
        Those of the floating pieces, by index, that were taken off the shape.
    """
    interval, size = config.flattening.sampling_intervals_px[-1], config.flattening.pixel_size_m
    places = floating_pieces(shape)
    main, *pieces = [
        composite(shape, surfaces, axis, interval, size, costs, uv) for uv in (shape.uv_m, *places)
    ]
    least_m2 = config.surface.min_component_area_m2
    kept = [(uv, piece) for uv, piece in zip(places, pieces, strict=True) if piece.area_m2 >= least_m2]
    are_off = frozenset(
        n
        for n, (uv, _) in enumerate(kept)
        if taken_off is not None and taken_off[np.isfinite(uv[:, 0])].mean() > 0.5
    )
    return with_placement_std(main, shape, surfaces), tuple(piece for _, piece in kept), are_off


def composite(
    shape: Shape,
    surfaces: Mapping[int, Surface],
    axis: RotationAxis,
    interval_px: int,
    pixel_size_m: float,
    costs: Mapping[int, Float32],
    uv_m: Float64 | None = None,
) -> FlattenedView:
    """Rasterise a shape.

    Parameters
    ----------
    shape : Shape
        The shape.
    surfaces : mapping of int to Surface
        The surfaces of its views, by view index.
    axis : RotationAxis
        Axis of the recording.
    interval_px : int
        Sampling interval d of the nodes.
    pixel_size_m : float
        Size of a pixel of the plane; the grid is aligned to its multiples.
    costs : mapping of int to (H, W) float32
        :func:`pixel_cost` of each view, by view index; the view with the lowest cost is used.
    uv_m : (N, 2) float64, optional
        Positions of the nodes if not those of the shape, for a floating piece. NaN: not drawn.

    Returns
    -------
    FlattenedView
    """
    uv = shape.uv_m if uv_m is None else uv_m
    placed = uv[np.isfinite(uv[:, 0])]
    low, size = grid_around(placed.T, pixel_size_m, margin_px=2 * interval_px)
    source = np.full((*size, 2), np.nan, dtype=np.float32)
    cost = np.full(size, np.inf, dtype=np.float32)
    label = np.full(size, -1, dtype=np.int16)
    stretches: dict[int, Float32] = {}
    for n, observation in enumerate(shape.observations):
        surface = surfaces[observation.view_index]
        seen = _samples(observation, uv, interval_px, shape.link_holds[shape.links.observation == n])
        if seen is None:
            continue
        samples, own_uv = seen
        is_other = (shape.piece[observation.node] >= 0) & ~np.isfinite(uv[observation.node, 0])
        others = np.rint(observation.rc[is_other]).astype(np.int32)
        carrier = Carrier(own_uv, samples, surface)
        points, stretches[n] = carrier.place_all()
        view = _PlacedView(
            points=points / pixel_size_m - low,
            part=(carrier.nearest >= 0) & _near(samples.points_rc, others, surface, interval_px),
            steps=surface.steps,
            pixel_cost=costs[observation.view_index],
            number=n,
        )
        _composite(view, _Canvas(source, cost, label))
    return _read_views(shape, surfaces, axis, label, source, stretches, low, pixel_size_m)


def floating_pieces(shape: Shape) -> list[Float64]:
    """Return the places (N, 2) of each floating piece, the largest first; NaN elsewhere."""
    pieces = [shape.piece == n for n in np.unique(shape.piece[shape.piece > 0])]
    pieces.sort(key=lambda own: -int(own.sum()))
    return [np.where(own[:, None], shape.all_uv_m, np.nan) for own in pieces]


def _samples(
    observation: Observation, uv: Float64, interval_px: int, used: Bool
) -> tuple[Samples, Float64] | None:
    """Return a view's placed nodes as samples of its image, with their positions; None if too few.

    Their pairs are those ``used`` (M,), which are not cut.
    """
    own = uv[observation.node]
    kept = np.isfinite(own[:, 0])
    inside = used & both_ends(kept, observation.edges)
    kept = np.zeros(len(own), dtype=bool)
    kept[observation.edges[inside]] = True
    if kept.sum() < 3:
        return None
    number = np.cumsum(kept) - 1
    samples = Samples(
        sampling_interval_px=interval_px,
        points_rc=np.rint(observation.rc[kept]).astype(np.int32),
        points_m=observation.points_m[kept],
        normal=observation.normal[kept],
        edges=number[observation.edges[inside]].astype(np.int32),
        edge_length_m=observation.edge_length_m[inside],
    )
    return samples, own[kept]


def _near(own_rc: Int32, others_rc: Int32, surface: Surface, interval_px: int) -> Bool:
    """Return the pixels (H, W) of a view that its own nodes carry, and not those of other pieces.

    With noise they reach one interval: farther along the surface are the ramps of outlines.
    """
    reach_px = interval_px if surface.noisy else 2 * interval_px
    nearest = nearest_samples(surface.usable, surface.steps, np.concatenate([own_rc, others_rc]), reach_px)
    near: Bool = (nearest >= 0) & (nearest < len(own_rc))
    return near


def states_of_nodes(shape: Shape, taken_off: Bool | None = None) -> Uint8:
    """Return the state (N,) of each node, a :class:`PixelState`; ``taken_off`` (N,) float."""
    state = np.full(len(shape.nodes), PixelState.NO_CHAIN, dtype=np.uint8)
    state[shape.has_place] = PixelState.FLOATING
    state[shape.placed] = PixelState.SHAPE
    if taken_off is not None:
        state[taken_off & (state == PixelState.SHAPE)] = PixelState.FLOATING
    return state


def states_on_surface(
    observation: Observation, surface: Surface, state: Uint8, flattening: FlatteningConfig
) -> Uint8:
    """Return the state (H, W) of each pixel of a view's surface: that of the node that carries it.

    Parameters
    ----------
    observation : Observation
        The nodes that the view shows; those without pairs carry nothing.
    surface : Surface
        The view's surface.
    state : (N,) uint8
        The state of each node, a :class:`PixelState`.
    flattening : FlatteningConfig
        Sampling interval.
    """
    interval_px = flattening.sampling_intervals_px[-1]
    linked = np.unique(observation.edges)
    rc = np.rint(observation.rc[linked]).astype(np.int32)
    nearest = nearest_samples(surface.usable, surface.steps, rc, 2 * interval_px)
    carried = np.append(state[observation.node[linked]], np.uint8(PixelState.STRIP))[nearest]
    states: Uint8 = np.where(surface.usable, carried, np.uint8(PixelState.OFF_ITEM))
    return states


def pixel_cost(surface: Surface) -> Float32:
    """Return the cost of each pixel (H, W) of a view: high at large incidence angles and at outlines."""
    rows, cols = np.nonzero(surface.usable)
    k = surface.frame.intrinsics
    normal = surface.normal[rows, cols]
    x, y = (cols - k.cx) / k.fx, (rows - k.cy) / k.fy
    cos = -(x * normal[:, 0] + y * normal[:, 1] + normal[:, 2]) / np.sqrt(x * x + y * y + 1.0)
    least = math.cos(math.radians(INCIDENCE_LIMIT_DEG))
    steep = 1.0 / np.square(np.clip(cos, least, 1.0)) - 1.0
    inside = surface.usable.astype(np.uint8)
    rim = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[rows, cols]
    cost = np.full(surface.usable.shape, np.inf, dtype=np.float32)
    cost[rows, cols] = FRONTAL_NOISE + steep + _RIM_NOISE * np.exp(-rim / 3.0)
    return cost


class _PlacedView(NamedTuple):
    """A view's pixels: positions on the plane (pixels; H, W, 2), membership, steps, cost, and its number."""

    points: Float64
    part: Bool
    steps: NDArray[np.uint8]
    pixel_cost: Float32
    number: int


class _Canvas(NamedTuple):
    """The plane's pixels: source position (H, W, 2), cost, and the number of the view they are read from."""

    source: Float32
    cost: Float32
    label: NDArray[np.int16]


@njit(cache=True, nogil=True)
def _composite(view: _PlacedView, canvas: _Canvas) -> None:
    """Fill two triangles for every block of 2 x 2 neighbours where they cost less than the present pixels."""
    points, part, steps, pixel_cost, number = view
    source, cost, label = canvas
    for r in range(part.shape[0] - 1):
        for c in range(part.shape[1] - 1):
            # Three of four pixels include a whole diagonal; most blocks are empty, so this saves time.
            if not ((part[r, c] and part[r + 1, c + 1]) or (part[r + 1, c] and part[r, c + 1])):
                continue
            present = cloth_triangles(part, steps, r, c)
            for k in range(4):
                if present[k]:
                    _fill(view, (r, c), BLOCK_TRIANGLES[k], canvas)
    # Pixels without triangles (strips of one pixel, folded outlines) are drawn as points.
    for r in range(part.shape[0]):
        for c in range(part.shape[1]):
            if part[r, c] and math.isfinite(points[r, c, 0]):
                row, col = math.floor(points[r, c, 1] + 0.5), math.floor(points[r, c, 0] + 0.5)
                if 0 <= row < cost.shape[0] and 0 <= col < cost.shape[1] and math.isinf(cost[row, col]):
                    source[row, col, 0], source[row, col, 1] = r, c
                    cost[row, col] = 1e9 + pixel_cost[r, c]  # triangles are preferred
                    label[row, col] = number


@njit(cache=True, nogil=True)
def _fill(
    view: _PlacedView, at: tuple[int, int], corners: tuple[tuple[int, int], ...], canvas: _Canvas
) -> None:
    """Fill one triangle of the block of pixels at (row, col); mirrored ones are left out."""
    points, _, _, pixel_cost, number = view
    source, cost, label = canvas
    (r0, c0), (r1, c1), (r2, c2) = corners
    r0, r1, r2 = at[0] + r0, at[0] + r1, at[0] + r2
    c0, c1, c2 = at[1] + c0, at[1] + c1, at[1] + c2
    u0, v0 = points[r0, c0, 0], points[r0, c0, 1]
    u1, v1 = points[r1, c1, 0], points[r1, c1, 1]
    u2, v2 = points[r2, c2, 0], points[r2, c2, 1]
    area = (u1 - u0) * (v2 - v0) - (v1 - v0) * (u2 - u0)
    if not area > 0.0 or not math.isfinite(area):
        return
    if max(max(u0, u1, u2) - min(u0, u1, u2), max(v0, v1, v2) - min(v0, v1, v2)) > _WIDEST_PX:
        return
    own = (pixel_cost[r0, c0] + pixel_cost[r1, c1] + pixel_cost[r2, c2]) / 3.0
    row_low, row_high = math.ceil(min(v0, v1, v2)), math.floor(max(v0, v1, v2))
    col_low, col_high = math.ceil(min(u0, u1, u2)), math.floor(max(u0, u1, u2))
    for row in range(max(row_low, 0), min(row_high, source.shape[0] - 1) + 1):
        for col in range(max(col_low, 0), min(col_high, source.shape[1] - 1) + 1):
            if own >= cost[row, col]:
                continue
            w1 = ((col - u0) * (v2 - v0) - (row - v0) * (u2 - u0)) / area
            w2 = ((u1 - u0) * (row - v0) - (v1 - v0) * (col - u0)) / area
            w0 = 1.0 - w1 - w2
            if w0 < -1e-9 or w1 < -1e-9 or w2 < -1e-9:
                continue
            source[row, col, 0] = w0 * r0 + w1 * r1 + w2 * r2
            source[row, col, 1] = w0 * c0 + w1 * c1 + w2 * c2
            cost[row, col] = own
            label[row, col] = number


def _read_views(
    shape: Shape,
    surfaces: Mapping[int, Surface],
    axis: RotationAxis,
    label: NDArray[np.int16],
    source: Float32,
    stretches: Mapping[int, Float32],
    low: Float64,
    pixel_size_m: float,
) -> FlattenedView:
    """Read the attributes of each pixel from the view of its label."""
    rows, cols = label.shape
    result = FlattenedView(
        rgb=np.zeros((rows, cols, 3), dtype=np.uint8),
        xyz_m=np.full((rows, cols, 3), np.nan, dtype=np.float32),
        normal=np.full((rows, cols, 3), np.nan, dtype=np.float32),
        z_angle_deg=np.full((rows, cols), np.nan, dtype=np.float32),
        valid=np.zeros((rows, cols), dtype=np.bool_),
        view_index=np.full((rows, cols), -1, dtype=np.int16),
        source_rc=np.full((rows, cols, 2), np.nan, dtype=np.float32),
        quality=np.full((rows, cols, 3), np.nan, dtype=np.float32),
        pixel_size_m=pixel_size_m,
        origin_uv_m=(float(low[0] * pixel_size_m), float(low[1] * pixel_size_m)),
    )
    assert result.quality is not None
    labelled = np.flatnonzero(label >= 0)
    labelled = labelled[np.argsort(label.ravel()[labelled], kind="stable")]
    ends = np.cumsum(np.bincount(label.ravel()[labelled], minlength=len(shape.observations)))
    for n, pixels in enumerate(np.split(labelled, ends[:-1])):
        if not pixels.size:
            continue
        surface = surfaces[shape.observations[n].view_index]
        held: Rigid3 = shape.object_from_camera[n]
        own_source = source.reshape(-1, 2)[pixels][:, None]
        part = read_attributes(own_source, stretches[n], surface, axis, pixel_size_m, low, held)
        valid = part.valid[:, 0]
        at = pixels[valid]
        for name in _READ:
            values = getattr(part, name)
            getattr(result, name).reshape(rows * cols, *values.shape[2:])[at] = values[valid, 0]
    return result


_READ = ("rgb", "xyz_m", "normal", "z_angle_deg", "valid", "view_index", "source_rc", "quality")
"""The attributes of a pixel that are read from a view."""


# --- deviations of pixels --------------------------------------------------------------------------


_OTHER_LAYER_M = 0.012
"""Another layer is nearer or farther by at least this. It is also the standard deviation of what may have the
depth of another layer: outlines of noisy views next to it, half a ramp wide and as far from it. Set by
hand."""


def with_placement_std(view: FlattenedView, shape: Shape, surfaces: Mapping[int, Surface]) -> FlattenedView:
    """Return a view of a shape with the standard deviation of each pixel's place.

    Each pixel takes the standard deviation of the node nearest to it on the plane. It is larger where the
    pixel's view is noisy and shows another layer next to it, whose depth may be mixed in.
    """
    nodes = np.flatnonzero(np.isfinite(shape.std_m))
    if not nodes.size:
        return view
    rows, cols = view.shape
    block_px = max(1, round(0.5 * LEAST_INTERVAL_M / view.pixel_size_m))  # half the distance of nodes
    along = (np.arange(0, size + block_px, block_px) for size in (rows, cols))
    coarse = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1)
    _, nearest = cKDTree(shape.all_uv_m[nodes]).query(view.uv_from_rc(coarse))
    values = shape.std_m[nodes][nearest].astype(np.float32)
    smooth = cv2.resize(values, None, fx=block_px, fy=block_px, interpolation=cv2.INTER_LINEAR)
    # cv2 aligns the corners of pixels: the value of a coarse pixel is at the centre of its block.
    shift = block_px // 2
    std = smooth[shift : shift + rows, shift : shift + cols]
    std = np.hypot(std, np.float32(_OTHER_LAYER_M) * _beside_a_layer(view, surfaces))
    return replace(view, placement_std_m=np.where(view.valid, std, np.float32(np.nan)))


def _beside_a_layer(view: FlattenedView, surfaces: Mapping[int, Surface]) -> Bool:
    """Return the pixels (R, C) that a noisy view shows at an outline of its surface next to another layer."""
    result = np.zeros(view.shape, dtype=np.bool_)
    pixels = np.flatnonzero(view.valid)
    seen_by = view.view_index.ravel()[pixels]
    order = np.argsort(seen_by, kind="stable")
    pixels, seen_by = pixels[order], seen_by[order]
    for number, surface in surfaces.items():
        own = pixels[slice(*np.searchsorted(seen_by, (number, number + 1)))]
        if surface.noisy and own.size:
            rc = np.rint(view.source_rc.reshape(-1, 2)[own] - np.asarray(surface.frame.offset_rc)).astype(int)
            rc = np.clip(rc, 0, np.array(surface.usable.shape) - 1)
            result.ravel()[own] = _layer_rims(surface)[rc[:, 0], rc[:, 1]]
    return result


def _layer_rims(surface: Surface) -> Bool:
    measured = surface.frame.depth_m
    kernel = np.ones((2 * RAMP_HALF_WIDTH_PX + 1,) * 2, dtype=np.uint8)
    depth = surface.depth_m
    farthest = cv2.dilate(np.where(surface.inverse_depth > 0, measured, np.float32(0.0)), kernel)
    nearest = cv2.erode(np.where(measured > 0, measured, np.float32(np.inf)), kernel)
    reach = np.arange(-RAMP_HALF_WIDTH_PX, RAMP_HALF_WIDTH_PX + 1)
    disc = (np.hypot(*np.meshgrid(reach, reach)) <= RAMP_HALF_WIDTH_PX).astype(np.uint8)
    inside = cv2.erode(surface.usable.astype(np.uint8), disc, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    step_m = np.maximum(farthest - depth, depth - nearest)
    rims: Bool = surface.usable & (inside == 0) & (step_m > _OTHER_LAYER_M)
    return rims
