"""Images without angles: pairs of color and depth by time, and angles from a constant step or a table."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import TypeVar

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Float64
from flatcloth.recordings.base import MAX_VIEWS, TOLERANCE_DEG, apart_deg, check_distinct
from flatcloth.recordings.files.text import failing, read_rows, shortened, unused
from flatcloth.recordings.options import SourceOptions

ANGLES_FILE = "angles.csv"
_MOSTLY = 1 / 3
"""If more color images than this share lack depth, depth has another rate, and steps are of shots. Chosen."""
_MOST_DEG, _MOST_OF_USUAL = 3600.0, 10.0
"""Larger angles are slips of the pen, unless all are, as steps of an encoder, whose unit is found. Chosen."""
T = TypeVar("T")
_KEYS = ("view", "file", "time_s")
_HELP = (
    "Write one line per view: the angle; or a first line file,angle_deg (or view, or time_s) and both values."
)


@dataclass(frozen=True, kw_only=True)
class Shots:
    """The images of a source: pairs of color and depth in order of capture.

    ``source`` is the name for messages; ``names`` of the color files and ``times_s`` are given if the
    source has them. ``every`` are the names of all color files, also of those that are no shots; ``slots``
    are the places of the shots in an even sequence, if names show that some of it are missing.
    """

    source: str
    count: int
    names: Sequence[str] | None = None
    times_s: Sequence[float] | None = None
    every: Sequence[str] = ()
    slots: Sequence[int] | None = None

    @property
    def places(self) -> Sequence[int]:
        """The place (N,) of each shot among all that were taken, as far as names tell."""
        if self.slots is not None:
            return self.slots
        is_lost = 0 < len(self.every) - self.count <= max(1, _MOSTLY * self.count)
        return self.of_files if is_lost else range(self.count)

    @property
    def of_files(self) -> Sequence[int]:
        """The place (N,) of each shot among all color files; empty if they are not known."""
        return [self.every.index(name) for name in self.names or () if self.every]


def film_step_deg(options: SourceOptions, shots: Shots) -> float | None:
    """Return the step between the stops of a film; None if the shots are views.

    The shots are a film if they have times and there are many more of them than steps in a turn.
    """
    step_deg = options.step_deg
    if options.angles is not None or step_deg is None or shots.times_s is None:
        return None
    return step_deg if abs(step_deg) >= TOLERANCE_DEG and _is_film(shots, step_deg) else None


def views_of(shots: Shots, options: SourceOptions, folder: Path | None = None) -> list[tuple[int, float]]:
    """Return the views: the number of the shot, and its angle in degrees since the first view.

    Parameters
    ----------
    shots : Shots
        The shots; a table may leave some of them out.
    options : SourceOptions
        A table of angles, or a step. If the angles are multiplied, they are the same if they are so then.
    folder : Path, optional
        Folder in which ``angles.csv`` is searched if no angles were given.

    Raises
    ------
    RecordingError
        If there are no angles, or they do not match the shots.
    """
    step_deg = options.step_deg
    fail = failing(shots.source)
    if options.angles is not None and step_deg is not None:
        raise RecordingError(f"{options.angles}: given together with --step. Give only one of them.")
    table = _table(options, folder)
    if table is not None:
        return _from_table(table, shots, 1.0 if options.mends is None else options.mends.angle_factor)
    if step_deg is None:
        unknown = f"the angles of its {shots.count} views are not known"
        fail(unknown, "Give --step DEG, or --angles FILE.csv.")
    if not TOLERANCE_DEG <= abs(step_deg) <= 180:
        raise RecordingError(f"--step {step_deg:g}: give 0.01 to 180 degrees from view to view.")
    if _is_film(shots, step_deg):
        turns = f"{shots.count * abs(step_deg) / 360.0:.1f} turns with --step {step_deg:g}"
        stops = "If it is a film with stops, name one view for each stop: --angles FILE.csv."
        fail(f"its {shots.count} images make {turns}", stops)
    turned = [(place - shots.places[0]) * step_deg for place in list(shots.places)[:MAX_VIEWS]]
    # Images after a full turn repeat earlier angles.
    return [(n, angle) for n, angle in enumerate(turned) if abs(angle) <= 360.0 - TOLERANCE_DEG]


def notes_of(options: SourceOptions, folder: Path | None = None) -> list[str]:
    """Return a note on the columns of the table that are not understood, if there are any."""
    table = _table(options, folder)
    if table is None or len(names := read_rows(table)[0][1]) < 2 or _is_number(names[-1]):
        return []
    return unused(table, [name for name in names if name.lower() not in (*_KEYS, "angle_deg")])


def _table(options: SourceOptions, folder: Path | None) -> Path | None:
    if options.angles is not None:
        return options.angles.expanduser()
    own = None if folder is None or options.step_deg is not None else folder / ANGLES_FILE
    return own if own is not None and own.is_file() else None


def pair_by_time(
    color_s: Sequence[float], depth_s: Sequence[float], most_apart_s: float
) -> list[tuple[int, int]]:
    """Return pairs of indices, in the order of the color times; each image is in at most one pair.

    Parameters
    ----------
    color_s, depth_s : sequences of float
        Times in seconds, in any order.
    most_apart_s : float
        Images farther apart are not paired. The nearest are paired first.
    """
    color = np.asarray(color_s, dtype=np.float64)
    depth = np.asarray(depth_s, dtype=np.float64)
    order = np.argsort(depth, kind="stable")
    low = np.searchsorted(depth[order], color - most_apart_s)
    high = np.searchsorted(depth[order], color + most_apart_s, side="right")
    candidates = sorted(
        (abs(float(color[i] - depth[j])), i, int(j))
        for i in range(len(color))
        for j in order[low[i] : high[i]]
    )
    of_color: dict[int, int] = {}
    taken: set[int] = set()
    for _, i, j in candidates:
        if i not in of_color and j not in taken:
            of_color[i] = j
            taken.add(j)
    return [(i, of_color[i]) for i in np.argsort(color, kind="stable").tolist() if i in of_color]


def left_out(shots: Shots, views: Sequence[tuple[int, float]]) -> tuple[str, ...]:
    """Return a note on the shots that are not views, if there are any."""
    spare, gaps = shots.count - len(views), shots.places[-1] + 1 - shots.places[0] - shots.count
    what = "1 image is" if spare == 1 else f"{spare} images are"
    notes = [f"{what} left out: they have no angle, or repeat another view's angle."] if spare else []
    if gaps > 0:
        notes.append(f"{gaps} of the numbers in the names are missing between the views: steps count them.")
    return tuple(notes)


def _is_film(shots: Shots, step_deg: float) -> bool:
    return (shots.count - 2) * abs(step_deg) > 360.0


def _from_table(table: Path, shots: Shots, factor: float) -> list[tuple[int, float]]:
    keyed, rows = _read(table)
    fail = failing(table)
    least = max((float(key) + 1 for _, key, _ in rows if _is_number(key)), default=0) if keyed else len(rows)
    numbered = _numbered(shots, lambda count: least <= count if keyed else least == count)
    if not numbered and not keyed:
        cause = f"has {len(rows)} angles, but {shots.source} has {shots.count} views"
        fail(cause, "Add a column view, file or time_s, or give one angle per view.")
    kept: dict[int, tuple[float, str]] = {}
    for n, (line, key, angle) in enumerate(rows):
        shot = _find(f"{table}: line {line}", keyed, key, shots, numbered) if keyed else numbered[n]
        if shot in kept:
            fail(f"line {line} and {kept[shot][1]} name the same view", "Remove one.")
        if shot is not None:
            kept[shot] = angle, f"line {line}"
    if not kept:
        fail("names no view", _HELP)
    if len(kept) > MAX_VIEWS:
        raise RecordingError(f"{table}: {len(kept)} views. The limit is {MAX_VIEWS}: leave some out.")
    views = [(shot, angle) for shot, (angle, _) in kept.items()]
    angles, first = [factor * angle for _, angle in views], views[0][1]
    if np.ptp(angles) > 360.0 + TOLERANCE_DEG:  # more turns than one, or another unit
        seen = [view for _, view in distinct(list(zip(angles, views, strict=True)), TOLERANCE_DEG)]
        return [(shot, angle - first) for shot, angle in (seen if 2 * len(seen) >= len(views) else views)]
    check_distinct(angles, f"{table}:", [line for _, line in kept.values()])
    return [(shot, angle - first) for shot, angle in views]


def _numbered(shots: Shots, fits: Callable[[int], bool]) -> dict[float, int | None]:
    """Return the shots by their numbers, None of an image that was lost or has no partner.

    The shots are counted, or what was taken, or the color files, whichever has a count that fits; empty if
    none has.
    """
    ways = (range(shots.count), shots.places, shots.of_files)
    for places, count in zip(ways, (shots.count, shots.places[-1] + 1, len(shots.every)), strict=True):
        if places and fits(count):
            of_place = {place: shot for shot, place in enumerate(places)}
            return {float(n): of_place.get(n) for n in range(count)}
    return {}


def _read(table: Path) -> tuple[str, list[tuple[int, str, float]]]:
    """Return the name of the key column (or ""), and for each row: line number, key, angle."""
    cells, fail = read_rows(table), failing(table)
    first, names = (cells[0][0], [name.lower() for name in cells[0][1]]) if cells else (0, ["angle_deg"])
    if "angle_deg" in names or not _is_number(names[-1]):
        cells = cells[1:]
        if "angle_deg" not in names:
            fail(f"line {first} has no column angle_deg", _HELP)
    elif len(names) == 1 or (len(names) == 2 and not _is_number(names[0])):
        names = ["file", "angle_deg"][-len(names) :]
    else:
        points = "Decimals have a point; with a comma, separate the columns by semicolons."
        fail(f"line {first} does not show which number is the angle", f"{_HELP} {points}")
    if not cells:
        fail("has no angles", _HELP)
    keyed, at = next((key for key in _KEYS if key in names), ""), names.index("angle_deg")
    key_at, rows = names.index(keyed) if keyed else at, list[tuple[int, str, float]]()
    for n, row in cells:
        if len(row) != len(names):
            fail(f"line {n} has {len(row)} columns, not {len(names)}", _HELP)
        if not _is_number(row[at]):
            fail(f"line {n} has the angle {shortened(row[at])}", "Give degrees.")
        rows.append((n, row[key_at], float(row[at])))
    usual = float(np.median([abs(angle) for _, _, angle in rows]))
    for n, _, angle in rows:
        if abs(angle) > max(_MOST_DEG, _MOST_OF_USUAL * usual):
            fail(f"line {n} has the angle {angle:g}", "Give degrees.")
    return keyed, rows


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _find(where: str, keyed: str, key: str, shots: Shots, numbered: Mapping[float, int | None]) -> int | None:
    """Return the shot that a key of a table names, None if it was lost; ``where`` the key stands."""
    fail, names = failing(where), shots.names
    if keyed == "file":
        if names is None:
            fail(f"{shots.source} has no image files", _HELP)
        found = [
            name
            for name in shots.every or names
            if key in (name, PurePath(name).name) or PurePath(name).stem == PurePath(key).name
        ]
        if len(found) != 1:
            fail(f"{len(found) or 'no'} color images are named {shortened(key)}", _HELP)
        return names.index(found[0]) if found[0] in names else None
    if not _is_number(key):
        fail(f"{keyed} is {shortened(key)}, not a number", _HELP)
    if keyed == "view":
        if float(key) not in (numbered or range(shots.count)):
            fail(f"there is no view {shortened(key)}, they are 0 to {shots.count - 1}", _HELP)
        return numbered.get(float(key), int(float(key)))
    if shots.times_s is None:
        fail(f"{shots.source} has no times", _HELP)
    times, time = np.asarray(shots.times_s, dtype=np.float64), float(key)
    if time < times[0] - 86_400.0:  # seconds since the first image, not a time stamp
        time += times[0]
    nearest = int(np.abs(times - time).argmin())
    usual = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    if abs(times[nearest] - time) > max(usual, 0.02):
        away = f"the nearest is {times[nearest] - time:+.3f} s away"
        fail(f"no image was taken at {key} s, {away}", _HELP)
    return nearest


def distinct(views: Sequence[tuple[float, T]], least_deg: float) -> list[tuple[float, T]]:
    """Return the views, each with its angle first, without those that repeat an angle after a full turn."""
    kept: list[tuple[float, T]] = []
    for view in views:
        if all(apart_deg(view[0], angle) >= least_deg for angle, _ in kept):
            kept.append(view)
    return kept


def stops_found(count: int) -> str:
    """Return "3 stops were found"."""
    return "1 stop was found" if count == 1 else f"{count} stops were found"


_TIMES_HELP = "Expected lines of two numbers: seconds since the first frame, and the angle in degrees."


def read_turning(table: Path, first_clock_s: float, seconds: float) -> tuple[Float64, Float64]:
    """Return the times (N,) in seconds, increasing, and the angles (N,) in degrees of a table of both.

    Parameters
    ----------
    table : Path
        Text with two columns, time in seconds and angle in degrees; a line of names may be first.
    first_clock_s : float
        The camera's clock at the first frame. Times use this clock or count from that frame.
    seconds : float
        Duration of the file.
    """
    rows, fail = list[tuple[float, float]](), failing(table)
    for place, (number, cells) in enumerate(read_rows(table)):
        try:
            time_s, angle_deg = (float(cell) for cell in cells if cell)
        except ValueError:
            if place == 0:
                continue  # the names of the columns
            fail(f"line {number} is {shortened(' '.join(cells))}", _TIMES_HELP)
        if not math.isfinite(time_s) or not abs(angle_deg) <= 100_000:
            fail(f"line {number} has a number out of range", _TIMES_HELP)
        if rows and time_s <= rows[-1][0]:
            fail(f"line {number} is not later than the previous line", "Sort the table by time.")
        rows.append((time_s, angle_deg))
    if not rows:
        fail("has no angles", _TIMES_HELP)
    times_s, angles_deg = np.array(rows).T
    common_s = {
        origin_s: min(times_s[-1] - origin_s, seconds) - max(times_s[0] - origin_s, 0.0)
        for origin_s in (0.0, first_clock_s)
    }
    origin_s = max(common_s, key=lambda origin: common_s[origin])
    if common_s[origin_s] < 0:
        times = f"({times_s[0]:g} to {times_s[-1]:g} s) do not match the recording (0 to {seconds:.1f} s)"
        fail(f"its times {times}", "Count seconds from its first frame, or use the camera's clock.")
    return times_s - origin_s, angles_deg
