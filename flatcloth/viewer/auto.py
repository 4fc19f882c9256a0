"""What Auto does next: go on, wait for the operator, or end, by the choice of how far it runs."""

from __future__ import annotations

import math
from dataclasses import dataclass

from flatcloth.session.document import Pending
from flatcloth.session.machine import (
    Accept,
    Command,
    LeaveOut,
    Nudge,
    Phase,
    Propose,
    Reject,
    SessionState,
    Skip,
    Start,
    TakePart,
)
from flatcloth.viewer.protocol.picture import Picture
from flatcloth.viewer.protocol.sent import AutoInfo
from flatcloth.viewer.protocol.settings import Settings


@dataclass(frozen=True)
class Wait:
    """Wait for the operator, who sees the reason."""

    text: str


@dataclass(frozen=True)
class End:
    """End, and tell so; ``by_choice`` is why, if views are left that may add cloth."""

    text: str
    by_choice: str = ""


Step = Command | Wait | End | None


def next_step(state: SessionState, auto: AutoInfo, settings: Settings, picture: Picture | None) -> Step:
    """Return what Auto does next; None: nothing, until something changes.

    Parameters
    ----------
    state : SessionState
        The session.
    auto : AutoInfo
        Whether it runs, and waits.
    settings : Settings
        Least score, and how far it runs.
    picture : Picture or None
        What is shown; Auto waits until it shows the session.
    """
    document, pending = state.document, state.document.pending
    started = document.start_view is not None
    up_to_date = picture is not None and picture.document is document
    if not auto.running or state.phase is Phase.COMPUTING or (started and not up_to_date):
        return None
    if state.phase is Phase.FINISHED:
        return End(f"Auto has ended. {document.finished or ''}")
    if not started:
        return Start()
    if auto.waits_for:
        return None
    if pending is not None:
        unsure = _what_is_unsure(pending, settings.auto_threshold)
        return Wait(unsure) if unsure else Accept(pending.view_index)
    n_views = len(document.used_views)
    if settings.auto_until == "views" and n_views >= settings.auto_views and not document.later:
        enough = f"The shape has {n_views} views, as chosen."
        return End(f"Auto has ended. {enough}", by_choice=enough)
    return Propose()


def after(auto: AutoInfo, command: Command) -> AutoInfo:
    """Return Auto after a decision by hand: an answer to what it waits for lets it go on."""
    if auto.is_busy or not auto.running:
        return AutoInfo()
    if isinstance(command, Accept | Reject | Skip):
        return AutoInfo(running=True)
    return auto if isinstance(command, Nudge | TakePart | LeaveOut) else AutoInfo()


def _what_is_unsure(pending: Pending, threshold: float) -> str:
    """Return what Auto asks about a proposal; empty if its score is good enough."""
    if math.isfinite(pending.score) and pending.score >= threshold:
        return ""
    return (
        f"Auto waits for you: the score of view {pending.view_index} is {pending.score:.2f}, below"
        f" {threshold:.2f}. Accept, move, reject or skip it; then Auto goes on."
    )
