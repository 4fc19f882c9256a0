"""What is done with the proposal: what messages mean, and what Auto asks about it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Float64, Rigid2
from flatcloth.engine.integration import Integration
from flatcloth.engine.placing import RefinedScore, fit_pairs
from flatcloth.engine.sheet import is_on_shape
from flatcloth.session.document import LEAST_MOVE_M, LEAST_TURN_RAD, Document, Pending, accept
from flatcloth.session.machine import Accept, Command, Nudge, Reject, Skip, TakePart
from flatcloth.viewer.protocol import messages
from flatcloth.viewer.protocol.picture import Overlay, shown_center_uv_m
from flatcloth.viewer.protocol.sent import AutoInfo, PairsAnswer, PreviewAnswer


def preview(
    integration: Integration, document: Document, asked: messages.Preview, by: Rigid2
) -> PreviewAnswer:
    """Return the score of the proposal moved ``by``, and that after refinement."""
    pending = asked_about(document, asked.view_index)
    found = integration.refined_score(replace(document, pending=replace(pending, nudge=by @ pending.nudge)))
    return PreviewAnswer(
        id=asked.id,
        score=found.score.total,
        apart_mm=found.score.apart_mm,
        refined_score=found.refined_score.total,
        refined_apart_mm=found.refined_score.apart_mm,
    )


def asked_about(document: Document, view_index: int) -> Pending:
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
    parts = () if overlay is None else overlay.proposal.parts
    part = next((p for p in parts if p.component == component), None)
    if overlay is None or overlay.view_index != pending.view_index or part is None:
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
    asked_about(document, pairs.view_index)
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
    shift_m, turn_rad = math.hypot(*moved.tolist()), abs(by.theta_rad)
    if shift_m < LEAST_MOVE_M and turn_rad < LEAST_TURN_RAD:
        return None, "Refining from here changes nothing."
    return by, (
        f"Refined: moved by {1000 * shift_m:.1f} mm and {math.degrees(turn_rad):.1f}\u00b0;"
        f" score {found.score.total:.2f}, now {found.refined_score.total:.2f}."
    )


def joins(integration: Integration, document: Document) -> bool:
    """Return whether the cloth of the proposal belongs to the shape, if it is accepted where it lies.

    The shape with it is kept, so that accepting it takes no time.
    """
    pending = document.pending
    assert pending is not None
    made = integration.canonical(accept(document, None))
    return is_on_shape(integration.views, made, pending.view_index, pending.component)


def meant(shown: tuple[Pending, Overlay] | None, asked: messages.Move) -> Rigid2:
    """Return the nudge that the page means, whose turn is about the centre of the shown proposal."""
    by = Rigid2(asked.theta_rad, asked.u_m, asked.v_m)
    if shown is None:
        return by
    pending, overlay = shown
    return overlay.meant(pending, by.about(np.array(shown_center_uv_m(pending, overlay))))


def after(auto: AutoInfo, command: Command) -> AutoInfo:
    """Return Auto after a decision by hand: an answer to what it waits for lets it go on."""
    if auto.is_busy or not auto.running:
        return AutoInfo()
    if isinstance(command, Accept | Reject | Skip):
        return AutoInfo(running=True)
    return auto if isinstance(command, Nudge | TakePart) else AutoInfo()


def what_is_unsure(pending: Pending, threshold: float) -> str:
    """Return what Auto asks about a proposal; empty if its score is good enough."""
    if math.isfinite(pending.score) and pending.score >= threshold:
        return ""
    return (
        f"Auto waits for you: the score of view {pending.view_index} is {pending.score:.2f}, below"
        f" {threshold:.2f}. Accept, move, reject or skip it; then Auto goes on."
    )
