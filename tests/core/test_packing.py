"""Values taken apart to text and arrays come back as they were, and nothing else is taken apart."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from flatcloth.core.processes.packing import packed, unpacked

PLAIN = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text()
KINDS = arrays.boolean_dtypes() | arrays.integer_dtypes() | arrays.floating_dtypes(sizes=(32, 64))
VALUES = st.recursive(
    PLAIN | arrays.arrays(KINDS, arrays.array_shapes(min_dims=0, min_side=0)),
    lambda inner: st.lists(inner) | st.tuples(inner, inner) | st.dictionaries(PLAIN, inner),
    max_leaves=12,
)


class Pair(NamedTuple):
    """Two values."""

    first: Any
    second: Any


@dataclass(frozen=True)
class Sheet:
    """An object whose ``__init__`` must not be called again."""

    points: Any
    size: Any = None

    def __post_init__(self) -> None:
        if not isinstance(self.points, np.ndarray):
            raise TypeError("made from an array only")

    @cached_property
    def mean(self) -> float:
        return float(self.points.mean())


def again(value: object) -> Any:
    text, found = packed(value)
    assert all(array.flags.c_contiguous for array in found)
    return unpacked(text, [memoryview(bytearray(array.tobytes())) for array in found])


def is_same(one: Any, other: Any) -> bool:
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    if isinstance(one, dict):
        return list(one) == list(other) and all(is_same(one[k], other[k]) for k in one)
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(is_same, one, other))
    return bool(one == other)


@given(VALUES)
def test_what_is_packed_comes_back(value: object) -> None:
    assert is_same(again(value), value)


def test_objects_come_back_with_all_they_keep_and_once() -> None:
    points = np.arange(6.0).reshape(2, 3)
    sheet = Sheet(points, np.float32(0.1))
    assert sheet.mean == 2.5
    one, other, pair = again((sheet, sheet, Pair(points, math.nan)))
    assert isinstance(one, Sheet)
    assert one is other
    assert vars(one)["mean"] == 2.5
    assert isinstance(one.size, np.float32)
    assert one.size == np.float32(0.1)
    assert isinstance(pair, Pair)
    assert pair.first is one.points
    assert math.isnan(pair.second)
    one.points[0] = 7.0
    assert points[0, 0] == 0.0


def test_the_order_of_an_array_in_memory_stays_for_what_sums_over_it() -> None:
    turned = again(np.arange(12.0).reshape(3, 4).T)
    assert turned.flags.f_contiguous
    np.testing.assert_array_equal(turned, np.arange(12.0).reshape(3, 4).T)
    np.testing.assert_array_equal(again(np.arange(12)[::3]), [0, 3, 6, 9])


@pytest.mark.parametrize("value", [{1, 2}, print, int, threading.Lock(), np.array([None]), b"x"])
def test_what_cannot_be_packed_is_named(value: object) -> None:
    with pytest.raises(TypeError, match="cannot be packed"):
        packed([value])


def test_nothing_but_classes_that_are_there_is_looked_up() -> None:
    text, _ = packed(Sheet(np.zeros(1)))
    assert Sheet.__module__.encode() in text
    function = text.replace(b'"Sheet"', b'"again"')
    with pytest.raises(TypeError, match="no class"):
        unpacked(function, [memoryview(bytearray(8))])
    absent = text.replace(b'"' + Sheet.__module__.encode() + b'"', b'"no_such_module"')
    with pytest.raises(KeyError):
        unpacked(absent, [memoryview(bytearray(8))])
