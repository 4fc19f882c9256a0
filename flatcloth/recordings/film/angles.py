"""Images without angles: pairs of color and depth by time, and angles from a constant step or a table."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import TypeVar

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.recordings.files.text import read_lines, shortened

ANGLES_FILE = "angles.csv"
TOLERANCE_DEG = 0.01
"""Angles nearer than this are the same. Chosen: below the rounding of a table."""
SAME_VIEW_DEG = 0.5
"""Views nearer than this show the same; the later one is left out. Chosen: less shows little new."""
MAX_VIEWS = 10_000
"""Limit of a recording's views. Chosen: it bounds memory."""
T = TypeVar("T")
_KEYS = ("view", "file", "time_s")
_HELP = (
    "Write one line per view: the angle; or a first line file,angle_deg (or view, or time_s) and both values."
)


@dataclass(frozen=True, kw_only=True)
class Shots:
    """The images of a source: pairs of color and depth in order of capture.

    ``source`` is the name for messages; ``names`` of the color files and ``times_s`` are given if the
    source has them.
    """

    source: str
    count: int
    names: Sequence[str] | None = None
    times_s: Sequence[float] | None = None


@dataclass(frozen=True, kw_only=True)
class GivenAngles:
    """The user's information about the angles: a table, a step in degrees, or neither."""

    table: Path | None = None
    step_deg: float | None = None

    def film_step_deg(self, shots: Shots) -> float | None:
        """Return the step between the stops of a film; None if the shots are views.

        The shots are a film if they have times and there are many more of them than steps in a turn.
        """
        step_deg = self.step_deg
        if self.table is not None or step_deg is None or shots.times_s is None:
            return None
        return step_deg if abs(step_deg) >= TOLERANCE_DEG and _is_film(shots, step_deg) else None

    def views(self, shots: Shots, folder: Path | None = None) -> list[tuple[int, float]]:
        """Return the views: the number of the shot, and its angle in degrees since the first view.

        Parameters
        ----------
        shots : Shots
            The shots; a table may leave some of them out.
        folder : Path, optional
            Folder in which ``angles.csv`` is searched if no angles were given.

        Raises
        ------
        RecordingError
            If there are no angles, or they do not match the shots.
        """
        if self.table is not None and self.step_deg is not None:
            raise RecordingError(f"{self.table}: given together with --step. Give only one of them.")
        table = self.table
        if (
            table is None
            and self.step_deg is None
            and folder is not None
            and (folder / ANGLES_FILE).is_file()
        ):
            table = folder / ANGLES_FILE
        if table is not None:
            return _from_table(table.expanduser(), shots)
        if self.step_deg is None:
            raise RecordingError(
                f"{shots.source}: the angles of its {shots.count} views are not known. "
                "Give --step DEG, or --angles FILE.csv."
            )
        return _from_step(self.step_deg, shots)


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
    spare = shots.count - len(views)
    if not spare:
        return ()
    what = "1 image is" if spare == 1 else f"{spare} images are"
    return (f"{what} left out: they have no angle, or repeat another view's angle.",)


def _from_step(step_deg: float, shots: Shots) -> list[tuple[int, float]]:
    if not TOLERANCE_DEG <= abs(step_deg) <= 180:
        raise RecordingError(f"--step {step_deg:g}: give 0.01 to 180 degrees from view to view.")
    if _is_film(shots, step_deg):
        turns = shots.count * abs(step_deg) / 360.0
        raise RecordingError(
            f"{shots.source}: its {shots.count} images make {turns:.1f} turns with --step {step_deg:g}. "
            "If it is a film with stops, name one view for each stop: --angles FILE.csv."
        )
    angles: list[float] = []
    for n in range(min(shots.count, MAX_VIEWS)):
        # Images after a full turn repeat earlier angles.
        if n and apart_deg(n * step_deg, 0.0) < TOLERANCE_DEG:
            break
        angles.append(n * step_deg)
    _check(angles, f"{shots.source}: with --step {step_deg:g},", [f"view {n}" for n in range(len(angles))])
    return list(enumerate(angles))


def _is_film(shots: Shots, step_deg: float) -> bool:
    return (shots.count - 2) * abs(step_deg) > 360.0


def _from_table(table: Path, shots: Shots) -> list[tuple[int, float]]:
    keyed, rows = _read(table)
    if not keyed and len(rows) != shots.count:
        raise RecordingError(
            f"{table}: has {len(rows)} angles, but {shots.source} has {shots.count} views. "
            "Add a column view, file or time_s, or give one angle per view."
        )
    views = [
        (n if not keyed else _find(table, line, keyed, key, shots), angle)
        for n, (line, key, angle) in enumerate(rows)
    ]
    if len(views) > MAX_VIEWS:
        raise RecordingError(f"{table}: {len(views)} views. The limit is {MAX_VIEWS}: leave some out.")
    lines = [f"line {line}" for line, _, _ in rows]
    taken: dict[int, str] = {}
    for (shot, _), line in zip(views, lines, strict=True):
        if shot in taken:
            raise RecordingError(f"{table}: {line} and {taken[shot]} name the same view. Remove one.")
        taken[shot] = line
    _check([angle for _, angle in views], f"{table}:", lines)
    first = views[0][1]
    return [(shot, angle - first) for shot, angle in views]


