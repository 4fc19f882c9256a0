"""The interface that every source of RGB-D views implements."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Mapping, Sized
from typing import Any, Protocol

from flatcloth.core.types import Float64, Intrinsics, RgbdFrame, RotationAxis


class Recording(Protocol):
    """A garment turned in front of a camera: a sequence of views that are read on demand."""

    @property
    def name(self) -> str:
        """Short name, for titles and session folders."""
        ...

    @property
    def description(self) -> str:
        """One sentence of free text; may be empty."""
        ...

    @property
    def location(self) -> str:
        """Where it was read from, for messages and for resuming a session."""
        ...

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera, after correction of the lens distortion."""
        ...

    @property
    def rotation_axis(self) -> RotationAxis | None:
        """The turning axis in the camera frame; None if the source does not give it."""
        ...

    @property
    def held_point_m(self) -> Float64 | None:
        """The point where the item is held, camera frame; None if the source does not give it."""
        ...

    @property
    def angles_deg(self) -> tuple[float, ...]:
        """Angle of each view about the axis since view 0."""
        ...

    @property
    def has_masks(self) -> bool:
        """Whether every view has a mask of the side of interest."""
        ...

    def __len__(self) -> int:
        """Return the number of views."""
        ...

    def __getitem__(self, view_index: int) -> RgbdFrame:
        """Read one view; raises ``RecordingError`` with file, cause and remedy."""
        ...


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


def fingerprint(recording: Recording) -> str:
    """Return 16 hexadecimal digits that identify a recording, also after it was moved.

    They depend on name, camera, axis, held point, angles and the presence of masks, not on the
    location and the pixels.
    """
    camera, axis, held = recording.intrinsics, recording.rotation_axis, recording.held_point_m
    content = [
        recording.name,
        [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy],
        None if axis is None else [axis.point_m.tolist(), axis.direction.tolist()],
        None if held is None else held.tolist(),
        list(recording.angles_deg),
        recording.has_masks,
    ]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]
