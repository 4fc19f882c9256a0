from __future__ import annotations

import threading
from dataclasses import fields, replace

import numpy as np
import pytest
from scenes import AXIS, box, frame, plane

from flatcloth.core.cache import size_in_bytes
from flatcloth.core.config import FlatteningConfig, SurfaceConfig
from flatcloth.core.types import FlattenedView
from flatcloth.flattening.flatten import flatten
from flatcloth.flattening.surface import observe_item

ATTRIBUTES = [field.name for field in fields(FlattenedView)]


def flattened() -> FlattenedView:
    depth = plane()
    surface = observe_item(frame(depth, box(0.05, depth)), AXIS, SurfaceConfig())
    return flatten(surface, AXIS, FlatteningConfig()).view


def assert_same(view: FlattenedView, other: FlattenedView) -> None:
    for name in ATTRIBUTES:
        np.testing.assert_array_equal(getattr(view, name), getattr(other, name))


def test_attributes_do_not_depend_on_which_is_asked_for_first() -> None:
    view, other = flattened(), flattened()
    for name in ATTRIBUTES:
        getattr(view, name)
    for name in reversed(ATTRIBUTES):
        getattr(other, name)
    assert_same(view, other)


def test_an_attribute_is_read_once() -> None:
    view = flattened()
    for name in ATTRIBUTES:
        assert getattr(view, name) is getattr(view, name)


def test_a_copy_with_another_attribute_has_all_others() -> None:
    view = flattened()
    half = view.valid & (np.arange(view.shape[1]) % 2 == 0)
    copy = replace(view, valid=half)
    assert copy.valid is half
    assert_same(replace(copy, valid=view.valid), view)


def test_memory_counts_attributes_before_they_are_read() -> None:
    view = flattened()
    before = size_in_bytes(view)
    for name in ATTRIBUTES:
        getattr(view, name)
    assert size_in_bytes(view) == pytest.approx(before, rel=0.01)
    assert size_in_bytes(replace(view)) < before  # it keeps no surface


def test_threads_that_ask_at_once_get_the_same() -> None:
    view, known = flattened(), flattened()
    got: list[np.ndarray] = []
    barrier = threading.Barrier(4)

    def ask() -> None:
        barrier.wait()
        got.append(view.quality)

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(got) == 4
    for quality in got:
        np.testing.assert_array_equal(quality, known.quality)
