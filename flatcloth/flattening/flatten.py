"""Flatten one view: from the surface to the flattened view ``F(u, v)`` (paper, section 3).

The surface is sampled at a coarse and then at a fine interval. At the coarse level Eq. (2) is
minimised from the pixel positions ``(u_n, v_n) = (j_n, i_n)`` scaled to metres, at the fine level
from the coarse result. Components of the surface that no pair connects are flattened separately.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.config import FlatteningConfig
from flatcloth.core.errors import ConfigError, FlatteningError
from flatcloth.core.geometry import camera_from_object, fit_rigid2, object_from_camera, project
from flatcloth.core.graphs import components
from flatcloth.core.types import Bool, FlattenedView, Float64, Int32, RotationAxis
from flatcloth.flattening.minimisation import ENERGY_TOLERANCE, Minimum, minimise
from flatcloth.flattening.raster import rasterise_pixels, rasterise_triangles, triangulate
from flatcloth.flattening.sampling import (
    LEAST_INTERVAL_M,
    Samples,
    cut_necks,
    sample_surface,
)
from flatcloth.flattening.surface import Surface
from flatcloth.flattening.upsampling import Carrier

MAJORISATIONS = 6
"""Majorisation steps at each interval, before the Gauss-Newton steps. Set by hand."""


@dataclass(frozen=True, kw_only=True)
class Level(Samples):
    """One sampling interval: the samples with their positions before and after the minimisation.

    ``component`` (N,) int32 is the number of each sample's connected component, 0 for the largest.
    ``energy`` is H of the largest component before the first iteration and after each one.
    ``states`` holds (N, 2) positions at some iterations, for the points ``state_members`` of the
    largest component, if they were recorded.
    """

    component: Int32
    initial_uv_m: Float64
    uv_m: Float64
    energy: tuple[float, ...]
    state_members: Int32
    states: tuple[Float64, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Component:
    """A connected component of a flattened view, rasterised in a plane of its own.

    ``members`` (K,) are the indices of its samples. ``flips`` counts triangles that came out mirrored
    (and were left out), ``overlaps`` the pixels on which two places of the cloth lie. If either is
    large, the component is folded and its result is unreliable.
    """

    view: FlattenedView
    members: Int32
    flips: int
    overlaps: int

    @property
    def folded_share(self) -> float:
        """Share of the component that is mirrored or covers another place of the cloth; 0 without folds."""
        return (0.5 * self.flips + self.overlaps) / max(int(self.view.valid.sum()), 1)


@dataclass(frozen=True, kw_only=True)
class Flattening:
    """A flattened view with all intermediate results; the components are sorted, largest first."""

    levels: tuple[Level, ...]
    components: tuple[Component, ...]
    surface: Surface = field(repr=False)
    carrier: Carrier = field(repr=False)

    @property
    def view(self) -> FlattenedView:
        """The flattened view of the largest component."""
        return self.components[0].view

    @cached_property
    def triangles(self) -> Int32:
        """(T, 3) Delaunay triangles of the largest component, indices into the last level's samples."""
        level = self.levels[-1]
        return triangulate(level.uv_m, level, self.components[0].members, self.surface)[0]


def flatten(
    surface: Surface,
    axis: RotationAxis,
    config: FlatteningConfig,
    *,
    min_area_m2: float = 0.0,
    record: bool = False,
    previous: Flattening | None = None,
) -> Flattening:
    """Flatten the surface of one view.

    Parameters
    ----------
    surface : Surface
        The surface.
    axis : RotationAxis
        Axis of the recording, to transform the attributes to the object frame.
    config : FlatteningConfig
        Intervals, pixel size and limits.
    min_area_m2 : float
        Components smaller than this are dropped, except the largest.
    record : bool
        Keep states of the minimisation for the teaching view.
    previous : Flattening, optional
        A flattened view of the same item at a nearby angle, of which the plane keeps the orientation.

    Returns
    -------
    Flattening

    Raises
    ------
    FlatteningError
        If no component has a triangle; the message names the view.
    """
    levels: list[Level] = []
    for interval in config.sampling_intervals_px:
        samples = sample_surface(surface, interval)
        if interval == config.sampling_intervals_px[-1]:
            samples = cut_necks(samples, config.least_core_samples)
        if not len(samples.points_rc):
            continue
        least = _least_samples(surface, interval, min_area_m2)
        if levels:
            start = _from_coarse(samples, levels[-1], surface)
        elif previous is not None:
            start = _as_in_previous(samples, previous, surface, axis)
        else:
            start = _pixel_start(samples, surface)
        levels.append(_solve_level(samples, start, least, record))
    if not levels:
        raise FlatteningError(_too_small(surface))
    carrier = Carrier(levels[-1].uv_m, levels[-1], surface)
    components = _raster_components(levels[-1], carrier, surface, axis, config, min_area_m2)
    if not components:
        raise FlatteningError(_too_small(surface))
    return Flattening(levels=tuple(levels), components=tuple(components), surface=surface, carrier=carrier)


def _too_small(surface: Surface) -> str:
    return (
        f"View {surface.frame.view_index}: the visible cloth is too small or too scattered to be "
        "flattened; use another view or a smaller sampling interval."
    )


