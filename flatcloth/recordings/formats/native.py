"""Recording folders of this program: ``flatcloth-recording/1``."""

from __future__ import annotations

from pathlib import Path

from flatcloth.recordings.base import Recording
from flatcloth.recordings.manifest import HEADER
from flatcloth.recordings.source import Format, SourceOptions


def _recognises(path: Path) -> bool:
    return (path / HEADER).exists()


def _open(path: Path, options: SourceOptions) -> Recording:
    from flatcloth.recordings.folder import FolderRecording

    options.refuse(str(path), "angles", "step_deg", "camera_file", "fov_deg", "turning_deg", "sweep")
    return FolderRecording(path)


def _below(path: Path) -> list[Path]:
    return [] if _recognises(path) else sorted(header.parent for header in path.glob(f"*/{HEADER}"))


FORMAT = Format(
    name="flatcloth",
    what=f"a recording folder (containing {HEADER})",
    recognises=_recognises,
    open=_open,
    recordings_below=_below,
)
