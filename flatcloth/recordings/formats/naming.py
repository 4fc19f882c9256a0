"""What the names of image files say: their order, which belong together, and which are missing.

Names speak by equal stems, by numbers or by times. Streams may count from different starts, have clocks of
their own or run at different rates; what two streams cannot tell is refused, never guessed.
"""

from __future__ import annotations

import itertools
import re
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Float64

_NUMBER = re.compile(r"\d+(?:\.\d+)?")
_DATE = re.compile(
    r"(?<![0-9])((?:19|20)[0-9]{2})[-_.]?([01][0-9])[-_.]?([0-3][0-9])[-_. T]?"
    r"([0-2][0-9])[-_.:h]?([0-5][0-9])[-_.:m]?([0-5][0-9])(?:[-_.,]([0-9]{1,9}))?(?![0-9])"
)
_ENDS = 12
"""Streams may begin or end this many frames apart. Chosen: one loses that many while the other starts."""
_SAME = 0.5
"""Two ways to pair that differ by less than this many pairs are as good. Chosen."""
_CLEARLY = 2.5
"""A shift that pairs so many more is a second way to pair, though some remain alone. Chosen."""
_USUAL_SHARE = 0.75
"""If this share of the steps between numbers is the same, the others are gaps. Chosen."""
_LEAST_TIME = 100_000_000
"""Larger numbers are times since 1970: these are of 1973, in seconds. By definition."""
_SAME_CLOCK = 0.05
"""Times of one clock differ by less than this share of the interval between frames. Chosen."""


def in_order(files: Sequence[Path]) -> list[Path]:
    """Return files in the order of the numbers or times in their names: 2 before 10."""

    def place(file: Path) -> list[tuple[Decimal, str]]:
        texts, numbers = _parts(file.stem)
        # Numbers are compared with numbers: text stands at the even places.
        return [pair for text, n in zip(texts, [*numbers, Decimal(-1)], strict=True)
                for pair in ((Decimal(-1), text), (n, ""))]  # fmt: skip

    return sorted(files, key=place)


def slots(stems: Sequence[str]) -> list[int] | None:
    """Return the place of each name in an even sequence, from 0, also of the names that are missing in it.

    None if the names, which are in order, show no even steps.
    """
    for field in _fields(stems):
        values = np.array([float(value - field[min(field)]) for value in field.values()])
        steps = np.diff(values)
        if len(field) < len(stems) or len(steps) < 3 or steps.min() <= 0:
            continue
        places = np.rint(values / np.median(steps))
        whole = np.abs(values / np.median(steps) - places).max() < 0.5 * _USUAL_SHARE - 0.25
        if whole and np.mean(np.diff(places) == 1) >= _USUAL_SHARE:
            return [int(place) for place in places]
    return None


def partners(ones: Sequence[Path], others: Sequence[Path]) -> dict[int, int]:
    """Return the place of each file of a stream that has a partner in another, and the partner's, in order.

    Parameters
    ----------
    ones, others : sequences of Path
        The files of two folders, each in order.

    Raises
    ------
    RecordingError
        If names speak in two ways, or say nothing and the numbers of files differ.
    """
    stems = [[file.stem for file in files] for files in (ones, others)]
    for files, named in zip((ones, others), stems, strict=True):
        if len(set(named)) < len(named):
            raise RecordingError(f"{files[0].parent}: has one image in two file formats. Remove one of them.")
    by_stem, fewer = {stem: n for n, stem in enumerate(stems[1])}, min(map(len, stems))
    best = {n: by_stem[stem] for n, stem in enumerate(stems[0]) if stem in by_stem}
    if len(best) < fewer:
        told, times, doubt = [best], [], ""
        for one, other in itertools.product(*map(_fields, stems)):
            try:
                told.append(_paired(one, other))
            except _TwoWaysError as error:
                doubt = f"{ones[0].parent} and {others[0].parent.name}/: {error}"
                continue
            if min(*one.values(), *other.values()) > _LEAST_TIME and 2 * len(told[-1]) >= fewer:
                times.append(told[-1])
        if doubt and not times:
            raise RecordingError(doubt)
        # A stream that counts its own frames does not show which it lost: times do.
        best = max(times or told, key=len)
    if 2 * len(best) >= fewer:
        return best
    if len(ones) != len(others):
        raise RecordingError(
            f"{ones[0].parent}: has {len(ones)} images, but {others[0].parent.name} has {len(others)}, "
            "with other names. Give each pair the same name."
        )
    return {n: n for n in range(len(ones))}


def without_partner(files: Sequence[Path], paired: Mapping[int, int], others: Sequence[Path]) -> list[str]:
    """Return a note that names the files of two folders that have no partner; empty if all have one."""
    alone = [file for n, file in enumerate(files) if n not in paired]
    alone += [file for n, file in enumerate(others) if n not in paired.values()]
    names = [f"{file.parent.name}/{file.name}" for file in alone]
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    what = f"{files[0].parent.name}/ and {others[0].parent.name}/"
    return [f"Without partner in {what}, left out: {', '.join(names[:4])}{more}."] if alone else []


