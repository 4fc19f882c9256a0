"""What is sent to the page: the base of all structs, and the small ones that several messages contain.

Numbers that may be unknown are ``float | None``; NaN is sent as ``null``, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal, TypeVar

import msgspec
import numpy as np

from flatcloth.core.decoding import converted
from flatcloth.core.parcel import Parcel
from flatcloth.rendering import layers

UV = tuple[float, float]
"""A place (u, v) on the flattened plane, in metres."""
XYZ = tuple[float, float, float]
"""A point in the object frame, or in the camera's, in metres."""
Direction = tuple[float | None, float | None, float | None]
"""A unit vector; None where it is unknown."""
RC = tuple[int, int]
"""A pixel (row, col) of the shape."""

NoteLevel = Literal["info", "warning", "error"]

T = TypeVar("T")


class Sent(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The base of everything that is sent to the page."""


class Note(Sent, tag_field="type", tag="note", frozen=True):
    """A notification for the operator; ``time_s`` counts from the epoch."""

    id: int
    level: NoteLevel
    text: str
    time_s: float


class Progress(Sent, tag_field="type", tag="progress", frozen=True):
    """How much of a computation is done, of 1, and what it does."""

    share: float
    text: str


class Grid(Sent, frozen=True):
    """The size of a raster of the flattened plane, and where its first pixel lies."""

    rows: int
    cols: int
    pixel_size_m: float
    origin_uv_m: UV


class ColorClass(Sent, frozen=True):
    """A color of a legend, and what it stands for."""

    label: str
    color: str


class Legend(Sent, frozen=True):
    """The legend of a layer; ``map``, ``low``, ``high`` and ``colors`` belong to a ramp."""

    kind: Literal["none", "classes", "ramp"]
    title: str
    classes: tuple[ColorClass, ...] = ()
    map: str = ""
    low: float = 0.0
    high: float = 1.0
    colors: tuple[str, ...] = ()


class Motion(Sent, frozen=True):
    """A rigid motion of the plane for reading."""

    theta_deg: float
    u_mm: float
    v_mm: float


def table(text: str) -> Iterator[list[str]]:
    """Yield the cells of a table whose columns are separated by " | "; an indented line goes on."""
    for row in text.replace("\n    ", " ").strip().splitlines():
        yield row.split(" | ")


def typed(values: Any, kind: type[T]) -> T:
    """Return JSON values, which may contain numpy's, as a struct."""
    return converted(msgspec.to_builtins(values, enc_hook=_builtin), kind)


def encoded(message: Any) -> bytes:
    """Return a message, or other values, as JSON."""
    return _ENCODER.encode(message)


def parcel_of(values: Any, arrays: Mapping[str, Any]) -> Parcel:
    """Return values, which may be a struct, with arrays; NaN among the values is sent as ``null``.

    Numbers of 64 bits are sent as 32 bits; an array (H, W, 4) of bytes is a picture.
    """
    parcel = Parcel(msgspec.json.decode(encoded(values)))
    for name, array in arrays.items():
        if array.dtype == np.uint8 and array.shape[2:] == (4,):
            parcel.picture(name, layers.png(array), array.shape[:2])
        else:
            parcel.array(name, array, _SHORTER.get(array.dtype.name))
    return parcel


_SHORTER = {"float64": "float32", "int64": "int32"}


def _builtin(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"A message has a value that JSON does not know: {value!r:.80}.")


_ENCODER = msgspec.json.Encoder(enc_hook=_builtin)


class ActiveStep(Sent, frozen=True):
    """A view that an active loop took: what was expected of it, and what it brought."""

    number: int
    angle_deg: float
    expected: str
    got: str


class ActiveStatus(Sent, frozen=True):
    """The state of an active loop; ``angle_deg`` is the next one, None at the ``end`` or while it waits."""

    source: str
    goal: str
    budget: str
    folder: str
    views: int
    knows: str
    angle_deg: float | None
    turn_deg: float | None
    why: str
    new_cm2: float | None
    end: str | None
    waiting: str
    turning: bool
    turns_itself: bool
    is_simulated: bool
    steps: tuple[ActiveStep, ...]
