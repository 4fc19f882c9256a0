"""One container of JSON and arrays, for processes, pages and memory alike.

Eight bytes hold the lengths (little-endian) of the JSON and of the body that follows it. The JSON has under
``parts`` for each array its ``kind``, its ``shape``, and its bytes in the body: ``at``, and how many.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = Mapping[str, NDArray[Any]]

LENGTHS = struct.Struct("<II")
"""Lengths of JSON and body."""
PICTURES = ("png", "webp")
"""Kinds of pictures."""
_ALIGNED = 8
"""Arrays begin at multiples of their elements' size, which is at most this, so readers need not copy."""


class Parcel:
    """A JSON object, and the arrays and pictures that belong to it."""

    def __init__(self, values: Mapping[str, Any] | None = None, arrays: Arrays | None = None) -> None:
        self.values: dict[str, Any] = dict(values or {})
        self._body = bytearray()
        self._parts: dict[str, dict[str, Any]] = {}
        for name, array in (arrays or {}).items():
            self.array(name, array)

    def array(self, name: str, values: NDArray[Any], kind: str | None = None) -> None:
        """Add an array, converted to a type such as ``int16`` if ``kind`` names one."""
        data = np.asarray(values, dtype=kind)
        self._add(name, data.astype(data.dtype.newbyteorder("<")).tobytes(), data.dtype.name, data.shape)

    def picture(self, name: str, data: bytes, shape: tuple[int, ...], kind: str = "png") -> None:
        """Add a picture of this many rows and columns; its kind is one of ``PICTURES``."""
        self._add(name, data, kind, shape)

    def pack(self, more: Mapping[str, Any] | None = None, *, allow_nan: bool = False) -> bytes:
        """Return everything as bytes, with ``more`` values; see :func:`record`."""
        values = {**(more or {}), **self.values, "parts": self._parts}
        return record(values, bytes(self._body), allow_nan=allow_nan)

    def _add(self, name: str, data: bytes, kind: str, shape: tuple[int, ...]) -> None:
        self._body += bytes(-len(self._body) % _ALIGNED)
        place = {"at": len(self._body), "bytes": len(data)}
        self._parts[name] = {"kind": kind, "shape": list(shape), **place}
        self._body += data


def record(values: Mapping[str, Any], body: bytes = b"", *, allow_nan: bool = False) -> bytes:
    """Return values and a body as bytes; ``allow_nan`` also NaN and Infinity, which pages cannot read."""
    text = json.dumps(values, allow_nan=allow_nan).encode()
    return LENGTHS.pack(len(text), len(body)) + text + body


def unpack(read: Callable[[int], bytes]) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the values and the arrays of a parcel; ``read(n)`` returns its next n bytes."""
    text, body = LENGTHS.unpack(read(LENGTHS.size))
    values, data = json.loads(read(text)), read(body)
    arrays = {}
    for name, part in values.pop("parts").items():
        is_picture = part["kind"] in PICTURES
        dtype = np.dtype("uint8" if is_picture else part["kind"])
        array = np.frombuffer(data, dtype, part["bytes"] // dtype.itemsize, part["at"])
        arrays[name] = array if is_picture else array.reshape(part["shape"])
    return values, arrays
