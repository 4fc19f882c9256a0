"""A recording folder that grows while it is integrated: each view is on disk before it is used."""

from __future__ import annotations

from copy import copy

from flatcloth.core.types import Bool, Uint8
from flatcloth.recordings.base import Recording, fingerprint
from flatcloth.recordings.folder import open_folder
from flatcloth.recordings.writer import RecordingWriter, Uint16


class GrowingRecording(Recording):
    """The recording that a writer writes; from its first view on it can be integrated.

    Parameters
    ----------
    writer : RecordingWriter
        It owns the folder.
    """

    def __init__(self, writer: RecordingWriter) -> None:
        self._writer = writer
        self.angles_deg = ()
        if len(writer):
            self._open()

    def _open(self) -> None:
        vars(self).update(vars(open_folder(self._writer.folder)))

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
        self._open()
        return number

    def fingerprint_of(self, n_views: int) -> str:
        """Return the fingerprint that the recording had when it had so many views."""
        earlier = copy(self)
        earlier.angles_deg = self.angles_deg[:n_views]
        return fingerprint(earlier)

    def close(self) -> None:
        """Release the folder."""
        self._writer.close()
