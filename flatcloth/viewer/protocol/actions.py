"""The table of all actions; buttons, tooltips, keys and the ``?`` sheet are made from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from flatcloth.core.types import Rigid2
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

REJECT_REASONS = ("too small", "wrong place", "bad depth", "wrong side", "other")
"""Reasons in the reject menu."""

DEFAULT_REASON = "wrong place"

IN_LIVE_MODE = "This is live mode, which only plays the recording; start without --live to decide."
NO_CAMERA = "There is no camera; start with view --camera to capture with one."
NOT_LIVE = "The program is not in live mode; start it with --live to play the recording."


@dataclass(frozen=True)
class Action:
    """An action of the operator.

    ``keys`` are values of the browser's ``KeyboardEvent.key`` (letters match either case); the first
    is printed on the button. ``Space`` and ``Ctrl+z`` are written as such. The same key may have
    another meaning in another mode. ``group`` is ``session`` (the server decides whether it is
    allowed), ``proposal`` (needs a pending view), ``timeline`` (applies to views chosen there),
    ``live`` (playing), ``capture`` (with a camera), ``view`` or ``page`` (always allowed), or
    ``teaching`` (while it is open).
    """

    name: str
    title: str
    keys: tuple[str, ...]
    description: str
    group: str

    @property
    def mode(self) -> str:
        """The mode of the action, one of ``_MODES``, or "" if it is always available."""
        return _MODES.get(self.group, "")


_MODES = {
    "session": "session",
    "proposal": "session",
    "timeline": "session",
    "sides": "session",
    "live": "live",
    "capture": "capture",
    "teaching": "teaching",
}


ACTIONS: tuple[Action, ...] = (
    Action("step", "Step", ("s",), "Choose the next view, flatten it and propose its placement.", "session"),
    Action("accept", "Accept", ("a",), "Make the proposed view part of the shape.", "session"),
    Action("reject", "Reject", ("r",), f"Reject the proposed view (reason: {DEFAULT_REASON}).", "session"),
    Action("reject_menu", "Reject with reason", ("e",), "Reject the proposed view with a reason.", "session"),
    Action(
        "skip",
        "Skip",
        ("k",),
        "Postpone the proposed view until the shape has grown or the others are done.",
        "session",
    ),
    Action("undo", "Undo", ("u", "Ctrl+z"), "Undo the last decision.", "session"),
    Action("redo", "Redo", ("y", "Ctrl+y"), "Redo the decision that was undone.", "session"),
    Action(
        "auto",
        "Auto",
        ("g",),
        "Accept proposals by their score, until finished or below the limit.",
        "session",
    ),
    Action("cancel", "Cancel", ("Escape",), "Cancel the running computation.", "session"),
    Action(
        "restart",
        "Restart",
        ("n",),
        "Start again from the largest view; this can be undone.",
        "session",
    ),
    Action(
        "reopen",
        "Reopen",
        ("Ctrl+e",),
        "Decide again about the view chosen on the timeline; views accepted later follow.",
        "timeline",
    ),
    Action(
        "next_undecided",
        "Next undecided",
        ("j",),
        "Go to the next view on the timeline without a decision.",
        "timeline",
    ),
    Action(
        "lowest_score",
        "Lowest score",
        ("q",),
        "Go to a flagged view first, else to the accepted one with the lowest score.",
        "timeline",
    ),
    Action(
        "left",
        "Move left",
        ("ArrowLeft",),
        "Move the proposal; Shift for ten times as far.",
        "proposal",
    ),
    Action(
        "right",
        "Move right",
        ("ArrowRight",),
        "Move the proposal; Shift for ten times as far.",
        "proposal",
    ),
    Action("up", "Move up", ("ArrowUp",), "Move the proposal; Shift for ten times as far.", "proposal"),
    Action(
        "down",
        "Move down",
        ("ArrowDown",),
        "Move the proposal; Shift for ten times as far.",
        "proposal",
    ),
    Action(
        "turn_left",
        "Turn left",
        ("[", "{"),
        "Turn the proposal counter-clockwise; Shift for ten times as far.",
        "proposal",
    ),
    Action(
        "turn_right",
        "Turn right",
        ("]", "}"),
        "Turn the proposal clockwise; Shift: tenfold.",
        "proposal",
    ),
    Action(
        "pairs",
        "Pairs",
        ("p",),
        "Pick pairs of points on the proposal and on the shape; again: stop.",
        "proposal",
    ),
    Action("fit_pairs", "Fit pairs", ("Ctrl+Enter",), "Move the proposal so that the pairs fit.", "proposal"),
    Action(
        "refine",
        "Refine from here",
        ("Ctrl+i",),
        "Let the method refine the present placement.",
        "proposal",
    ),
    Action("overlay", "Both", ("o",), "Show the proposal on the shape; again: the shape alone.", "proposal"),
    Action("compare_shape", "A: shape", (",",), "Show the shape alone; again: both.", "proposal"),
    Action("compare_proposal", "B: proposal", (".",), "Show the proposal alone; again: both.", "proposal"),
    Action(
        "compare_wipe",
        "Wipe",
        ("w",),
        "Show shape and proposal on the two sides of a divider; again: both.",
        "proposal",
    ),
    Action("blink", "Blink", ("b",), "Blink the proposal against the shape; again: stop.", "proposal"),
    Action(
        "compare_difference",
        "Difference",
        ("d",),
        "Map the difference in color; again: in height, in 3D position.",
        "proposal",
    ),
    Action(
        "back_to_best",
        "Best place",
        ("Backspace",),
        "Lay the proposal back at the best place that was found.",
        "proposal",
    ),
    Action(
        "diagnostics",
        "Diagnostics",
        ("i",),
        "Show the diagnostics of the proposal: curves, lines, strained edges.",
        "proposal",
    ),
    Action("live_play", "Play", ("Space",), "Live mode: play or pause the recording.", "live"),
    Action("live_back", "Frame back", (",",), "Live mode: pause and show the previous frame.", "live"),
    Action("live_forward", "Frame forward", (".",), "Live mode: pause and show the next frame.", "live"),
    Action("live_turn", "Direction", ("d",), "Live mode: reverse the direction.", "live"),
    Action(
        "capture_turned", "It is there", ("i",), "Capture: the item is at the requested angle.", "capture"
    ),
    Action("capture_keep", "Keep", ("m",), "Capture: keep the view that was taken.", "capture"),
    Action("capture_repeat", "Repeat", ("j",), "Capture: take the view again.", "capture"),
    Action("layer_color", "Color", ("1",), "Show the color of the cloth.", "view"),
    Action("layer_height", "Height z", ("2",), "Show the height along the turning axis.", "view"),
    Action("layer_z_angle", "Z-angle", ("3",), "Show the Z-angle of each pixel in its view.", "view"),
    Action("layer_source", "Source", ("4",), "Show the source view of each pixel.", "view"),
    Action("layer_stretch", "Stretch", ("5",), "Show the change of lengths by flattening.", "view"),
    Action("layer_incidence", "Incidence", ("6",), "Show the incidence angle of each pixel.", "view"),
    Action("layer_density", "Density", ("7",), "Show the density of the measurement.", "view"),
    Action("layer_place", "Uncertainty", ("8",), "Show the placement uncertainty of each pixel.", "view"),
    Action("fit", "Fit", ("f",), "Fit the whole flattened view into its pane.", "view"),
    Action("zoom_in", "Zoom in", ("+", "="), "Zoom in.", "view"),
    Action("zoom_out", "Zoom out", ("-",), "Zoom out.", "view"),
    Action(
        "look",
        "Look",
        ("Shift+l",),
        "Rotate, flip, grid, ruler, colours, contrast; display only, data unchanged.",
        "view",
    ),
    Action(
        "turn_left_seen",
        "Turn view ↺",
        ("9",),
        "Rotate the display of the flattened view counter-clockwise.",
        "view",
    ),
    Action(
        "turn_right_seen",
        "Turn view ↻",
        ("0",),
        "Rotate the display of the flattened view clockwise.",
        "view",
    ),
    Action("flip", "Flip", ("Shift+f",), "Mirror the display of the flattened view.", "view"),
    Action(
        "source_image",
        "Source image",
        ("Shift+i",),
        "Show or hide the source image with its mask, and the views of the pick.",
        "view",
    ),
    Action(
        "brush_this",
        "This side",
        ("Shift+s",),
        "Paint cloth of the side of interest: on the source image, the shape or the 3D scene; again: stop.",
        "sides",
    ),
    Action(
        "brush_other",
        "Not this side",
        ("Shift+n",),
        "Paint cloth that is not of interest; again: stop.",
        "sides",
    ),
    Action(
        "cut",
        "Cut",
        ("Shift+c",),
        "Draw a line across the shape, then click beyond it: cloth there is not of interest; again: stop.",
        "sides",
    ),
    Action("brush_smaller", "Smaller brush", ("<",), "Make the brush smaller.", "sides"),
    Action("brush_larger", "Larger brush", (">",), "Make the brush larger.", "sides"),
    Action(
        "where_to_stroke",
        "Where to stroke next",
        ("Shift+w",),
        "Go to the view and the place where a stroke settles most.",
        "sides",
    ),
    Action("show_sides", "Sides", ("Shift+o",), "Show or hide which side the cloth is.", "sides"),
    Action("show_certainty", "Certainty", ("Shift+u",), "Show where the side is uncertain.", "sides"),
    Action("source_mask", "Mask", ("Shift+m",), "Show or hide the mask on the source image.", "view"),
    Action("grid", "Grid", ("#",), "Show or hide a grid in centimetres.", "view"),
    Action(
        "ruler",
        "Ruler",
        ("z",),
        "Measure by dragging: flat, along the cloth, through the air; Esc clears.",
        "view",
    ),
    Action(
        "pointer",
        "Pointer",
        ("Shift+p",),
        "Move the pointer with arrows (Shift: tenfold); Enter clicks, Space drags, Esc ends.",
        "view",
    ),
    Action(
        "follow",
        "Follow",
        ("v",),
        "Keep the 3D camera at the real camera's position.",
        "view",
    ),
    Action(
        "teach",
        "Teach",
        ("h",),
        "Go through the method step by step, without decisions; again: leave.",
        "page",
    ),
    Action("teach_next", "Next", ("PageDown",), "Teaching: the next stage; → does it too.", "teaching"),
    Action("teach_back", "Back", ("PageUp",), "Teaching: the previous stage; ← does it too.", "teaching"),
    Action("teach_play", "Play stage", ("k",), "Teaching: play or pause the animation.", "teaching"),
    Action("copy", "Copy pick", ("c",), "Copy the numbers of the current pick.", "page"),
    Action("export", "Export", ("x",), "Export the session: page, report, figures, animation.", "page"),
    Action(
        "settings",
        "Settings",
        ("Ctrl+,",),
        "Settings, each with its reset, and the parameters of the method.",
        "page",
    ),
    Action("palette", "Commands", ("Ctrl+k",), "Find a command by a few letters of its name.", "page"),
    Action("log", "Messages", ("l",), "Show all messages.", "page"),
    Action("theme", "Theme", ("t",), "Switch between light and dark.", "page"),
    Action("help", "Keys", ("?",), "Show the keys.", "page"),
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


def why_not(name: str, state: SessionState) -> str | None:
    """Return why an action is not allowed now, or None if it is allowed."""
    if name == "auto":
        if state.phase is Phase.FINISHED:
            return state.document.finished
        return None
    action = next(a for a in ACTIONS if a.name == name)
    if action.mode == "live":
        return NOT_LIVE
    if action.mode == "capture":
        return NO_CAMERA
    if action.group == "timeline":
        return _why_not_timeline(name, state)
    if action.group == "session":
        return why_illegal(state, command_of(name, state, {}))
    if action.group == "proposal" and state.document.pending is None:
        return "There is no proposal to move; step first."
    return None


def _why_not_timeline(name: str, state: SessionState) -> str | None:
    document = state.document
    if name == "lowest_score":
        return None if document.accepted else "No view has been accepted yet."
    if name == "reopen":
        if state.phase is Phase.COMPUTING:
            return why_illegal(state, Reopen(0))
        return None if document.reopenable_views else "There is no decision to reopen."
    return None


def _description(action: Action, state: SessionState | None) -> str:
    history = {} if state is None else {"undo": state.undo, "redo": state.redo}
    items = history.get(action.name)
    return f"{action.title}: {items[-1].name}." if items else action.description


def action_table(state: SessionState | None) -> list[dict[str, Any]]:
    """Return the table for the page, with the reason if an action is not allowed now.

    Without a state it is the table of live mode, which has no decisions.
    """
    return [
        {
            "name": a.name,
            "title": a.title,
            "keys": list(a.keys),
            "description": _description(a, state),
            "group": a.group,
            "mode": a.mode,
            "why_not": _why_not_live(a) if state is None else why_not(a.name, state),
        }
        for a in ACTIONS
    ]


def _why_not_live(action: Action) -> str | None:
    return {"session": IN_LIVE_MODE, "capture": NO_CAMERA}.get(action.mode)


def nudge_about(center_uv_m: tuple[float, float], theta_rad: float, u_m: float, v_m: float) -> Rigid2:
    """Return the motion of a nudge: a rotation about the proposal's own centre, then a shift."""
    if not all(math.isfinite(x) for x in (*center_uv_m, theta_rad, u_m, v_m)):
        return Rigid2(math.nan, math.nan, math.nan)  # the session refuses it with a reason
    return Rigid2(theta_rad, u_m, v_m).about(center_uv_m)  # type: ignore[arg-type]
