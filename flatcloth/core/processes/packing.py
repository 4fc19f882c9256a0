"""Values as text and arrays, for a copy of this process: what they are made of, without pickles.

A value is made of arrays, numbers, texts, tuples, named tuples, lists, dicts, and objects of this program
that keep their attributes in a dict. Each object and array is packed once, however often it occurs. Reading
calls no code of the objects: they are made without their ``__init__``.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def packed(value: object) -> tuple[bytes, list[Array]]:
    """Return a value as text, and its arrays, each contiguous in C order.

    Raises
    ------
    TypeError
        If it is made of something else than named above.
    """
    packer = _Packer()
    top = packer.reference(value)
    return json.dumps({"top": top, "objects": packer.objects}).encode(), packer.arrays


def unpacked(text: bytes, buffers: list[memoryview]) -> Any:
    """Return the value of which :func:`packed` made this text; its arrays use the buffers where they lie."""
    told = json.loads(text)
    return _Unpacker(told["objects"], buffers).value(told["top"])


class _Packer:
    """A reference is ``[kind, number]`` for what may occur again, and ``["is", it]`` for the rest."""

    def __init__(self) -> None:
        self.objects: list[Any] = []
        self.arrays: list[Array] = []
        self._known: dict[int, tuple[list[Any], object]] = {}  # with the object: its id stays its own

    def reference(self, value: object) -> list[Any]:
        if value is None or type(value) in (bool, int, float, str):
            return ["is", value]
        if id(value) not in self._known:
            self._known[id(value)] = self._packed(value), value
        return self._known[id(value)][0]

    def _packed(self, value: object) -> list[Any]:
        if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biufc":
            array = np.asarray(value)
            is_turned = array.flags.f_contiguous and not array.flags.c_contiguous
            self.arrays.append(np.ascontiguousarray(array.T if is_turned else array))
            note = [len(self.arrays) - 1, array.dtype.str, array.shape, is_turned]
            return self._noted("number" if isinstance(value, np.generic) else "array", note)
        if type(value) in (tuple, list):
            items = [self.reference(item) for item in value]  # type: ignore[attr-defined]
            return self._noted(type(value).__name__, items)
        if type(value) is dict:
            return self._noted("dict", [[self.reference(k), self.reference(v)] for k, v in value.items()])
        name = [type(value).__module__, type(value).__qualname__]
        if isinstance(value, tuple) and hasattr(value, "_fields"):
            return self._noted("named", [*name, [self.reference(item) for item in value]])
        if hasattr(value, "__dict__") and not hasattr(type(value), "__slots__") and not callable(value):
            return self._noted("object", [*name, {k: self.reference(v) for k, v in vars(value).items()}])
        raise TypeError(f"a value of {name[0]}.{name[1]} cannot be packed")

    def _noted(self, kind: str, note: list[Any]) -> list[Any]:
        self.objects.append(note)
        return [kind, len(self.objects) - 1]


class _Unpacker:
    def __init__(self, objects: list[Any], buffers: list[memoryview]) -> None:
        self._objects, self._buffers = objects, buffers
        self._known: dict[int, Any] = {}

    def value(self, reference: list[Any]) -> Any:
        kind, what = reference
        if kind == "is":
            return what
        if what not in self._known:
            self._known[what] = self._made(kind, self._objects[what])
        return self._known[what]

    def _made(self, kind: str, note: list[Any]) -> Any:
        match kind:
            case "array" | "number":
                number, dtype, shape, is_turned = note
                array = np.frombuffer(self._buffers[number], dtype=np.dtype(dtype))
                array = array.reshape(shape[::-1]).T if is_turned else array.reshape(shape)
                return array if kind == "array" else array[()]
            case "dict":
                return {self.value(k): self.value(v) for k, v in note}
            case "tuple" | "list":
                items = [self.value(item) for item in note]
                return tuple(items) if kind == "tuple" else items
            case "named":
                return _class_of(note)(*[self.value(item) for item in note[2]])
        kept = _class_of(note)
        made = object.__new__(kept)
        vars(made).update({name: self.value(item) for name, item in note[2].items()})
        return made


def _class_of(note: list[Any]) -> type[Any]:
    """Return a class of a module that is there already: nothing is imported."""
    found: Any = sys.modules[note[0]]
    for name in note[1].split("."):
        found = getattr(found, name)
    if not isinstance(found, type):
        raise TypeError(f"{note[0]}.{note[1]} is no class")
    return found