def _read(table: Path) -> tuple[str, list[tuple[int, str, float]]]:
    """Return the name of the key column (or ""), and for each row: line number, key, angle."""
    cells = [(n, split_row(line)) for n, line in read_lines(table)]
    if not cells:
        raise RecordingError(f"{table}: has no angles. {_HELP}")
    names = [name.lower() for name in cells[0][1]]
    if "angle_deg" in names or not _is_number(names[-1]):
        if "angle_deg" not in names:
            raise RecordingError(f"{table}: line {cells[0][0]} has no column angle_deg. {_HELP}")
        angle_column, cells = names.index("angle_deg"), cells[1:]
    elif len(names) == 2 and not _is_number(names[0]):
        names, angle_column = ["file", "angle_deg"], 1
    elif len(names) == 1:
        names, angle_column = ["angle_deg"], 0
    else:
        raise RecordingError(f"{table}: line {cells[0][0]} does not show which number is the angle. {_HELP}")
    keyed = next((key for key in _KEYS if key in names), "")
    key_column = names.index(keyed) if keyed else angle_column
    rows = []
    for n, row in cells:
        if len(row) != len(names):
            raise RecordingError(f"{table}: line {n} has {len(row)} columns, not {len(names)}. {_HELP}")
        if not _is_number(row[angle_column]) or abs(float(row[angle_column])) > 3600:
            raise RecordingError(
                f"{table}: line {n} has the angle {shortened(row[angle_column])}. Give degrees."
            )
        rows.append((n, row[key_column], float(row[angle_column])))
    if not rows:
        raise RecordingError(f"{table}: has no angles. {_HELP}")
    return keyed, rows


def split_row(line: str) -> list[str]:
    """Return the cells of a line of a table: separated by commas, semicolons, tabs or spaces."""
    cells = re.split(r"[,;\t]", line) if re.search(r"[,;\t]", line) else line.split()
    return [cell.strip().strip('"') for cell in cells]


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _find(table: Path, line: int, keyed: str, key: str, shots: Shots) -> int:
    def refused(cause: str) -> RecordingError:
        return RecordingError(f"{table}: line {line}: {cause}. {_HELP}")

    if keyed == "file":
        if shots.names is None:
            raise refused(f"{shots.source} has no image files")
        wanted = PurePath(key)
        found = [
            n
            for n, name in enumerate(shots.names)
            if name == key or PurePath(name).name == key or PurePath(name).stem == wanted.name
        ]
        if len(found) != 1:
            raise refused(f"{len(found) or 'no'} color images are named {shortened(key)}")
        return found[0]
    if not _is_number(key):
        raise refused(f"{keyed} is {shortened(key)}, not a number")
    if keyed == "view":
        number = float(key)
        if not number.is_integer() or not 0 <= number < shots.count:
            raise refused(f"there is no view {shortened(key)}, they are 0 to {shots.count - 1}")
        return int(number)
    if shots.times_s is None:
        raise refused(f"{shots.source} has no times")
    times = np.asarray(shots.times_s, dtype=np.float64)
    time = float(key)
    if time < times[0] - 86_400.0:  # seconds since the first image, not a time stamp
        time += times[0]
    nearest = int(np.abs(times - time).argmin())
    gap = np.diff(times)
    usual = float(np.median(gap)) if len(gap) else 1.0
    if abs(times[nearest] - time) > max(usual, 0.02):
        raise refused(f"no image was taken at {key} s, the nearest is {times[nearest] - time:+.3f} s away")
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


def repeated(angles_deg: Sequence[float]) -> tuple[int, int] | None:
    """Return the first two views with the same angle, also modulo a full turn; None if all differ."""
    order = sorted(range(len(angles_deg)), key=lambda i: angles_deg[i] % 360)
    for a, b in zip(order, order[1:] + order[:1], strict=True):
        if a != b and apart_deg(angles_deg[a], angles_deg[b]) < TOLERANCE_DEG:
            return min(a, b), max(a, b)
    return None


def apart_deg(a_deg: float, b_deg: float) -> float:
    """Return the difference of two angles, modulo a full turn: 0 to 180."""
    return abs(math.remainder(a_deg - b_deg, 360.0))


def _check(angles_deg: Sequence[float], where: str, names: Sequence[str]) -> None:
    found = repeated(angles_deg)
    if found is not None:
        first, second = found
        raise RecordingError(
            f"{where} {names[second]} has the angle of {names[first]} ({angles_deg[first]:g} degrees). "
            "Every view needs its own angle, also modulo 360: correct or remove one."
        )