def _parts(stem: str) -> tuple[tuple[str, ...], list[Decimal]]:
    """Return the texts of a name between its numbers, and the numbers; a date is one number, in seconds."""

    def seconds(match: re.Match[str]) -> str:
        *date, fraction = match.groups()
        try:
            time = datetime(*map(int, date), tzinfo=UTC)  # type: ignore[arg-type, misc]
        except ValueError:
            return match[0]
        return f"{int(time.timestamp())}.{fraction or 0}"

    # Digits of all scripts count, also circled, raised or wide ones, which compatibility forms replace.
    stem = _DATE.sub(seconds, unicodedata.normalize("NFKC", stem))
    return tuple(_NUMBER.split(stem)), [Decimal(number) for number in _NUMBER.findall(stem)]


def _fields(stems: Sequence[str]) -> list[dict[int, Decimal]]:
    """Return the numbers that tell names apart, each by the places of the names that have it."""
    parts = [_parts(stem) for stem in stems]
    usual = Counter(texts for texts, _ in parts).most_common(1)[0][0]
    fields = []
    for n in range(len(usual) - 1):
        first: dict[Decimal, int] = {}
        for place, (texts, numbers) in enumerate(parts):
            if texts == usual:
                first.setdefault(numbers[n], place)
        if len(first) > max(1, _USUAL_SHARE * len(stems)):
            fields.append({place: number for number, place in first.items()})
    return fields


class _TwoWaysError(ValueError):
    """The numbers of two streams pair in two ways."""


class _Fit(NamedTuple):
    """Two streams whose numbers differ by an offset: the places of the pairs in both."""

    offset: float
    ones: NDArray[np.intp]
    others: NDArray[np.intp]
    apart: Float64
    """How far each of the first stream is from its partner, in shares of the largest distance; 1: alone."""

    @property
    def told(self) -> float:
        """The number of pairs, each counted by how near its ends are."""
        return float((1.0 - self.apart).sum())


def _paired(one: Mapping[int, Decimal], other: Mapping[int, Decimal]) -> dict[int, int]:
    """Return the pairs of places whose numbers are nearest to each other, but for an offset."""
    times = [
        [unit * number for number in field.values()]
        for field in (one, other)
        for unit in [unit_of_time(min(field.values()))]
    ]
    a, b = (np.array([float(time - min(map(min, times))) for time in each]) for each in times)
    fit = _fitted(a, b, 0.499 * min(float(np.median(np.diff(np.sort(x)))) for x in (a, b)))
    if fit is None or not len(fit.ones):
        return {}
    apart, places = fit.apart[fit.ones], [list(one), list(other)]
    # Where both streams lost a frame, neighbours remain: they are farther apart than the others.
    near = apart <= max(6.0 * float(np.median(apart)), 0.1)
    return {places[0][i]: places[1][j] for i, j in zip(fit.ones[near], fit.others[near], strict=True)}


def unit_of_time(time: Decimal | float) -> Decimal:
    """Return the seconds of a time stamp's unit: since 1970, in s, ms, us or ns; 1 for other numbers."""
    unit = Decimal(1)
    while unit > Decimal("1e-9") and unit * Decimal(time) >= 10**11:  # s of the year 5138
        unit /= 1000
    return unit


def _fitted(one: Float64, other: Float64, within: float) -> _Fit | None:
    """Return the offset of one stream's numbers to the other's; None if they have nothing common."""

    def at(offset: float) -> _Fit:
        """Return the pairs near an offset: the nearest of each other."""
        shifted = one - offset
        nearest = cKDTree(other[:, None]).query(shifted[:, None])[1]
        mutual = cKDTree(shifted[:, None]).query(other[:, None])[1][nearest] == np.arange(len(one))
        off = shifted - other[nearest]
        (ones,) = np.nonzero(mutual & (np.abs(off) <= within))
        middle = float(np.median(off[ones])) if len(ones) else 0.0
        apart = np.ones(len(one))
        apart[ones] = np.minimum(np.abs(off[ones] - middle) / within, 1.0)
        return _Fit(offset + middle, ones, nearest[ones], apart)

    from scipy.spatial import cKDTree

    fewer, same = min(len(one), len(other)), at(0.0)
    if same.told > fewer - _SAME:
        return same
    a, b = np.sort(one), np.sort(other)
    ends = [np.subtract.outer(x, y) for x, y in ((a[:_ENDS], b[:_ENDS]), (a[-_ENDS:], b[-_ENDS:]))]
    tried = {round(d / within): d for d in np.concatenate(ends, axis=None).tolist()}
    shifted = [fit for fit in map(at, tried.values()) if abs(fit.offset - same.offset) > within]
    best = max(shifted, key=lambda fit: fit.told, default=same)
    if 2 * same.told >= fewer:
        is_time = bool((np.mod(np.concatenate([one, other]), 1) > 0).any())
        same_clock = is_time and abs(same.offset) < _SAME_CLOCK * within
        if same_clock or best.told < max(min(fewer - _SAME, same.told + _CLEARLY), same.told + _SAME):
            return same
        is_rivalled = float(np.median(same.apart)) <= 2 * _SAME_CLOCK
    elif 2 * best.told < fewer:
        return None
    else:
        is_rivalled = any(
            fit.told > best.told - _SAME and abs(fit.offset - best.offset) > within for fit in shifted
        )
    if is_rivalled:
        raise _TwoWaysError(
            f"the numbers in their names pair in two ways, as they are and {abs(best.offset):g} apart. "
            "Give each pair the same name."
        )
    return best
