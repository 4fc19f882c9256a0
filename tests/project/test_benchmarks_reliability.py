"""The reliability curve and the ROC say what they are said to say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.confidence import Laid, figures_of
from benchmarks.reliability import PixelErrors, curve, keep, kept, least_factor, roc, rows_of
from benchmarks.speed import best_s, unit_s

RANDOM = np.random.default_rng(0)


def sure(garment: str, claimed_too_small_by: float = 1.0) -> PixelErrors:
    std = RANDOM.uniform(2.0, 14.0, 20000)
    error = np.abs(RANDOM.standard_normal(std.size)) * std * claimed_too_small_by
    return PixelErrors(f"{garment}-clean", garment, error, std)


def laid(error_m: float, *, moved: bool = False) -> Laid:
    return Laid("towel-clean", "towel", {}, error_m, moved)


def test_true_standard_deviations_lie_on_the_diagonal() -> None:
    for row in curve([sure("towel")]):
        assert row["error_rms_mm"] == pytest.approx(row["claimed_mm"], rel=0.15)


def test_the_factor_undoes_what_was_claimed_too_small_and_comes_from_other_garments() -> None:
    honest, bold = sure("towel"), sure("shirt", claimed_too_small_by=4.0)
    assert least_factor([bold]) == pytest.approx(4.0 * least_factor([honest]), rel=0.1)
    assert bold.within(least_factor([bold])) == pytest.approx(0.98, abs=1e-3)
    rows = rows_of([honest, bold])
    assert [row["recording"] for row in rows] == ["shirt-clean", "towel-clean"]
    assert rows[0]["factor_of_other_garments"] == pytest.approx(least_factor([honest]), abs=0.01)


def test_natural_and_moved_wrong_placements_are_told_apart() -> None:
    placements = [laid(0.001), laid(0.002), laid(0.1), laid(0.2, moved=True), laid(0.015)]
    scores = np.array([0.9, 0.8, 0.85, 0.1, 0.5])
    natural = figures_of(placements, scores, 0.5, moved=False)
    assert (natural["right"], natural["wrong"], natural["area_under_roc"]) == (2, 1, 0.5)
    assert (natural["right_accepted"], natural["wrong_accepted"]) == (1.0, 1.0)
    assert figures_of(placements, scores, 0.5, moved=True)["wrong_accepted"] == 0.0


def test_what_was_measured_of_a_recording_can_be_kept(tmp_path: Path) -> None:
    errors, placed = sure("towel"), Laid("towel-clean", "towel", {"overlap_cm2": 31.5}, 0.004, moved=True)
    keep(tmp_path / "in" / "towel.npz", errors, [placed])
    again, (placement,) = kept(tmp_path / "in" / "towel.npz")
    assert placement == placed
    assert (again.recording, again.garment) == ("towel-clean", "towel")
    assert again.within() == errors.within()


def test_the_roc_begins_with_nothing_and_ends_with_everything() -> None:
    placements = [laid(0.001), laid(0.002), laid(0.1), laid(0.2, moved=True)]
    wrong, right = roc(placements, np.array([0.9, 0.8, 0.85, 0.99]))
    np.testing.assert_allclose(wrong, [0.0, 0.0, 1.0, 1.0])
    np.testing.assert_allclose(right, [0.0, 0.5, 0.5, 1.0])


def test_the_unit_is_a_time_and_the_best_of_several_is_the_least() -> None:
    assert unit_s(repeats=1) > 0.0
    calls: list[int] = []
    assert best_s(lambda: calls.append(1), 3) >= 0.0
    assert len(calls) == 3
