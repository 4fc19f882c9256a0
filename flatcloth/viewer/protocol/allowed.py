"""What the actions mean to a session, and which of them it allows now."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from msgspec import structs

from flatcloth.session.machine import (
    Accept,
    Cancel,
    Command,
    Phase,
    Propose,
    Redo,
    Reject,
    Reopen,
    Restart,
    SessionState,
    Skip,
    Start,
    Undo,
    why_illegal,
)
from flatcloth.viewer.protocol.actions import (
    ACTIONS,
    DEFAULT_REASON,
    NO_CAMERA,
    ONLY_A_CAMERA,
    Action,
)


def command_of(name: str, state: SessionState, arguments: Mapping[str, Any]) -> Command:
    """Return the session command of an action at present.

    ``arguments`` may contain ``view_index`` (the view the user saw) and ``reason``. A decision
    without a view refers to the pending one; without one it is -1, which the session refuses.
    """
    document = state.document
    pending = -1 if document.pending is None else document.pending.view_index
    view = arguments.get("view_index")
    match name:
        case "step":
            # After a cancelled start there is no start view yet: the step is the start.
            return Start() if document.start_view is None else Propose()
        case "view":
            return Start(view) if document.start_view is None else Propose(view)
        case "accept":
            return Accept(pending if view is None else view, arguments.get("score"))
        case "skip":
            return Skip(pending if view is None else view)
        case "reopen":
            return Reopen(-1 if view is None else view)
        case "reject" | "reject_menu":
            return Reject(pending if view is None else view, arguments.get("reason", DEFAULT_REASON))
        case "undo":
            return Undo()
        case "redo":
            return Redo()
        case "cancel":
            return Cancel()
        case "restart":
            return Restart(view)
    raise KeyError(name)


def _why_not(action: Action, state: SessionState | None) -> str | None:
    """Return why an action is not allowed now, or None if it is allowed."""
    if state is None:
        return ONLY_A_CAMERA if action.mode == "session" else None
    name, document = action.name, state.document
    if name == "auto":
        return document.finished if state.phase is Phase.FINISHED else None
    if action.mode == "capture":
        return NO_CAMERA
    if name == "lowest_score":
        return None if document.accepted else "No view has been accepted yet."
    if name == "reopen" and state.phase is Phase.COMPUTING:
        return why_illegal(state, Reopen(0))
    if name == "reopen":
        return None if document.reopenable_views else "There is no decision to reopen."
    if action.group == "session":
        return why_illegal(state, command_of(name, state, {}))
    if action.group == "proposal" and document.pending is None:
        return "There is no proposal to move; step first."
    return None


def action_table(state: SessionState | None) -> tuple[Action, ...]:
    """Return the table for the page, with the reason if an action is not allowed now.

    Without a state it is the table of a camera's page, which has no decisions.
    """
    history = {} if state is None else {"undo": state.undo, "redo": state.redo}
    last = {name: f"{items[-1].name}." for name, items in history.items() if items}
    return tuple(
        structs.replace(
            action,
            description=f"{action.title}: {last[action.name]}" if action.name in last else action.description,
            why_not=_why_not(action, state),
        )
        for action in ACTIONS
    )
