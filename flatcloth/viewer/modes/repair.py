"""The page's side of repair: scores while the proposal is dragged, refinement, pairs of points.

A drag requests scores faster than they can be computed. Only the newest request of each tab is answered,
on a lane of its own, so that nothing else waits for it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Float64, Rigid2
from flatcloth.engine.repair import RefinedScore, fit_pairs
from flatcloth.session.machine import Document, Nudge, Pending
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol import messages
from flatcloth.viewer.protocol.answers import PairsAnswer, PreviewAnswer
from flatcloth.viewer.protocol.picture import Overlay

_STILL_MM = 0.05
"""Smaller motions are reported as none. Chosen: half of the last digit shown."""
_STILL_DEG = 0.005
"""See ``_STILL_MM``."""


class Previews:
    """Sends a tab the score of a moved proposal; its newest question only. For the page's own thread."""

    def __init__(self, page: PageController) -> None:
        self._page = page
        self._newest: dict[int, int] = {}  # the last question of each tab

    def ask(self, client: int, asked: messages.Preview, document: Document, by: Rigid2) -> None:
        """Answer with the score of the proposal moved ``by``, and that after refinement.

        The page asks for it with each proposal, so that one that was decided meanwhile is no error.
        """

        def take(found: RefinedScore | str) -> None:
            if isinstance(found, str):
                self._page.tabs.tell(client, PreviewAnswer(id=asked.id, why=found))
                return
            answer = PreviewAnswer(
                id=asked.id,
                score=found.score.total,
                apart_mm=found.score.apart_mm,
                refined_score=found.refined_score.total,
                refined_apart_mm=found.refined_score.apart_mm,
            )
            self._page.tabs.tell(client, answer)

        def make() -> RefinedScore:
            pending = meant(document, asked.view_index)
            moved = replace(document, pending=replace(pending, nudge=by @ pending.nudge))
            return self._page.integration.refined_score(moved)

        self._newest[client] = asked.id
        self._page.executor.compute(
            "repair", make, take, "scoring the placement", lambda: self._newest[client] == asked.id
        )


def meant(document: Document, view_index: int) -> Pending:
    """Return the proposal if it is the given view.

    Raises
    ------
    FlatclothError
        If it is not, or there is none.
    """
    pending = document.pending
    if pending is None or pending.view_index != view_index:
        raise FlatclothError("The proposal has changed; look again.")
    return pending


def place_of_part(pending: Pending, overlay: Overlay | None, component: int) -> Rigid2:
    """Return the first placement of another component of the proposal: the method's, or the present one.

    Raises
    ------
    FlatclothError
        If the view has no such component.
    """
    parts = () if overlay is None else overlay.proposal.placement.parts
    part = next((p for p in parts if p.component == component), None)
    if overlay is None or overlay.proposal.view_index != pending.view_index or part is None:
        raise FlatclothError(f"View {pending.view_index} has no part {component + 1} to place; look again.")
    return pending.current_from_new if part.alignment is None else part.alignment.current_from_new


def fitted(
    document: Document, placed: tuple[Pending, Overlay] | None, pairs: messages.Pairs
) -> tuple[Nudge | None, PairsAnswer]:
    """Return the decision that fits pairs, if that is wanted, and the page's message about the fit.

    The pairs' points of the proposal come in its own plane.

    Raises
    ------
    FlatclothError
        If the proposal is another by now, or is not drawn yet; if there are too few pairs, or they do not
        determine a motion.
    """
    meant(document, pairs.view_index)
    if placed is None:
        raise FlatclothError("The proposal is being drawn; fit the pairs again in a moment.")
    if len(pairs.new_uv_m) != len(pairs.shape_uv_m):
        raise FlatclothError("Pairs need a point of the proposal and one of the shape each.")
    pending, overlay = placed
    own, there = (
        np.array(uv_m, dtype=np.float64).reshape(-1, 2) for uv_m in (pairs.new_uv_m, pairs.shape_uv_m)
    )
    shown, nudge = overlay.shown(pending), None
    fit = fit_pairs(shown.apply(own), there)
    if pairs.fit:
        nudge = Nudge(pairs.view_index, overlay.meant(pending, fit.by), "fit pairs of")
        fit = fit_pairs((fit.by @ shown).apply(own), there)
    residual_mm, fitted_mm = (1000 * fit.residual_m).tolist(), (1000 * fit.fitted_m).tolist()
    return nudge, PairsAnswer(residual_mm=residual_mm, fitted_mm=fitted_mm, rms_mm=1000 * fit.rms_m)


def refined_motion(pending: Pending, found: RefinedScore, center: Float64) -> tuple[Rigid2 | None, str]:
    """Return the motion of a refinement, None if it is negligible, and a text for the operator."""
    by = found.refined @ pending.current_from_new.inverse()
    moved = by.apply(center) - center
    shift_mm, turn_deg = 1000 * math.hypot(*moved.tolist()), math.degrees(abs(by.theta_rad))
    if shift_mm < _STILL_MM and turn_deg < _STILL_DEG:
        return None, "Refining from here changes nothing."
    return by, (
        f"Refined: moved by {shift_mm:.1f} mm and {turn_deg:.1f}\u00b0;"
        f" score {found.score.total:.2f}, now {found.refined_score.total:.2f}."
    )
