"""The reliability curve and the area under the ROC say what they are said to say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.confidence import Laid, figures_of
from benchmarks.reliability import PixelErrors, curve, keep, kept, least_factor, rows_of
from benchmarks.speed import best_s, unit_s

RANDOM = np.random.default_rng(0)


def sure(garment: str, claimed_too_small_by: float = 1.0) -> PixelErrors:
    std = RANDOM.uniform(2.0, 14.0, 20000)
    error = np.abs(RANDOM.standard_normal(std.size)) * std * claimed_too_small_by
    return PixelErrors(f"{garment}-clean", garment, error, std)


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


def test_right_and_wrong_placements_are_told_apart() -> None:
    placements = [Laid("towel", {}, error_m) for error_m in (0.001, 0.002, 0.1, 0.2, 0.015)]
    found = figures_of(placements, np.array([0.9, 0.8, 0.85, 0.1, 0.5]), 0.5)
    assert (found["right"], found["wrong"], found["area_under_roc"]) == (2, 2, 0.75)
    assert (found["right_accepted"], found["wrong_accepted"]) == (1.0, 0.5)


def test_what_was_measured_of_a_recording_can_be_kept(tmp_path: Path) -> None:
    errors = sure("towel")
    keep(tmp_path / "in" / "towel.npz", errors)
    again = kept(tmp_path / "in" / "towel.npz")
    assert (again.recording, again.garment) == ("towel-clean", "towel")
    assert again.within() == errors.within()


def test_the_unit_is_a_time_and_the_best_of_several_is_the_least() -> None:
    assert unit_s(repeats=1) > 0.0
    calls: list[int] = []
    assert best_s(lambda: calls.append(1), 3) >= 0.0
    assert len(calls) == 3
