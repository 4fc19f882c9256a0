"""The fields of the page's messages: their types, with the limits of what a page may send."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from flatcloth.session.document import MAX_EXTENT_M

# Limits of what a page may send. Chosen: far above what the page's own controls send.
MAX_MESSAGE_CHARS = 100_000  # of a whole message
MAX_NAME_CHARS = 80  # of a pick
MAX_PAIRS = 50  # of points of cloth, of which two fix a place
MAX_ANGLE_DEG = 3600.0  # of any angle: ten turns
MAX_LEAN_DEG = 45.0  # of the turning axis
MAX_STROKE_POINTS = 1000  # of one stroke
MAX_BRUSH_M = 0.2  # radius

Metres = Annotated[float, Meta(ge=-MAX_EXTENT_M, le=MAX_EXTENT_M)]
"""A place on a garment's plane, or a shift there."""
Pointed = Annotated[float, Meta(ge=-1000.0, le=1000.0)]
"""Where the pointer is, in metres of the plane: also far off the garment, where the page is zoomed out."""
Radians = Annotated[float, Meta(ge=-100.0, le=100.0)]
Degrees = Annotated[float, Meta(ge=-MAX_ANGLE_DEG, le=MAX_ANGLE_DEG)]
Lean = Annotated[float, Meta(ge=-MAX_LEAN_DEG, le=MAX_LEAN_DEG)]
Count = Annotated[int, Meta(ge=-(2**53), le=2**53)]
"""A number of a view, a frame, a pick or a question: what JavaScript counts exactly."""
Points = Annotated[tuple[tuple[Metres, Metres], ...], Meta(max_length=MAX_PAIRS)]
StrokePixels = Annotated[
    tuple[tuple[Annotated[float, Meta(ge=-1.0, le=1e5)], Annotated[float, Meta(ge=-1.0, le=1e5)]], ...],
    Meta(min_length=1, max_length=MAX_STROKE_POINTS),
]
"""A line of pixels (row, col) of a recorded image."""
StrokePlaces = Annotated[tuple[tuple[Metres, Metres], ...], Meta(min_length=1, max_length=MAX_STROKE_POINTS)]
"""A line of places (u, v) of the flattened plane."""
BrushRadius = Annotated[float, Meta(gt=0.0, le=MAX_BRUSH_M)]
StrokeSide = Literal["this", "other"]


class Said(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="type"):
    """The common part of all messages: their ``type``."""
