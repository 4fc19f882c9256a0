"""The page's side of repair: scores while the proposal is dragged, refinement, pairs of points.

A drag requests scores faster than they can be computed. Only the newest request of each tab is answered,
on a separate thread, so that nothing else waits for it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Float64, Rigid2
from flatcloth.engine.placing import PairFit, RefinedScore, fit_pairs
from flatcloth.session.document import Document, Pending
from flatcloth.session.machine import Nudge
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol import messages
from flatcloth.viewer.protocol.answers import PairsAnswer, PreviewAnswer
from flatcloth.viewer.protocol.picture import Overlay
from flatcloth.viewer.worker import attempt

_STILL_MM = 0.05
"""Smaller motions are reported as none. Chosen: half of the last digit shown."""
_STILL_DEG = 0.005
"""See ``_STILL_MM``."""


class RepairService:
    """Computes scores and refinements; its methods are for the page's own thread and return immediately."""

    def __init__(self, page: PageController) -> None:
        self._page = page
        self._newest: dict[int, int] = {}  # the last request of each tab

    def preview(self, client: int, asked: messages.Preview, document: Document, by: Rigid2) -> None:
        """Send a tab the score of the proposal moved ``by``; replaces its previous request.

        The page asks for it with each proposal, so that one that was decided meanwhile is no error.
        """
        try:
            pending = meant(document, asked.view_index)
        except FlatclothError as error:
            self._page.tabs.tell(client, PreviewAnswer(id=asked.id, why=str(error)))
            return
        moved = replace(document, pending=replace(pending, nudge=by @ pending.nudge))
        self._newest[client] = asked.id

        def answer() -> None:
            if self._newest[client] != asked.id:
                return
            found = attempt(lambda: self._page.integration.refined_score(moved), "scoring the placement")
            if isinstance(found, str):
                told = PreviewAnswer(id=asked.id, why=found)
            else:
                told = PreviewAnswer(
                    id=asked.id,
                    score=found.score.total,
                    apart_mm=found.score.apart_mm,
                    refined_score=found.refined_score.total,
                    refined_apart_mm=found.refined_score.apart_mm,
                )
            self._page.tabs.tell(client, told)

        self._page.executor.put("repair", answer)

    def refine(self, document: Document, take: Callable[[RefinedScore | str], None]) -> None:
        """Refine the proposal from its present placement; ``take`` gets the result, or why there is none."""
        refine = self._page.integration.refined_score
        self._page.executor.compute("repair", lambda: refine(document), take, "refining")


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


def fit_of(placement: Rigid2, pairs: messages.Pairs) -> PairFit:
    """Fit the pairs of a tab; their points of the proposal come in its own plane, which lies at a placement.

    Raises
    ------
    FlatclothError
        If there are too few pairs, or they do not determine a motion.
    """
    if len(pairs.new_uv_m) != len(pairs.shape_uv_m):
        raise FlatclothError("Pairs need a point of the proposal and one of the shape each.")
    own = np.array(pairs.new_uv_m, dtype=np.float64).reshape(-1, 2)
    there = np.array(pairs.shape_uv_m, dtype=np.float64).reshape(-1, 2)
    return fit_pairs(placement.apply(own), there)


def fitted(
    document: Document, placed: tuple[Pending, Overlay] | None, pairs: messages.Pairs
) -> tuple[Nudge | None, PairsAnswer]:
    """Return the decision that fits pairs, if that is wanted, and the page's message about the fit.

    Raises
    ------
    FlatclothError
        If the proposal is another by now, or is not drawn yet.
    """
    meant(document, pairs.view_index)
    if placed is None:
        raise FlatclothError("The proposal is being drawn; fit the pairs again in a moment.")
    pending, overlay = placed
    shown = overlay.shown(pending)
    fit = fit_of(shown, pairs)
    if not pairs.fit:
        return None, pairs_answer(fit)
    nudge = Nudge(pairs.view_index, overlay.meant(pending, fit.by), "fit pairs of")
    return nudge, pairs_answer(fit_of(fit.by @ shown, pairs))


def pairs_answer(fit: PairFit) -> PairsAnswer:
    """Return the result of fitted pairs for a tab."""
    return PairsAnswer(
        residual_mm=(1000 * fit.residual_m).tolist(),
        fitted_mm=(1000 * fit.fitted_m).tolist(),
        rms_mm=1000 * fit.rms_m,
    )


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
