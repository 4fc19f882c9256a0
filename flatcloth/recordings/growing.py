"""A recording folder that grows while it is integrated: each view is on disk before it is used."""

from __future__ import annotations

from dataclasses import replace

from flatcloth.core.types import Bool, Float64, Intrinsics, RgbdFrame, RotationAxis, Uint8
from flatcloth.recordings.base import LazyRecording, fingerprint
from flatcloth.recordings.folder import open_folder
from flatcloth.recordings.writer import RecordingWriter, Uint16


class GrowingRecording:
    """The recording that a writer writes; from its first view on it can be integrated.

    Parameters
    ----------
    writer : RecordingWriter
        It owns the folder.
    """

    def __init__(self, writer: RecordingWriter) -> None:
        self._writer = writer
        self._opened: LazyRecording | None = open_folder(writer.folder) if len(writer) else None

    def add(
        self,
        angle_deg: float,
        color: Uint8,
        depth_units: Uint16,
        mask: Bool | None = None,
        truth_bgr: Uint16 | None = None,
    ) -> int:
        """Write a view, and return its number; see :meth:`RecordingWriter.add`."""
        number = self._writer.add(angle_deg, color, depth_units, mask, truth_bgr)
        self._opened = open_folder(self._writer.folder)
        return number

    def fingerprint_of(self, n_views: int) -> str:
        """Return the fingerprint that the recording had when it had so many views."""
        return fingerprint(replace(self._now, angles_deg=self.angles_deg[:n_views]))

    @property
    def _now(self) -> LazyRecording:
        assert self._opened is not None, "a recording has a view"
        return self._opened

    @property
    def name(self) -> str:
        """Short name."""
        return self._now.name

    @property
    def description(self) -> str:
        """One sentence of free text."""
        return self._now.description

    @property
    def location(self) -> str:
        """The folder."""
        return self._now.location

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera."""
        return self._now.intrinsics

    @property
    def rotation_axis(self) -> RotationAxis | None:
        """The turning axis, camera frame; None if it was not given."""
        return self._now.rotation_axis

    @property
    def held_point_m(self) -> Float64 | None:
        """The point (3,) where the item is held, camera frame; None if it was not given."""
        return self._now.held_point_m

    @property
    def angles_deg(self) -> tuple[float, ...]:
        """Angle of each view since view 0."""
        return () if self._opened is None else self._opened.angles_deg

    @property
    def has_masks(self) -> bool:
        """Whether every view has a mask."""
        return self._now.has_masks

    def __len__(self) -> int:
        """Return the number of views."""
        return 0 if self._opened is None else len(self._opened)

    def __getitem__(self, view_index: int) -> RgbdFrame:
        """Read one view."""
        return self._now[view_index]

    def close(self) -> None:
        """Release the folder."""
        self._writer.close()
