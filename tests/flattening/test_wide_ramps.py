"""Two layers in closed form: depth blurred to a wide ramp, colour sharp."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from flatcloth.core.types import Intrinsics
from flatcloth.flattening.wide_ramps import EdgeWidths, blurs_edges, cut_wide_ramps, edge_widths

CAMERA = Intrinsics(width=120, height=160, fx=600.0, fy=600.0, cx=59.5, cy=79.5)
EDGE = 63
"""The front layer ends before this column."""
LAYERS = 1.00, 1.04
BLUE, LIGHTER, WHITE = (40, 50, 140), (52, 62, 155), (230, 230, 235)


def front():
    return np.broadcast_to(np.arange(CAMERA.width) < EDGE, (CAMERA.height, CAMERA.width))


def blurred(width_px):
    """Inverse depth of the layers, tilted planes, joined by a linear ramp of this width."""
    cols = np.arange(CAMERA.width)
    depth = np.where(front(), LAYERS[0], LAYERS[1]) + 2e-4 * cols
    kernel = np.ones((1, width_px), np.float32) / width_px
    smooth = cv2.filter2D(depth, -1, kernel.astype(np.float64), borderType=cv2.BORDER_REPLICATE)
    return 1.0 / smooth, 1.0 / depth


def painted(left, right, noise=2.0):
    color = np.where(front()[..., None], left, right).astype(np.float64)
    color += noise * np.random.default_rng(0).standard_normal(color.shape)
    return np.clip(np.rint(color), 0, 255).astype(np.uint8)


def inner(image):
    return image[4:-4, 4:-4]


@pytest.mark.parametrize("width_px", [13, 16, 20])
@pytest.mark.parametrize("turned", [False, True])
def test_each_layer_of_a_wide_ramp_goes_on_to_the_colour_edge(width_px, turned):
    measured, true = blurred(width_px)
    color = painted(BLUE, LIGHTER)
    if turned:
        measured, true, color = measured.T.copy(), true.T.copy(), color.swapaxes(0, 1).copy()
    found, changed = cut_wide_ramps(measured, color, CAMERA)
    wrong_before = np.abs(1.0 / measured - 1.0 / true) > 0.001
    wrong = np.abs(1.0 / found - 1.0 / true) > 0.001
    assert inner(wrong_before).mean() > 0.09  # 10 columns and more
    assert inner(wrong).mean() < 0.01
    assert not (changed & ~cv2.dilate(wrong_before.astype(np.uint8), np.ones((9, 9))).astype(bool)).any()


def test_without_a_colour_edge_nothing_is_cut():
    measured, _ = blurred(16)
    found, changed = cut_wide_ramps(measured, painted(BLUE, BLUE), CAMERA)
    assert found is measured
    assert not changed.any()


def test_patterned_cloth_is_not_cut_along_its_pattern():
    measured, _ = blurred(16)
    squares = (np.indices(measured.shape) // 7).sum(axis=0) % 2 == 0
    color = np.where(squares[..., None], BLUE, WHITE).astype(np.uint8)
    assert not cut_wide_ramps(measured, color, CAMERA)[1].any()


def test_a_print_on_sloping_or_folded_cloth_is_no_edge_between_layers():
    cols = np.arange(CAMERA.width, dtype=np.float64)
    slope = 1.0 + 0.0025 * cols  # 56 degrees
    fold = 1.0 + 0.02 * np.cos(2 * np.pi * cols / 90.0)
    for depth in (slope, fold):
        measured = np.tile(1.0 / depth, (CAMERA.height, 1))
        assert not cut_wide_ramps(measured, painted(BLUE, WHITE), CAMERA)[1].any()


def test_a_sensor_that_shows_narrow_edges_has_no_wide_ramps():
    sharp, _ = blurred(1)
    measured, _ = blurred(16)
    both = np.concatenate([measured, sharp])  # the upper half with a fold that looks like a ramp
    camera = Intrinsics(width=120, height=320, fx=600.0, fy=600.0, cx=59.5, cy=159.5)
    color = np.concatenate([painted(BLUE, LIGHTER)] * 2)
    assert cut_wide_ramps(both, color, camera)[0] is both


def test_a_jump_and_a_narrow_ramp_are_left_to_their_own_tests():
    for width_px in (1, 5, 7):
        measured, _ = blurred(width_px)
        assert cut_wide_ramps(measured, painted(BLUE, WHITE), CAMERA)[0] is measured


def test_a_view_without_narrow_edges_does_not_tell_the_sensor_but_views_together_do():
    measured, _ = blurred(16)
    sharp, _ = blurred(1)
    color, asked = painted(BLUE, LIGHTER), []

    def other_views():
        asked.append(1)
        return blurs_edges([edge_widths(measured, CAMERA), edge_widths(sharp, CAMERA)])

    assert blurs_edges([edge_widths(measured, CAMERA)])
    assert cut_wide_ramps(measured, color, CAMERA, other_views)[0] is measured
    assert asked
    assert not blurs_edges([EdgeWidths(99, 0)])
