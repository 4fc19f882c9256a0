"""RealSense files, ``.db3`` and ``.bag``, read in a worker process."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from flatcloth.recordings.base import Recording
from flatcloth.recordings.source import Format, SourceOptions


def _recognises(path: Path) -> bool:
    from flatcloth.recordings.realsense.player import is_realsense

    return path.is_file() and is_realsense(path)


def _open(path: Path, options: SourceOptions) -> Recording:
    from flatcloth.recordings.isolated import open_realsense_isolated
    from flatcloth.recordings.realsense.turned import TurnOptions

    options.refuse(str(path), "camera_file", "fov_deg", "turning_deg", "sweep")
    turn = TurnOptions(angles=options.angles)
    if options.step_deg is not None:
        turn = replace(turn, step_deg=options.step_deg)
    return open_realsense_isolated(path, turn)


FORMAT = Format(name="realsense", what="a RealSense .db3 or .bag", recognises=_recognises, open=_open)
