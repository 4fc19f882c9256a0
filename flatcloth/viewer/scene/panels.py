"""viser's panel next to the scene: visibility, and the curves behind a decision."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from flatcloth.core.types import Float64
from flatcloth.engine.integration import Proposal
from flatcloth.methods.answers import ColumnCurves
from flatcloth.viewer.protocol.picture import Picture
from flatcloth.viewer.scene.clouds import HELD, LIVE, PROPOSAL

_AXIS = {"stroke": "#888888", "grid": {"stroke": "#88888840", "width": 1}, "size": 46}
_BLUE, _ORANGE = "#3b82c4", "#d9822b"

SWITCHES = (
    (LIVE, "Present view"),
    (HELD, "Shape so far"),
    (PROPOSAL, "What the proposal adds"),
    ("/axis", "Turning axis"),
    ("/camera", "Camera"),
)


class Panels:
    """Visibility switches and plots; ``on_switch(node, visible)`` is called from viser's threads."""

    def __init__(
        self,
        server: viser.ViserServer,
        on_switch: Callable[[str, bool], None],
        on_follow: Callable[[bool], None],
    ) -> None:
        gui = server.gui
        gui.set_panel_label("Scene and curves")
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="small")
        with gui.add_folder("Show"):
            for node, label in SWITCHES:
                self._add_switch(gui, node, label, on_switch)
            self._follow = gui.add_checkbox("Camera follows the view", initial_value=True)
        follow = self._follow

        @follow.on_update
        def _(event: Any) -> None:
            # Only changes by a user are handled; our own updates have no client.
            if event.client is not None:
                on_follow(follow.value)

        with gui.add_folder("Next rotation", expand_by_default=False):
            self._hint = gui.add_markdown("The curves of the flattened view appear with a proposal.")
            self._count = self._plot(gui, "h(u): pixels per column, u in mm", "px", _BLUE)
            self._angle = self._plot(gui, "A_z(u): mean Z-angle (deg), u in mm", "deg", _ORANGE)
        with gui.add_folder("Flattening", expand_by_default=False):
            self._energy = self._plot(gui, "Energy per iteration (log10)", "log10 E", _BLUE)
        gui.main_panel.minimize()

    @staticmethod
    def _add_switch(gui: viser.GuiApi, node: str, label: str, on_switch: Callable[[str, bool], None]) -> None:
        box = gui.add_checkbox(label, initial_value=True)

        @box.on_update
        def _(_event: Any) -> None:
            on_switch(node, box.value)

    @staticmethod
    def _plot(gui: viser.GuiApi, title: str, label: str, color: str) -> viser.GuiUplotHandle:
        nothing = np.array([0.0, 1.0])
        return gui.add_uplot(
            (nothing, np.zeros(2)),
            ({"label": "x"}, {"label": label, "stroke": color, "width": 1.5}),
            title=title,
            scales={"x": {"time": False}},
            axes=(_AXIS, _AXIS),  # type: ignore[arg-type]
            legend={"show": False},
            height=150,
            visible=False,
        )

    def set_follow(self, follow: bool) -> None:
        """Show the state of the switch that was changed on the page."""
        if self._follow.value != follow:
            self._follow.value = follow  # type: ignore[misc]  # viser declares it read-only, but means it

    def show(self, picture: Picture | None) -> None:
        """Show the curves of a picture, or none."""
        overlay = None if picture is None else picture.overlay
        curves = None if overlay is None else planned_curves(overlay.proposal)
        self._hint.visible = curves is None
        self._count.visible = self._angle.visible = curves is not None
        if curves is not None:
            u_mm = 1000.0 * np.asarray(curves.u_m, dtype=np.float64)
            _update(self._count, u_mm, np.asarray(curves.column_count, dtype=np.float64))
            _update(self._angle, u_mm, np.asarray(curves.column_mean_z_angle_deg, dtype=np.float64))
        energy = np.array([e for level in (picture.energies if picture else ()) for e in level])
        self._energy.visible = energy.size > 1
        if energy.size > 1:
            iterations = np.arange(energy.size, dtype=np.float64)
            _update(self._energy, iterations, np.log10(np.maximum(energy, 1e-15)))


def planned_curves(proposal: Proposal) -> ColumnCurves | None:
    """Return the curves behind a proposal's rotation; None if the operator chose it."""
    if proposal.plan is None:
        return None
    return next((side.curves for side in proposal.plan.sides if side.side is proposal.side), None)


def _update(plot: viser.GuiUplotHandle, x: Float64, y: Float64) -> None:
    known = np.isfinite(x) & np.isfinite(y)
    if known.sum() > 1:
        plot.data = (x[known], y[known])
