"""The single views of a recording: frames with the masks in force, clouds and flattened views, cached."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from flatcloth.core.cache import Cache, ReadAhead
from flatcloth.core.config import Config
from flatcloth.core.errors import FlatclothError, FlatteningError, SegmentationError, SurfaceError
from flatcloth.core.geometry import back_project, object_from_camera
from flatcloth.core.strokes import Decision
from flatcloth.core.types import (
    Bool,
    FlattenedView,
    Float32,
    Float64,
    Intrinsics,
    Progress,
    RgbdFrame,
    RotationAxis,
    Uint8,
    no_progress,
)
from flatcloth.flattening.flatten import Flattening, flatten
from flatcloth.flattening.sampling import widened
from flatcloth.flattening.surface import (
    Surface,
    foreground_mask,
    item_mask,
    observe_item,
    observed_area_m2,
)
from flatcloth.recordings.base import MAX_VIEWS, Recording
from flatcloth.registration.axis import resolve_axis
from flatcloth.segmentation.result import Segmentation
from flatcloth.segmentation.solver import SideSolver

_MIB = 1 << 20
"""Bytes in a mebibyte."""
_FRAMES_BYTES, _ALL_FRAMES_BYTES = 16 * _MIB, 128 * _MIB
"""Most memory for frames that are kept: with an operator, who looks at a few, and unattended. Chosen: the
latter holds a turn of 36 views of 480 x 848 pixels; each is read three times, and decoded in 4 ms."""
_NEAREST_M = 0.1
"""Least assumed distance of the axis. Chosen: few depth cameras measure nearer."""


@dataclass(frozen=True, kw_only=True)
class ViewCloud:
    """Foreground points of a view: ``xyz_m`` (N, 3) object frame, ``rgb`` (N, 3), ``of_interest`` (N,)."""

    xyz_m: Float32
    rgb: Uint8
    of_interest: Bool


Segmenter = Callable[["RecordedViews", Progress], SideSolver]
"""Reads all views once (takes seconds) and returns a solver for their labels."""
SOLUTIONS_KEPT = 8
"""Number of cached solutions, for undo and redo of strokes. Set by hand."""


class RecordedViews:
    """The views of a recording about its turning axis, and the data derived from each view alone.

    Parameters
    ----------
    recording : Recording
        The views.
    config : Config
        The numbers of the method.
    segmenter : Segmenter, optional
        Finds the side of interest of a recording without masks; without it, the whole item counts.
    is_default : bool
        ``config`` is the method's default, not that of a session or a caller: its sampling intervals are
        then widened where the camera's pixels are small.

    Attributes
    ----------
    axis : RotationAxis
        Turning axis, object frame; estimated if the recording has none.
    held_point_m : (3,) float64
        Where the item is held.
    angles_deg : list of float
        The angle of each view; the same list grows with the recording.
    notes : tuple of str
        What the operator must know about the recording and its axis.
    masks : Segmentation or None
        What has the masks in force: those of the last requested strokes.
    on_change : callable
        Called when the axis or the masks were replaced, so that derived data are outdated.
    """

    def __init__(
        self, recording: Recording, config: Config, segmenter: Segmenter | None, *, is_default: bool = False
    ) -> None:
        self.recording, self.config = recording, config
        self.angles_deg = list(recording.angles_deg)
        self._segmenter = None if recording.has_masks else segmenter
        self._frames: Cache[RgbdFrame] = Cache(MAX_VIEWS, _FRAMES_BYTES)
        self.keeps_frames = False
        self._ahead = ReadAhead(self.recorded)
        self._segmenting = threading.RLock()
        self.on_change: Callable[[], None] = lambda: None
        hanging = resolve_axis(recording, self.recorded, config.surface)
        self.held_point_m: Float64 = hanging.held_point_m
        if is_default:
            self.config = _fitted_to(config, recording.intrinsics, hanging.axis)
        self.turn_about(hanging.axis)
        self.notes = (*self._notes(), *getattr(recording, "notes", ()), *hanging.notes)

    def _notes(self) -> tuple[str, ...]:
        notes = []
        if self.finds_sides:
            notes.append(
                "This recording has no masks: the side of interest is found from the views. "
                "Strokes correct it."
            )
        elif not self.recording.has_masks:
            notes.append(
                "This recording has no masks: both sides of the cloth, and its holder, may be in the shape."
            )
        if len(self.recording) == 1 and not self.recording.is_growing:
            notes.append(
                "This recording has one view: it is flattened and can be picked, but no view can be added."
            )
        return tuple(notes)

    def turn_about(self, axis: RotationAxis) -> None:
        """Replace the turning axis, object frame, and clear everything computed with the previous one.

        No other thread may compute at the same time.
        """
        self.axis = axis
        self._clouds: Cache[ViewCloud] = Cache(MAX_VIEWS, 6 * _MIB)
        self._flattenings: Cache[Flattening] = Cache(MAX_VIEWS, 42 * _MIB)
        self._failures: Cache[FlatclothError] = Cache(MAX_VIEWS)
        self._areas: Cache[Float64] = Cache(2)
        self._unfolded: Cache[float] = Cache(MAX_VIEWS)
        self._find_sides()
        self.on_change()

    def _find_sides(self) -> None:
        """Prepare to find the masks, if the recording has none of its own."""
        self.masks: Segmentation | None = None
        self._mask_keys: tuple[int, ...] = ()
        self._solver: Cache[SideSolver] = Cache(1)
        self._solutions: Cache[Segmentation] = Cache(SOLUTIONS_KEPT)

    def grow(self) -> None:
        """Take views that were added to the recording; what was computed for the others stays.

        Masks that are found from the views, and an axis that is estimated, are found again. No other thread
        may compute at the same time.
        """
        self.angles_deg.extend(self.recording.angles_deg[len(self.angles_deg) :])
        if self.recording.rotation_axis is None:
            hanging = resolve_axis(self.recording, self.recorded, self.config.surface)
            self.held_point_m = hanging.held_point_m
            self.turn_about(hanging.axis)
        elif self._segmenter is not None:
            self._find_sides()

    # ---------------------------------------------------------------- the side of interest

    @property
    def finds_sides(self) -> bool:
        """Whether the masks are found, as the recording has none of its own."""
        return self._segmenter is not None

    def solver(self, progress: Progress = no_progress) -> SideSolver:
        """Return what finds the masks; the first call looks at all views.

        Raises
        ------
        SegmentationError
            If no view shows an item, or there are two.
        """
        segmenter = self._segmenter
        assert segmenter is not None, "masks are found where a recording has none"
        return self._solver.get("solver", lambda: segmenter(self, progress))

    def segment(self, strokes: tuple[Decision, ...], progress: Progress = no_progress) -> Segmentation | None:
        """Put the masks into force that follow from strokes; None if the recording has its own.

        Raises
        ------
        SegmentationError
            If the item or its side of interest cannot be found, or a recording with masks is painted.
        """
        if not self.finds_sides:
            if strokes:
                raise SegmentationError(
                    f"{self.recording.location}: it has masks, so strokes have no effect. "
                    "Take the masks out of the recording to paint its side of interest."
                )
            return None
        with self._segmenting:
            found = self._solutions.get(strokes, lambda: self.solver(progress).solve(strokes))
            keys = tuple(found.mask_key(view) for view in range(len(self.recording)))
            changed = self.masks is None or keys != self._mask_keys
            self.masks, self._mask_keys = found, keys
            if changed:
                self.on_change()
            return found

    def _mask_key(self, view_index: int) -> int:
        return -1 if self.masks is None else self._mask_keys[view_index]

    def _segmented_key(self, view_index: int) -> tuple[int, int]:
        """Return the key of what follows from a view's mask, which is found first."""
        if self.masks is None:
            self.segment(())
        return view_index, self._mask_key(view_index)

    # ---------------------------------------------------------------- single views

    def keep_frames(self) -> None:
        """Keep the frames of all views, and read none ahead, because no operator waits."""
        if not self.keeps_frames:
            self._frames = Cache(MAX_VIEWS, _ALL_FRAMES_BYTES)
        self.keeps_frames = True

    def frame(self, view_index: int) -> RgbdFrame:
        """Read a view, with the mask in force; those read last are kept."""
        frame, masks = self.recorded(view_index), self.masks
        if masks is None:
            return frame
        mask = masks.mask(view_index)
        return replace(frame, mask=np.zeros(frame.depth_m.shape, np.bool_) if mask is None else mask)

    def recorded(self, view_index: int) -> RgbdFrame:
        """Read a view as it was recorded, without a mask found by the program."""
        return self._frames.get(view_index, lambda: self.recording[view_index])

    def cloud(self, view_index: int) -> ViewCloud:
        """Return the foreground points of a view, object frame."""
        key = view_index, self._mask_key(view_index)
        return self._clouds.get(key, lambda: self._cloud(view_index))

    def flattening(self, view_index: int) -> Flattening:
        """Return a view's flattened view with its intermediate results.

        Raises
        ------
        SurfaceError, FlatteningError
            If the view shows too little cloth; the error is cached as well.
        """
        key = self._segmented_key(view_index)
        failure = self._failures.kept(key)
        if failure is None:
            try:
                return self._flattenings.get(key, lambda: self._flatten(view_index))
            except (SurfaceError, FlatteningError) as error:
                failure = self._failures.put(key, type(error)(str(error)))
        raise failure.with_traceback(None)  # so that no frame of an earlier call is kept alive

    def release(self, views: Container[int]) -> None:
        """Free what is kept of views that have been integrated; it is made again if it is asked for."""
        if not self.keeps_frames:
            self._frames.drop(lambda key: key in views)
        self._flattenings.drop(lambda key: cast("tuple[int, int]", key)[0] in views)

    def forget_frames(self) -> None:
        """Free the frames of all views; they are read again if they are asked for."""
        self._frames.drop()

    def read_ahead(self, view_indices: Iterable[int]) -> None:
        """Read views that will probably be requested, the most probable first, on another core."""
        self._ahead.want(view_indices)

    def part(self, view_index: int, component: int) -> FlattenedView:
        """Return one component of a view's flattened view; the largest is 0."""
        components = self.flattening(view_index).components
        if not 0 <= component < len(components):
            raise FlatclothError(f"View {view_index} has {len(components)} components, not {component + 1}.")
        return components[component].view

    def observed_areas_m2(self, progress: Progress = no_progress) -> Float64:
        """Return the observed area of the side of interest in each view (n_views,), cached."""
        keys = tuple(self._mask_key(n) for n in range(len(self.recording)))
        return self._areas.get(keys, lambda: self._observed(progress))

    def unfolded_area_m2(self, view_index: int) -> float:
        """Return the area of the largest component, 0 if it is folded or cannot be flattened (cached)."""
        key = self._segmented_key(view_index)
        return self._unfolded.get(key, lambda: self._unfolded_m2(view_index))

    def _unfolded_m2(self, view_index: int) -> float:
        try:
            largest = self.flattening(view_index).components[0]
        except (SurfaceError, FlatteningError):
            return 0.0
        folded = largest.folded_share > self.config.flattening.max_folded_share
        return 0.0 if folded else largest.view.area_m2

    def _observed(self, progress: Progress) -> Float64:
        areas = np.zeros(len(self.recording))
        if self.keeps_frames:  # another thread reads them from the last one backwards, until both meet
            self._ahead.want(reversed(range(len(areas))))
        for n in range(len(areas)):
            progress(n / len(areas), f"looking for the start view: {n + 1} of {len(areas)}")
            if not self.keeps_frames:
                self._ahead.want(range(n + 1, min(n + 3, len(areas))))
            frame = self.frame(n)
            areas[n] = observed_area_m2(frame, item_mask(frame, self.axis, self.config.surface))
        return areas

    def surface(self, view_index: int) -> Surface:
        """Return the surface of a view without its flattening, which takes less time."""
        return observe_item(self.frame(view_index), self.axis, self.config.surface)

    def _flatten(self, view_index: int) -> Flattening:
        config = self.config
        try:
            surface = self.surface(view_index)
            return flatten(
                surface, self.axis, config.flattening, min_area_m2=config.surface.min_component_area_m2
            )
        except (SurfaceError, FlatteningError) as error:
            raise type(error)(f"{self.recording.location}: {error}") from None

    def unusable(self) -> set[int]:
        """Return the views that are known to show too little cloth, with the masks in force."""
        failed = (cast("tuple[int, int]", key) for key, _ in self._failures.items())
        return {view for view, key in failed if key == self._mask_key(view)}

    def _cloud(self, view_index: int) -> ViewCloud:
        frame = self.frame(view_index)
        shown = foreground_mask(frame, self.axis, self.config.surface)
        held = object_from_camera(self.axis, frame.angle_deg)
        xyz = held.apply(back_project(frame.depth_m, frame.intrinsics)[shown]).astype(np.float32)
        of_interest = shown if frame.mask is None else frame.mask
        return ViewCloud(xyz_m=xyz, rgb=frame.color[shown], of_interest=of_interest[shown])


def _fitted_to(config: Config, camera: Intrinsics, axis: RotationAxis) -> Config:
    """Return settings with sampling intervals that fit the size of the camera's pixels at the axis."""
    distance_m = float(np.linalg.norm(np.cross(axis.point_m, axis.direction)))
    pitch_m = max(distance_m, _NEAREST_M) / math.sqrt(camera.fx * camera.fy)
    own = config.flattening
    flattening = replace(own, sampling_intervals_px=widened(own.sampling_intervals_px, pitch_m))
    return replace(config, flattening=flattening)
