"""The truth of a synthetic recording; only the evaluation uses it, never the method."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Bool, Float32, Uint8
from flatcloth.recordings.base import check_index
from flatcloth.recordings.files import images
from flatcloth.recordings.folder import HEADER, open_folder

_UNITS_PER_M = 20000.0
"""The format: 16 bits in units of 0.05 mm ..."""
_OFFSET_M = 1.5
"""... from this far left of and above the origin; ..."""
_OUTER_FACE = 16
"""... the code of a pixel is its panel, plus this if seen from outside."""


@dataclass(frozen=True, kw_only=True)
class TrueView:
    """The true content of one view.

    ``panel`` (H, W) uint8: 1 front, 2 back, 0 none; ``outer_face`` (H, W) bool: True where the
    panel is seen from outside; ``flat_uv_m`` (H, W, 2) float32: true position on the flattened plane
    (u right, v down, seen from outside), up to one rigid motion; NaN where there is no panel.
    """

    panel: Uint8
    outer_face: Bool
    flat_uv_m: Float32


class Truth:
    """The truth of a recording folder (``recording.location``): a sequence of :class:`TrueView`.

    Raises
    ------
    RecordingError
        If the folder is not a recording, or has no truth.
    """

    def __init__(self, folder: str | Path) -> None:
        self._recording = recording = open_folder(Path(folder))
        header, file = recording.truth, Path(recording.location) / HEADER
        if header is None or any(view.truth is None for view in recording.files):
            raise RecordingError(f"{file}: has no truth. Only a synthetic recording can be evaluated.")
        panel = header.get("panel_of_interest") if isinstance(header, dict) else None
        if isinstance(panel, bool) or panel not in (1, 2):
            raise RecordingError(
                f"{file}: truth.panel_of_interest is not 1 (front) or 2 (back). Set one of them."
            )
        self.panel_of_interest: int = panel
        self.garment = str(header.get("garment", ""))

    def __len__(self) -> int:
        """Return the number of views."""
        return len(self._recording)

    def __getitem__(self, view_index: int) -> TrueView:
        """Read the truth of one view.

        Raises
        ------
        IndexError
            If there is no such view.
        RecordingError
            If its image is missing, damaged, or of the wrong kind or size.
        """
        check_index(self, view_index)
        path = self._recording.files[view_index].truth
        assert path is not None  # checked by the constructor
        images.read_checked(path, "truth", self._recording.intrinsics)
        undistort = self._recording.lens.undistort
        bgr = undistort(images.decode_raw(path, np.uint16), blend=False)
        code = bgr[..., 0].astype(np.uint8)
        panel: Uint8 = code & np.uint8(_OUTER_FACE - 1)
        flat = bgr[..., :0:-1].astype(np.float32) / np.float32(_UNITS_PER_M) - np.float32(_OFFSET_M)
        flat[panel == 0] = np.nan
        return TrueView(panel=panel, outer_face=(code & _OUTER_FACE) != 0, flat_uv_m=flat)