def _solve_level(samples: Samples, initial: Float64, least_samples: int, record: bool) -> Level:
    component = _components(len(samples.points_rc), samples.edges)
    uv, largest = initial.copy(), Minimum(uv_m=initial, energy=(0.0,))
    place, of_pair = np.empty(len(component), dtype=np.int32), component[samples.edges[:, 0]]
    for c in np.flatnonzero(np.bincount(component) >= least_samples):
        members, own = np.flatnonzero(component == c), np.flatnonzero(of_pair == c)
        place[members] = np.arange(members.size)
        found = minimise(
            initial[members],
            place[samples.edges[own]],
            samples.edge_length_m[own],
            majorisations=MAJORISATIONS,
            energy_tolerance=ENERGY_TOLERANCE,
            record=record and c == 0,
        )
        uv[members] = found.uv_m
        largest = found if c == 0 else largest
    return Level(
        **vars(samples),
        component=component,
        initial_uv_m=initial,
        uv_m=uv,
        energy=largest.energy,
        state_members=np.flatnonzero(component == 0).astype(np.int32),
        states=largest.states,
    )


def _components(n: int, edges: Int32) -> Int32:
    """Return the number of each point's connected component (N,); the largest component is 0."""
    label = components(n, edges)
    order = np.argsort(-np.bincount(label), kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(order.size)
    numbers: Int32 = rank[label].astype(np.int32)
    return numbers


def _pixel_start(samples: Samples, surface: Surface) -> Float64:
    return samples.points_rc[:, ::-1] * np.float64(surface.pixel_pitch_m)


def _from_coarse(samples: Samples, coarse: Level, surface: Surface) -> Float64:
    """Move each fine point with the coarse points; a point out of their range follows the nearest one."""
    uv = Carrier(coarse.uv_m, coarse, surface).place(samples.points_rc)
    alone = np.isnan(uv[:, 0])
    if alone.any():
        start, coarse_start = _pixel_start(samples, surface), _pixel_start(coarse, surface)
        _, near = cKDTree(coarse_start).query(start[alone])
        uv[alone] = start[alone] + coarse.uv_m[near] - coarse_start[near]
    return uv


def _as_in_previous(samples: Samples, previous: Flattening, surface: Surface, axis: RotationAxis) -> Float64:
    """Return the pixel start, moved rigidly to where another view placed the same cloth."""
    start = _pixel_start(samples, surface)
    frame, seen = surface.frame, previous.surface
    turn = camera_from_object(axis, seen.frame.angle_deg) @ object_from_camera(axis, frame.angle_deg)
    points, k = turn.apply(samples.points_m), seen.frame.intrinsics
    rc = np.rint(project(points, k)).astype(np.int32)
    inside = np.flatnonzero(((rc >= 0) & (rc < seen.usable.shape)).all(axis=1))
    depth = seen.depth_m[rc[inside, 0], rc[inside, 1]]
    with np.errstate(invalid="ignore"):
        same = inside[np.abs(depth - points[inside, 2]) < LEAST_INTERVAL_M]
    placed = previous.carrier.place(rc[same])
    found = np.isfinite(placed[:, 0])
    known, placed = same[found], placed[found]
    return start if known.size < 3 else fit_rigid2(start[known], placed).apply(start)


def _raster_components(
    level: Level,
    carrier: Carrier,
    surface: Surface,
    axis: RotationAxis,
    config: FlatteningConfig,
    min_area_m2: float,
) -> list[Component]:
    if config.interpolation not in ("smooth", "delaunay"):
        raise ConfigError(f"flattening.interpolation: {config.interpolation!r} is not smooth or delaunay.")
    uv, stretch = carrier.place_all()
    component = np.take(np.append(level.component, np.int32(-1)), carrier.nearest)  # of each pixel
    drawn = _are_drawn(level, component, surface, min_area_m2)
    found = []
    for c in range(len(drawn)):
        members = np.flatnonzero(level.component == c).astype(np.int32)
        if config.interpolation == "delaunay":
            triangles, flips = triangulate(level.uv_m, level, members, surface)
            if len(triangles):
                view = rasterise_triangles(
                    level.uv_m, level, triangles, stretch, surface, axis, config.pixel_size_m
                )
                found.append(Component(view=view, members=members, flips=flips, overlaps=0))
        elif drawn[c]:
            view, flips, overlaps = rasterise_pixels(
                uv, component == c, stretch, surface, axis, config.pixel_size_m
            )
            found.append(Component(view=view, members=members, flips=flips, overlaps=overlaps))
    found = [part for part in found if part.view.valid.any()]
    found.sort(key=lambda part: -part.view.area_m2)
    return [part for n, part in enumerate(found) if n == 0 or part.view.area_m2 >= min_area_m2]


def _are_drawn(level: Level, component: Int32, surface: Surface, min_area_m2: float) -> Bool:
    """Return which components have the samples and pixels of that area; the largest, if none has."""
    sizes = np.bincount(level.component)
    least = _least_samples(surface, level.sampling_interval_px, min_area_m2)
    pixels = np.bincount(component[component >= 0], minlength=sizes.size)
    drawn: Bool = (sizes >= least) & (pixels * surface.pixel_pitch_m**2 >= 0.5 * min_area_m2)
    if not drawn.any():
        drawn = sizes == sizes.max()
    return drawn & (sizes >= 3)


def _least_samples(surface: Surface, interval_px: int, area_m2: float) -> int:
    """Fewest samples of a component: 3, or the samples of that area when it is seen at 60 degrees."""
    return max(3, int(0.5 * area_m2 / (interval_px * surface.pixel_pitch_m) ** 2))
