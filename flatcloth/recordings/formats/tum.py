"""TUM RGB-D folders: lists of color and depth images with their times."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.recordings.base import Format, Recording
from flatcloth.recordings.files.text import inside, read_rows, shortened
from flatcloth.recordings.film.angles import pair_by_time
from flatcloth.recordings.formats.color_and_depth import recording_of
from flatcloth.recordings.formats.naming import unit_of_time
from flatcloth.recordings.options import SourceOptions

UNITS_PER_M = 5000.0
"""The TUM RGB-D format: 5000 is one metre."""
_ASSOCIATIONS = ("associations.txt", "associated.txt", "association.txt", "associate.txt")
MOST_IMAGES = 10_000
"""Images in a list. Chosen: five minutes of film; where each leads is looked up, which takes 0.3 ms."""
_SLOW_S = 5.0
"""Whole numbers this far apart may be milliseconds. Chosen: a film has ten images a second."""
_MOST_APART_S = 0.02  # as in TUM's own tool


def is_tum(folder: Path) -> bool:
    """Return whether a folder has the lists of the TUM RGB-D format."""
    lists = all((folder / name).is_file() for name in ("rgb.txt", "depth.txt"))
    return lists or any((folder / name).is_file() for name in _ASSOCIATIONS)


def open_tum(folder: Path, options: SourceOptions) -> Recording:
    """Open a TUM RGB-D folder: ``associations.txt``, or ``rgb.txt`` and ``depth.txt``."""
    folder = folder.resolve()
    listed = next((folder / name for name in _ASSOCIATIONS if (folder / name).is_file()), None)
    pairs = _paired_lists(folder) if listed is None else _associations(folder, listed)
    times_s, notes = [time for time, _, _ in pairs], []
    gap_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
    if abs(gap_s) >= _SLOW_S and all(time.is_integer() for time in times_s):
        read = f"{listed or folder / 'rgb.txt'}: its times are read as seconds, {gap_s:g} apart."
        notes.append(f"{read} Divide milliseconds by 1000.")
    return recording_of(
        folder,
        [(color, depth) for _, color, depth in pairs],
        options,
        times_s=times_s,
        units_per_m=UNITS_PER_M,
        description="TUM RGB-D folder",
        notes=notes,
    )


FORMAT = Format(
    name="tum",
    what="a TUM RGB-D folder",
    recognises=is_tum,
    open=open_tum,
    refuses=("turning_deg", "sweep"),
)


def _rows(path: Path, columns: int) -> list[tuple[int, list[str]]]:
    rows = read_rows(path)
    if len(rows) > MOST_IMAGES:
        raise RecordingError(
            f"{path}: lists {len(rows)} images; the limit is {MOST_IMAGES}. Keep a part of the list."
        )
    for n, row in rows:
        if len(row) < columns:
            raise RecordingError(
                f"{path}: line {n} has {len(row)} columns. Expected a time, a file name, ..."
            )
    if not rows:
        raise RecordingError(f"{path}: lists no images. Record at least one.")
    return rows


def _time(path: Path, line: int, text: str) -> float:
    if not re.fullmatch(r"[+-]?[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?", text):
        raise RecordingError(f"{path}: line {line} has the time {shortened(text)}. Expected seconds.")
    return float(text) * float(unit_of_time(abs(float(text))))


def _associations(folder: Path, path: Path) -> list[tuple[float, Path, Path]]:
    pairs = []
    for n, row in _rows(path, 4):
        (time_a, a), (time_b, b) = (row[0], row[1]), (row[2], row[3])
        if "depth" in a.lower() and "depth" not in b.lower():  # some programs list depth first
            (time_a, a), (_, b) = (time_b, b), (time_a, a)
        where = f"line {n}"
        pairs.append((_time(path, n, time_a), inside(folder, a, path, where), inside(folder, b, path, where)))
    return pairs


def _paired_lists(folder: Path) -> list[tuple[float, Path, Path]]:
    colors, depths = (
        [(_time(path, n, row[0]), inside(folder, row[1], path, f"line {n}")) for n, row in _rows(path, 2)]
        for path in (folder / "rgb.txt", folder / "depth.txt")
    )
    pairs = pair_by_time([t for t, _ in colors], [t for t, _ in depths], _MOST_APART_S)
    if not pairs:
        raise RecordingError(
            f"{folder}: no color image was taken within {_MOST_APART_S:g} s of a depth image. "
            "Give both lists the same clock, in seconds, or list the pairs in associations.txt."
        )
    return [(colors[i][0], colors[i][1], depths[j][1]) for i, j in pairs]
