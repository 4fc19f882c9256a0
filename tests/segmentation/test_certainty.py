"""How sure sides are: strokes tell of what lies together, and take no certainty away."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from flatcloth.segmentation.certainty import agreement

COUNT, SAMPLES = 60, 31
HALF = np.arange(COUNT) < COUNT // 2


@pytest.fixture
def observed() -> Any:
    """One sheet of two halves, which lie together in 24 of 31 samples."""
    samples = np.ones((SAMPLES, COUNT), dtype=np.int8)
    samples[24:, ~HALF] = -1
    side = np.ones(COUNT)
    return cast(
        "Any",
        SimpleNamespace(
            samples=samples, clusters=SimpleNamespace(count=COUNT), partition=SimpleNamespace(side=side)
        ),
    )


START, FAR = np.array([0, 1]), np.array([50, 51])
TOGETHER = np.zeros(COUNT, dtype=np.int64)


def test_the_share_of_the_samples_counts_those_that_agree(observed):
    agreed = agreement(observed, np.ones(COUNT), [START], TOGETHER)
    assert agreed[5] == pytest.approx(0.5 + 0.5 * 31 / 32)
    assert agreed[40] == pytest.approx(0.5 + 0.5 * (24 - 7) / 32)


def test_a_stroke_that_agrees_takes_no_certainty_away(observed):
    random = np.random.default_rng(0)
    observed.samples[:] = np.where(random.random((SAMPLES, COUNT)) < 0.3, -1, 1)
    before = agreement(observed, np.ones(COUNT), [START], TOGETHER)
    after = agreement(observed, np.ones(COUNT), [FAR, START], TOGETHER)
    assert (after >= before).all()
    assert (after > before).any()


def test_what_a_stroke_turned_over_is_as_sure_as_it_lies_to_the_stroke_and_the_rest_as_before(observed):
    turned = np.where(HALF, 1.0, -1.0)
    before = agreement(observed, np.ones(COUNT), [START], TOGETHER)
    after = agreement(observed, turned, [FAR, START], (~HALF).astype(np.int64))
    np.testing.assert_array_equal(after[HALF], before[HALF])
    # 24 of the samples say that both halves lie together: they count a tenth.
    size = (7 + 2.4) ** 2 / (7 + 0.24)
    assert after[40] == pytest.approx(0.5 + 0.5 * size / (size + 1))


def test_what_was_turned_over_must_lie_to_the_stroke_where_that_contradicts_nothing_else(observed):
    """A band lies to the stroke in the very samples that contradict the start, and only there."""
    band = np.arange(COUNT) < 40
    band &= ~HALF
    observed.samples[24:, band] = 1
    turned = np.where(HALF, 1.0, -1.0)
    after = agreement(observed, turned, [FAR, START], (~HALF).astype(np.int64))
    size = (7 + 2.4) ** 2 / (7 + 0.24)
    mean = (2.4 - 7) / (7 + 2.4)
    assert after[35] == pytest.approx(max(0.5, 0.5 + 0.5 * mean * size / (size + 1)))
    assert after[45] > 0.9
    without = agreement(observed, turned, [FAR, START], (~HALF).astype(np.int64), guess=False)
    assert without[35] == pytest.approx(
        0.5 + 0.5 * (24 - 7) / 32
    )  # a start that was a guess contradicts nothing


def test_a_start_that_is_turned_over_still_tells_of_what_is_not(observed):
    turned = np.where(HALF, -1.0, 1.0)  # the stroke said that the start, and its half, is the other side
    before = agreement(observed, np.ones(COUNT), [START], TOGETHER)
    after = agreement(observed, turned, [np.array([3, 4]), START], HALF.astype(np.int64))
    np.testing.assert_array_equal(after[~HALF], before[~HALF])
