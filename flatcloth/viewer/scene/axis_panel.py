"""Setting the turning axis by hand: four sliders in viser's panel, a preview in the scene, and Apply."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import viser

from flatcloth.core.geometry import rotation_about
from flatcloth.core.types import RotationAxis

SLIDERS = (
    ("Right (mm)", 60.0, 0.5),
    ("Away (mm)", 60.0, 0.5),
    ("Top leans right (deg)", 15.0, 0.1),
    ("Top leans away (deg)", 15.0, 0.1),
)
"""Label, largest value in either direction, step; as seen from the camera of view 0."""


class AxisPanel:
    """A folder of the panel; viser calls it from its threads.

    Parameters
    ----------
    server : viser.ViserServer
        The server of the panel.
    axis : RotationAxis
        The present axis, object frame; it leans about its point.
    on_preview : callable
        Called with the axis of the sliders while they move.
    on_apply : callable
        Called with the axis to use from now on.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        axis: RotationAxis,
        on_preview: Callable[[RotationAxis], None],
        on_apply: Callable[[RotationAxis], None],
    ) -> None:
        self._axis = axis
        self._on_preview = on_preview
        gui = server.gui
        with gui.add_folder("Turning axis", expand_by_default=False):
            self._text = gui.add_markdown(_described(axis))
            self._sliders = [
                gui.add_slider(label, min=-most, max=most, step=step, initial_value=0.0)
                for label, most, step in SLIDERS
            ]
            apply = gui.add_button("Apply", hint="Compute everything again with this axis.")
            reset = gui.add_button("Back", hint="Reset the sliders.")
        for slider in self._sliders:

            @slider.on_update
            def _(_event: Any) -> None:
                self._on_preview(self.chosen)

        @apply.on_click
        def _(_event: Any) -> None:
            on_apply(self.chosen)

        @reset.on_click
        def _(_event: Any) -> None:
            self.set_axis(self._axis)

    @property
    def chosen(self) -> RotationAxis:
        """The axis of the sliders."""
        right_mm, away_mm, lean_right_deg, lean_away_deg = (_within(s) for s in self._sliders)
        return moved_axis(
            self._axis,
            right_m=right_mm / 1000.0,
            away_m=away_mm / 1000.0,
            lean_right_deg=lean_right_deg,
            lean_away_deg=lean_away_deg,
        )

    def set_axis(self, axis: RotationAxis) -> None:
        """Set the present axis; the sliders are relative to it."""
        self._axis = axis
        self._text.content = _described(axis)
        for slider in self._sliders:
            slider.value = 0.0  # type: ignore[misc]  # viser declares it read-only, but means it
        self._on_preview(axis)


def _within(slider: Any) -> float:
    """Return a slider's value; viser passes on any value of a browser."""
    value = float(slider.value)
    return min(max(value, float(slider.min)), float(slider.max)) if math.isfinite(value) else 0.0


def moved_axis(
    axis: RotationAxis,
    *,
    right_m: float = 0.0,
    away_m: float = 0.0,
    lean_right_deg: float = 0.0,
    lean_away_deg: float = 0.0,
) -> RotationAxis:
    """Return an axis shifted, and leaned about its point, as seen from view 0's camera."""
    lean = rotation_about(np.array([1.0, 0.0, 0.0]), -math.radians(lean_away_deg))
    lean = rotation_about(np.array([0.0, 0.0, 1.0]), math.radians(lean_right_deg)) @ lean
    direction = lean @ axis.direction
    return replace(
        axis,
        point_m=axis.point_m + np.array([right_m, 0.0, away_m]),
        direction=direction / np.linalg.norm(direction),
        estimated=True,
    )


def _described(axis: RotationAxis) -> str:
    lean_deg = np.degrees(np.arcsin(axis.direction))
    x, z, right, away = np.round([*(1000.0 * axis.point_m[[0, 2]]), *lean_deg[[0, 2]]], 1) + 0.0  # no -0.0
    return (
        f"Now {x:.1f} mm right of the camera of view 0 and {z:.1f} mm away, "
        f"its top leaning {right:.1f}° right and {away:.1f}° away"
        + (" (not recorded: estimated, or set by hand)." if axis.estimated else ".")
    )
