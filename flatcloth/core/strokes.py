"""An operator's evidence of sides: strokes, as plain values that can be journaled and replayed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from msgspec import Meta

from flatcloth.core.decoding import MisfitError, fitted
from flatcloth.core.errors import SegmentationError

Side = Literal["this", "other"]

FORMAT = "flatcloth-strokes/1"
MOST_DECISIONS = 10_000
"""Limit of a file, and of the points of a decision. Chosen: far above what is drawn by hand."""
_Line = Meta(min_length=1, max_length=MOST_DECISIONS)
_Pixel = Annotated[float, Meta(ge=-1e5, le=1e5)]
"""A row or column. The limit is chosen: far above any image; the squares of larger numbers are infinite."""
_Metres = Annotated[float, Meta(ge=-1e3, le=1e3)]
"""A coordinate of a place. The limit is chosen: ten times what a depth image may measure."""
_Direction = Annotated[float, Meta(ge=-1.001, le=1.001)]
"""A component of a unit vector, rounded to three digits."""
Place = tuple[_Metres, _Metres, _Metres]
"""A place in space."""
Normal = tuple[_Direction, _Direction, _Direction]
"""A unit vector."""
Pixels = Annotated[tuple[tuple[_Pixel, _Pixel], ...], _Line]
"""Places (row, col) in an image."""
Places = Annotated[tuple[Place, ...], _Line]
"""Places in space."""
Normals = Annotated[tuple[Normal, ...], _Line]
"""A normal for each place."""
Radius = Annotated[float, Meta(gt=0.0, le=0.5)]
"""Half the width of a brush in metres. The limit is chosen: half of a garment."""


@dataclass(frozen=True, kw_only=True)
class ImageStroke:
    """A brush stroke on the image of a view.

    ``side`` says of which side the cloth under it is; ``points_rc`` (row, col) in pixels of the
    recorded image, joined by straight lines; ``radius_m`` half the width of the brush, on the cloth.
    """

    side: Side
    view_index: Annotated[int, Meta(ge=0)]
    points_rc: Pixels
    radius_m: Radius = 0.010


@dataclass(frozen=True, kw_only=True)
class SpaceStroke:
    """A brush stroke on the cloud, or on the canvas, whose pixels are linked to places in space.

    ``points_m`` in the object frame, joined by straight lines; ``normals``, one for each point, select
    the layer of cloth there; ``radius_m`` half the width of the brush.
    """

    side: Side
    points_m: Places
    normals: Normals
    radius_m: Radius = 0.010


Decision = ImageStroke | SpaceStroke

_KINDS: dict[str, type[Decision]] = {"image": ImageStroke, "space": SpaceStroke}


def why_off_image(decision: Decision, n_views: int, height: int, width: int) -> str | None:
    """Return why a stroke touches none of a recording's images (``height``, ``width``), None if it does."""
    if not isinstance(decision, ImageStroke):
        return None
    if decision.view_index >= n_views:
        return f"view {decision.view_index} does not exist; the recording has {n_views}."
    rows, cols = zip(*decision.points_rc, strict=True)
    if max(rows) < 0 or min(rows) > height or max(cols) < 0 or min(cols) > width:
        return f"the stroke lies outside the image of view {decision.view_index} ({width} x {height} pixels)."
    return None


def _from_plain(table: Any, where: str) -> Decision:
    name = table.get("kind") if isinstance(table, Mapping) else None
    if not isinstance(name, str) or name not in _KINDS:
        raise SegmentationError(f"{where}: no stroke; its kind is one of {', '.join(_KINDS)}.")
    kind = _KINDS[name]
    unknown = sorted(set(table) - set(kind.__dataclass_fields__) - {"kind"})
    if unknown:
        raise SegmentationError(f"{where}: has an unknown {unknown[0]}.")
    try:
        decision = fitted(table, kind)
    except MisfitError as error:
        sides = " and ".join(f'"{side}"' for side in get_args(Side))
        choices = f" {sides}" if error.expected == "one of" else ""
        raise SegmentationError(f"{where}.{error}{choices}.") from error
    if not isinstance(decision, ImageStroke) and len(decision.normals) != len(decision.points_m):
        raise SegmentationError(f"{where}: {len(decision.points_m)} points need the same number of normals.")
    return decision


def decisions_from_plain(content: Any, where: str) -> tuple[Decision, ...]:
    """Return the decisions of a strokes file's content.

    Raises
    ------
    SegmentationError
        If the content is of another format, or a decision in it is not valid; the message begins with
        ``where`` and names the value.
    """
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise SegmentationError(f'{where}: is no strokes file; its "format" must be "{FORMAT}".')
    listed = content.get("decisions")
    if not isinstance(listed, list) or len(listed) > MOST_DECISIONS:
        raise SegmentationError(f'{where}: "decisions" must be a list of at most {MOST_DECISIONS}.')
    return tuple(_from_plain(table, f"{where}: decisions[{n}]") for n, table in enumerate(listed))
