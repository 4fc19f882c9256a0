"""Decoding and validation of external data by msgspec, with errors in plain words.

The types define what is valid: dataclasses and ``msgspec.Struct``, bounds as ``Annotated[float, Meta(...)]``.
"""

from __future__ import annotations

import json
import math
import re
import threading
from collections.abc import Iterator
from typing import Annotated, Any, TypeVar, get_args, get_type_hints

import msgspec

T = TypeVar("T")

Finite = Annotated[float, msgspec.Meta(ge=-1e300, le=1e300)]
"""A number that is neither infinite nor NaN."""
Vector3 = tuple[Finite, Finite, Finite]
"""Three numbers x, y, z."""

_WORDS = {
    "float": "a number", "int": "a whole number", "str": "text", "bool": "true or false", "null": "null",
    "object": "an object", "array": "a list",
}  # fmt: skip
_STEPS = re.compile(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]")


class MisfitError(ValueError):
    """A value does not have its type: ``where`` it is, what was ``found`` there and what was ``expected``."""

    def __init__(self, where: str, found: str, expected: str) -> None:
        super().__init__(f"{where or 'it'} is {found}" + (f"; expected {expected}" if expected else ""))
        self.where, self.found, self.expected = where, found, expected


def parse_json(data: bytes | str) -> Any:
    """Parse a JSON text to plain dictionaries and lists.

    NaN and Infinity, which Python and others write, are accepted here, so that the error can name
    their place later.

    Raises
    ------
    ValueError
        If it is not JSON, or nested too deeply; the text is one line.
    """
    try:
        return json.loads(data)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


_PREPARED: set[Any] = set()
"""Types whose converters msgspec has built."""
_PREPARING = threading.Lock()


def converted(raw: Any, kind: type[T], *, strict: bool = True) -> T:
    """Convert as ``msgspec.convert`` does, also on several threads at once.

    msgspec builds the description of a struct when it is first used. If two threads do that at the same
    time, the process dies with a segmentation fault (msgspec 0.22); here one thread does it first.

    Raises
    ------
    msgspec.ValidationError
        If anything is missing or of another type or range.
    """
    if kind not in _PREPARED:
        with _PREPARING:
            msgspec.json.Decoder(kind)
            _PREPARED.add(kind)
    return msgspec.convert(raw, kind, strict=strict, dec_hook=lambda other, value: other(value))  # paths


def fitted(raw: Any, kind: type[T], *, strict: bool = True) -> T:
    """Convert plain dictionaries and lists to a value of a type; if not ``strict``, also numbers from text.

    Raises
    ------
    MisfitError
        If anything is missing or of another type or range.
    """
    try:
        return converted(raw, kind, strict=strict)
    except msgspec.ValidationError as error:
        raise _misfit(str(error), raw) from error
    except OverflowError as error:
        raise MisfitError("", "a number of too many digits", "a number") from error
    except UnicodeEncodeError as error:
        place = _place_of(str(error.object), raw) or ""
        raise MisfitError(place, "text with half a character", "text") from error


def unread(raw: Any, kind: Any, where: str = "") -> Iterator[str]:
    """Yield the places of what plain objects say beyond the fields of a type, also of types in it."""
    if isinstance(raw, dict) and isinstance(kind, type) and (known := get_type_hints(kind)):
        for name, value in raw.items():
            place = f"{where}.{name}".removeprefix(".")
            yield from unread(value, known[name], place) if name in known else [place]
        return
    for inner in get_args(kind):
        for n, value in enumerate(raw) if isinstance(raw, list) else [(-1, raw)]:
            yield from unread(value, inner, where if n < 0 else f"{where}[{n}]")


def decoded(data: bytes | str, kind: type[T]) -> T:
    """Parse a JSON text to a value of a type.

    Raises
    ------
    ValueError
        If it is not JSON; as :class:`MisfitError`, if anything is missing or of another type or range.
    """
    return fitted(parse_json(data), kind)


def described(value: Any) -> str:
    """Describe a value from a file in a word or two."""
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, int | float) and not abs(value) < (
        math.inf if isinstance(value, float) else 10**300
    ):
        return "not a finite number"
    return next((words for kind, words in _DESCRIBED.items() if isinstance(value, kind)), "of another type")


_DESCRIBED: dict[Any, str] = {
    type(None): "missing", bool: "true or false", int | float: "a number", str: "text", dict: "an object",
}  # fmt: skip


def _misfit(text: str, raw: Any) -> MisfitError:
    """Translate a message of msgspec, which ends with `` - at `$.path` `` unless it concerns the whole."""
    problem, _, path = text.partition(" - at `$")
    where = path.removesuffix("`").removeprefix(".")
    value = found_at(raw, where)
    if field := re.match(r"Object missing required field `(.+)`", problem):
        return MisfitError(f"{where}.{field[1]}".removeprefix("."), "missing", "")
    if field := re.match(r"Object contains unknown field `(.+)`", problem):
        return MisfitError(f"{where}.{field[1]}".removeprefix("."), "no field that is known", "")
    if expected := re.match(r"Expected (.*?)(?:, got .*)?$", problem):
        wanted = re.sub(r"`([^`]+)`", lambda found: _plain(found[1]), expected[1])
        found = described(value)
        bounded = found in ("a number", "text") and ("<" in wanted or ">" in wanted)
        bounded &= not isinstance(value, int) or abs(value) < 10**60
        return MisfitError(where, f"{value!r:.60}" if bounded else found, wanted)
    if problem == "Number out of range":
        return MisfitError(where, "not a finite number", "a number")
    return MisfitError(where, f"{value!r:.60}", "one of")


def found_at(raw: Any, where: str) -> Any:
    """Return the value at a place as named by :class:`MisfitError`; None if there is none."""
    for name, index in _STEPS.findall("." + where if where else ""):
        in_list = isinstance(raw, list) and index.isdecimal()
        raw = raw[int(index)] if in_list else raw.get(name) if isinstance(raw, dict) else None
    return raw


def _plain(kinds: str) -> str:
    return " or ".join(_WORDS.get(kind, kind) for kind in kinds.split(" | ") if kind != "null")


def _place_of(text: str, raw: Any) -> str | None:
    """Return where a text stands in plain dictionaries and lists, as key or value; None if nowhere."""
    waiting: list[tuple[str, Any]] = [("", raw)]
    while waiting:
        place, value = waiting.pop()
        if value == text or (isinstance(value, dict) and text in value):
            return place
        if isinstance(value, dict):
            waiting += [(f"{place}.{key}".removeprefix("."), one) for key, one in value.items()]
        elif isinstance(value, list):
            waiting += [(f"{place}[{n}]", one) for n, one in enumerate(value)]
    return None
