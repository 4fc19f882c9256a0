"""The recording that every source of RGB-D views returns, and the interface of a format that reads them."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence, Sized
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Bool, Float32, Float64, Intrinsics, RgbdFrame, RotationAxis, Uint8
from flatcloth.recordings.options import SourceOptions

SAME_VIEW_DEG = 0.5
"""Views nearer than this show the same; the later one is left out. Chosen: less shows little new."""
TOLERANCE_DEG = 0.01
"""Angles nearer than this are the same. Chosen: below the rounding of a table."""
MAX_VIEWS = 10_000
"""Limit of a recording's views. Chosen: it bounds memory."""


class ViewImages(NamedTuple):
    """The images of a view: ``color`` (H, W, 3) RGB, ``depth_m`` (H, W), ``mask`` (H, W) or None.

    ``other_mask`` (H, W) is that of the other side, None if it is not known.
    """

    color: Uint8
    depth_m: Float32
    mask: Bool | None = None
    other_mask: Bool | None = None


@dataclass(kw_only=True, eq=False)
class Recording:
    """A garment turned in front of a camera: a sequence of views that are read on demand.

    Parameters
    ----------
    name : str
        Short name, for titles and session folders.
    location : str
        Where it was read from, for messages and for resuming a session.
    intrinsics : Intrinsics
        The camera, after correction of the lens distortion.
    angles_deg : tuple of float
        Angle of each view about the axis since view 0.
    read : callable
        Returns the images of a view, given its number; raises ``RecordingError`` with file, cause and remedy.
    description : str
        One sentence of free text; may be empty.
    notes : tuple of str
        Remarks for the operator on how the recording was read.
    rotation_axis, held_point_m : RotationAxis, array (3,)
        The turning axis, and where the item is held, camera frame; None if the source does not give them.
    has_masks : bool
        Whether every view has a mask of the side of interest.
    mends : Mends
        What is read otherwise than recorded (``flatcloth.recordings.mending``), None if nothing is.
    """

    name: str
    location: str
    intrinsics: Intrinsics
    angles_deg: tuple[float, ...]
    read: Callable[[int], ViewImages] = field(repr=False)
    description: str = ""
    notes: tuple[str, ...] = ()
    rotation_axis: RotationAxis | None = None
    held_point_m: Float64 | None = None
    has_masks: bool = False
    mends: Any = None
    is_growing: ClassVar[bool] = False
    """Whether views are still added to it."""

    def __len__(self) -> int:
        """Return the number of views."""
        return len(self.angles_deg)

    def __getitem__(self, view_index: int) -> RgbdFrame:
        """Read one view; nothing is cached.

        Raises
        ------
        IndexError
            If there is no such view; negative numbers do not count from the end.
        RecordingError
            If the view is damaged, has changed since opening, or has no depth.
        """
        check_index(self, view_index)
        color, depth_m, mask, other_mask = self.read(view_index)
        return RgbdFrame(
            view_index=view_index,
            angle_deg=self.angles_deg[view_index],
            color=color,
            depth_m=depth_m,
            mask=mask,
            other_mask=other_mask,
            intrinsics=self.intrinsics,
        )


def altered(recording: Recording, **changes: Any) -> Recording:
    """Return a recording like another, but for the attributes that are given; ``read`` may be one of them."""
    names = [own.name for own in fields(Recording) if hasattr(recording, own.name)]
    same = {name: getattr(recording, name) for name in names}
    return Recording(**(same | {"read": lambda n: images_of(recording[n])} | changes))


def images_of(frame: RgbdFrame) -> ViewImages:
    """Return the images of a frame."""
    return ViewImages(frame.color, frame.depth_m, frame.mask, frame.other_mask)


_SOURCE_OPTIONS = "source_options"


def keep_source_options(recording: Recording, options: Mapping[str, Any]) -> None:
    """Keep with a recording the options that it was opened with (``SourceOptions.to_dict``)."""
    with contextlib.suppress(AttributeError):  # a format of another package may have __slots__
        setattr(recording, _SOURCE_OPTIONS, dict(options))


def source_options(recording: Recording) -> dict[str, Any]:
    """Return the options that a recording was opened with, to open it again; empty if there are none."""
    options: dict[str, Any] = getattr(recording, _SOURCE_OPTIONS, {})
    return options


def check_index(recording: Sized, view_index: int) -> None:
    """Raise ``IndexError`` if a recording has no such view; negative numbers do not count from the end."""
    if not 0 <= view_index < len(recording):
        raise IndexError(f"view {view_index} of {len(recording)}")


def apart_deg(a_deg: float, b_deg: float) -> float:
    """Return the difference of two angles, modulo a full turn: 0 to 180."""
    return abs(math.remainder(a_deg - b_deg, 360.0))


def check_distinct(angles_deg: Sequence[float], where: str, names: Sequence[str]) -> None:
    """Raise ``RecordingError`` if two views, which have ``names``, have the same angle, or are too many."""
    if len(angles_deg) > MAX_VIEWS:
        raise RecordingError(f"{where} {len(angles_deg)} views. The limit is {MAX_VIEWS}: leave some out.")
    order = sorted(range(len(angles_deg)), key=lambda n: angles_deg[n] % 360)
    for pair in zip(order, order[1:] + order[:1], strict=True):
        first, second = sorted(pair)
        if first != second and apart_deg(angles_deg[first], angles_deg[second]) < TOLERANCE_DEG:
            same = f"has the angle of {names[first]} ({abs(angles_deg[first]):g} degrees)"
            raise RecordingError(
                f"{where} {names[second]} {same}. "
                "Every view needs its own angle, also modulo 360: correct or remove one."
            )


def fingerprint(recording: Recording, n_views: int | None = None) -> str:
    """Return 16 hexadecimal digits that identify a recording, also after it was moved.

    They depend on name, camera, axis, held point, angles, the presence of masks, and mends, not on the
    location and the pixels. ``n_views`` gives those of a growing one when it had so many views.
    """
    camera, axis, held = recording.intrinsics, recording.rotation_axis, recording.held_point_m
    content = [
        recording.name,
        [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy],
        None if axis is None else [axis.point_m.tolist(), axis.direction.tolist()],
        None if held is None else held.tolist(),
        list(recording.angles_deg[:n_views]),
        recording.has_masks,
    ]
    if mends := getattr(recording, "mends", None):
        content.append(mends.to_dict())
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]


@dataclass(frozen=True, kw_only=True)
class Format:
    """A format of sources: one module, listed in ``recordings.registry`` or by another package's entry point.

    Parameters
    ----------
    name : str
        One word, for ``--format`` and for manifests.
    what : str
        Description of such a source in messages: "a TUM RGB-D folder".
    recognises : callable
        Returns whether a path is such a source; must be quick and must not raise.
    open : callable
        Opens a source; raises ``RecordingError`` with one line, ``<file>: cause. remedy.``
    refuses : tuple of str
        Options that do not apply to such a source.
    recordings_below : callable, optional
        For data sets: returns the sources in a folder, in order; none if it is not such a folder.
    """

    name: str
    what: str
    recognises: Callable[[Path], bool]
    open: Callable[[Path, SourceOptions], Recording]
    refuses: tuple[str, ...] = ()
    recordings_below: Callable[[Path], Sequence[Path]] | None = None
