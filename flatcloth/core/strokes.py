"""What an operator says about sides: strokes and cuts, as plain values that can be journaled and replayed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast

from flatcloth.core.errors import SegmentationError

Side = Literal["this", "other"]
Point3 = tuple[float, float, float]

FORMAT = "flatcloth-strokes/1"
MOST_DECISIONS = 10_000
"""Limits of what a file may contain. Chosen: far above what an operator draws."""
_MOST_POINTS = 10_000
"""See ``MOST_DECISIONS``."""
_MOST_RADIUS_M = 0.5
"""See ``MOST_DECISIONS``."""


@dataclass(frozen=True, kw_only=True)
class ImageStroke:
    """A brush stroke on the image of a view.

    ``side`` says of which side the cloth under it is; ``points_rc`` (row, col) in pixels of the
    recorded image, joined by straight lines; ``radius_m`` half the width of the brush, on the cloth.
    """

    side: Side
    view_index: int
    points_rc: tuple[tuple[float, float], ...]
    radius_m: float = 0.010


@dataclass(frozen=True, kw_only=True)
class SpaceStroke:
    """A brush stroke on the cloud, or on the canvas, whose pixels are linked to places in space.

    ``points_m`` in the object frame, joined by straight lines; ``normals``, as many, tell which of
    the layers that lie there is meant; ``radius_m`` half the width of the brush.
    """

    side: Side
    points_m: tuple[Point3, ...]
    normals: tuple[Point3, ...]
    radius_m: float = 0.010


@dataclass(frozen=True, kw_only=True)
class Cut:
    """A line across the cloth: what lies beyond it is not of interest.

    ``points_m`` and ``normals`` in the object frame, as in :class:`SpaceStroke`; ``beyond_m`` a place
    on the cloth beyond the line, ``beyond_normal`` its normal.
    """

    points_m: tuple[Point3, ...]
    normals: tuple[Point3, ...]
    beyond_m: Point3
    beyond_normal: Point3


Decision = ImageStroke | SpaceStroke | Cut

_KINDS: dict[str, type[Decision]] = {"image": ImageStroke, "space": SpaceStroke, "cut": Cut}


def as_plain(decision: Decision) -> dict[str, Any]:
    """Return a decision as a table of plain values, ready for JSON."""
    kind = next(name for name, known in _KINDS.items() if isinstance(decision, known))
    table: dict[str, Any] = {"kind": kind}
    for name in decision.__dataclass_fields__:
        value = getattr(decision, name)
        if isinstance(value, tuple):
            value = [list(v) if isinstance(v, tuple) else v for v in value]
        table[name] = value
    return table


def from_plain(table: Any, where: str) -> Decision:
    """Return the decision that :func:`as_plain` made a table of.

    Raises
    ------
    SegmentationError
        If it is none; the message begins with ``where`` and names the value.
    """
    if not isinstance(table, Mapping) or table.get("kind") not in _KINDS:
        raise SegmentationError(f"{where}: no stroke or cut; its kind is one of {', '.join(_KINDS)}.")
    kind = _KINDS[cast("str", table["kind"])]
    known = set(kind.__dataclass_fields__)
    unknown = sorted(set(table) - known - {"kind"})
    missing = sorted(known - set(table) - {"radius_m"})
    if unknown or missing:
        wrong = f"has no {missing[0]}" if missing else f"has an unknown {unknown[0]}"
        raise SegmentationError(f"{where}: {wrong}.")
    values: dict[str, Any] = {}
    for name in known & set(table):
        values[name] = _value(name, table[name], f"{where}.{name}")
    if "normals" in values and len(values["normals"]) != len(values["points_m"]):
        raise SegmentationError(f"{where}: {len(values['points_m'])} points need as many normals.")
    return kind(**values)


def decisions_from_plain(content: Any, where: str) -> tuple[Decision, ...]:
    """Return the decisions of a strokes file's content.

    Raises
    ------
    SegmentationError
        If the content is of another format, or a decision in it is not valid.
    """
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise SegmentationError(f'{where}: is no strokes file; its "format" must be "{FORMAT}".')
    listed = content.get("decisions")
    if not isinstance(listed, list) or len(listed) > MOST_DECISIONS:
        raise SegmentationError(f'{where}: "decisions" must be a list of at most {MOST_DECISIONS}.')
    return tuple(from_plain(table, f"{where}: decisions[{n}]") for n, table in enumerate(listed))


def plain_of_decisions(decisions: Sequence[Decision]) -> dict[str, Any]:
    """Return the content of a strokes file."""
    return {"format": FORMAT, "decisions": [as_plain(decision) for decision in decisions]}


def _value(name: str, value: Any, where: str) -> Any:
    if name == "side":
        if value not in ("this", "other"):
            raise SegmentationError(f'{where}: {value!r} is no side; say "this" or "other".')
        return value
    if name == "view_index":
        if isinstance(value, bool) or not isinstance(value, int) or value < 0:
            raise SegmentationError(f"{where}: {value!r} is no number of a view.")
        return value
    if name == "radius_m":
        radius = _number(value, where)
        if not 0 < radius <= _MOST_RADIUS_M:
            raise SegmentationError(f"{where}: {radius:g} m is no width of a brush.")
        return radius
    if name in ("beyond_m", "beyond_normal"):
        return _point(value, 3, where)
    if not isinstance(value, list) or not 1 <= len(value) <= _MOST_POINTS:
        raise SegmentationError(f"{where}: must be a list of 1 to {_MOST_POINTS} points.")
    return tuple(_point(v, 2 if name == "points_rc" else 3, f"{where}[{n}]") for n, v in enumerate(value))


def _point(value: Any, size: int, where: str) -> tuple[float, ...]:
    if not isinstance(value, list | tuple) or len(value) != size:
        raise SegmentationError(f"{where}: must be {size} numbers.")
    return tuple(_number(v, where) for v in value)


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise SegmentationError(f"{where}: {value!r} is no finite number.")
    return float(value)
