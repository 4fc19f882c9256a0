from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from garment_evidence import blank_view

from flatcloth.core.errors import EvaluationError
from flatcloth.core.types import FlattenedView, Intrinsics, RgbdFrame, Rigid2
from flatcloth.engine.evaluation import Evaluation, compare, trimmed_fit

SIZE = 200
PIXEL = 0.002


@dataclass(frozen=True)
class View:
    panel: np.ndarray
    outer_face: np.ndarray
    flat_uv_m: np.ndarray


class FlatSheet:
    """A recording of one view, each image pixel showing 2 mm of the panel; and its truth."""

    panel_of_interest = 2
    angles_deg = (0.0,)

    def __init__(self) -> None:
        rows, cols = np.mgrid[0:SIZE, 0:SIZE]
        self.flat = np.stack([cols, rows], axis=-1).astype(np.float32) * PIXEL
        self.panel = np.full((SIZE, SIZE), 2, dtype=np.uint8)
        self.outer = np.ones((SIZE, SIZE), dtype=bool)
        self.mask = np.ones((SIZE, SIZE), dtype=bool)

    def __len__(self) -> int:
        return 1

    def __getitem__(self, view_index: int) -> RgbdFrame:
        camera = Intrinsics(width=SIZE, height=SIZE, fx=1, fy=1, cx=0, cy=0)
        depth = np.ones((SIZE, SIZE), dtype=np.float32)
        color = np.zeros((SIZE, SIZE, 3), dtype=np.uint8)
        return RgbdFrame(
            view_index=0, angle_deg=0, color=color, depth_m=depth, mask=self.mask, intrinsics=camera
        )

    @property
    def truth(self) -> Truth:
        return Truth(self)


class Truth:
    def __init__(self, sheet: FlatSheet) -> None:
        self.sheet, self.panel_of_interest = sheet, sheet.panel_of_interest

    def __getitem__(self, view_index: int) -> View:
        return View(self.sheet.panel, self.sheet.outer, self.sheet.flat)


def result(sheet: FlatSheet, keep: np.ndarray | None = None, stretch: float = 1.0) -> FlattenedView:
    """The sheet, flattened exactly (or stretched), every pixel linked to its image pixel."""
    valid = np.ones((SIZE, SIZE), dtype=bool) if keep is None else keep
    rc = np.stack([*np.mgrid[0:SIZE, 0:SIZE]], axis=-1).astype(np.float32)
    return blank_view(valid, PIXEL * stretch, source_rc=rc, origin_uv_m=(0.7, -0.2))


def figures(view: FlattenedView, sheet: FlatSheet) -> Evaluation:
    return compare(view, sheet.truth, sheet)  # type: ignore[arg-type]


def test_an_exact_result_has_no_error_and_full_coverage() -> None:
    sheet = FlatSheet()
    found = figures(result(sheet), sheet)
    assert found.absolute_p95_mm < 1e-3
    assert found.relative_p95_mm < 1e-3
    assert found.absolute_far_share == found.relative_far_share == found.wrong_side_share == 0.0
    assert found.coverage == 1.0


def test_neither_scale_nor_a_mirror_is_forgiven() -> None:
    sheet = FlatSheet()
    found = figures(result(sheet, stretch=1.1), sheet)
    assert found.relative_median_mm == pytest.approx(0.1 * 133, rel=0.15)
    assert found.absolute_median_mm > 8
    sheet.flat = sheet.flat[:, ::-1].copy()
    assert figures(result(sheet), sheet).absolute_median_mm > 50


def test_a_rigid_motion_is_and_the_worst_tenth_does_not_bend_the_fit() -> None:
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (1000, 2))
    target = Rigid2(2.1, 0.4, -0.1).apply(points)
    target[:80] += 0.3
    fitted = trimmed_fit(points, target)
    np.testing.assert_allclose(fitted[80:], target[80:], atol=1e-9)


def test_a_hinge_spoils_the_absolute_figure_and_hardly_the_relative_one() -> None:
    sheet = FlatSheet()
    lower = sheet.flat[..., 1] > 0.3
    swung = Rigid2(0.3).about(np.array([0.2, 0.3]))
    sheet.flat[lower] = swung.apply(sheet.flat[lower])
    found = figures(result(sheet), sheet)
    assert found.absolute_p95_mm > 20
    assert found.relative_median_mm < 1.0


@pytest.mark.parametrize("says_so", [True, False])
def test_deviations_are_judged_from_what_is_called_reliable(says_so: bool) -> None:
    """Three fifths of the sheet hang on a joint and are turned; they say so, or call themselves reliable."""
    sheet = FlatSheet()
    turned = sheet.flat[..., 1] > 0.16
    sheet.flat[turned] = Rigid2(0.0, 0.5, 0.0).apply(sheet.flat[turned])
    std_m = np.where(turned & says_so, 0.2, 0.001 if says_so else 0.003).astype(np.float32)
    found = figures(replace(result(sheet), placement_std_m=std_m), sheet)
    assert (found.within_3_std_share > 0.98) == says_so
    assert (found.firm_far_share < 1e-6) == says_so


def test_pixels_of_the_other_side_are_counted_and_left_out_of_the_errors() -> None:
    sheet = FlatSheet()
    sheet.panel[:, :20] = 1
    sheet.outer[:, 20:40] = False
    found = figures(result(sheet), sheet)
    assert found.wrong_side_share == pytest.approx(0.2)
    assert found.absolute_p95_mm < 1e-3


def test_coverage_counts_reachable_cells_of_the_largest_piece_only() -> None:
    sheet = FlatSheet()
    sheet.mask[:, 150:155] = False  # a strip nobody saw cuts the right part off
    keep = np.zeros((SIZE, SIZE), dtype=bool)
    keep[:, :75] = True
    found = figures(result(sheet, keep), sheet)
    assert found.coverage == pytest.approx(0.5, abs=0.01)


def test_a_result_without_any_truth_is_an_error() -> None:
    sheet = FlatSheet()
    sheet.panel[:] = 1
    with pytest.raises(EvaluationError, match="nothing to compare"):
        figures(result(sheet), sheet)
