"""How a check looks at two views, for the teaching mode: the share of them that agrees after each turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flatcloth.checking.images import EXTENT_M
from flatcloth.checking.turns import Pair, features_of, item_pixels, pair_of, share_at
from flatcloth.core.errors import SurfaceError
from flatcloth.core.types import Float64, RgbdFrame, RotationAxis
from flatcloth.recordings.base import Recording

_MOST_DEG, _STEP_DEG = 60.0, 2.5
"""Turns that are shown. Chosen: beyond, two views share little cloth."""


@dataclass(frozen=True, kw_only=True)
class CheckLesson:
    """A ``pair`` of neighbours: ``share`` (N,) of their points agrees after the turns ``turn_deg`` (N,)."""

    pair: Pair
    turn_deg: Float64
    share: Float64


def check_lesson(recording: Recording, frame: Callable[[int], RgbdFrame], axis: RotationAxis) -> CheckLesson:
    """Compare two neighbouring views of a recording after all turns.

    Raises
    ------
    SurfaceError
        If they show no item, or have nothing in common.
    """
    order = sorted(range(len(recording)), key=lambda n: recording.angles_deg[n])
    first, second = order[len(order) // 2 - 1], order[len(order) // 2]
    frames = frame(first), frame(second)
    measured = [f.depth_m[f.depth_m > 0] for f in frames]
    usual_m = float(np.median(np.concatenate(measured))) if any(map(len, measured)) else 0.0
    one, other = (features_of(f, item_pixels(f, usual_m, EXTENT_M)) for f in frames)
    recorded = recording.angles_deg[second] - recording.angles_deg[first]
    if one is None or other is None or not (pair := pair_of(one, other, axis, recorded)).turns:
        raise SurfaceError(f"Views {first} and {second} have nothing in common; use more views.")
    turns = np.arange(-_MOST_DEG, _MOST_DEG + 0.5 * _STEP_DEG, _STEP_DEG)
    share = np.array([share_at(one, other, axis, float(turn)) for turn in turns])
    return CheckLesson(pair=pair, turn_deg=turns, share=share)
