"""The one table of what an operator can do; buttons, tooltips, keys and the ``?`` sheet come from it."""

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
"""Reasons offered by the reject menu; the second is what the bare key means."""

DEFAULT_REASON = "wrong place"

IN_LIVE_MODE = "This is live mode, which only plays the recording; start without --live to decide."
NO_CAMERA = "There is no camera; start with view --camera to capture with one."
NOT_LIVE = "The program is not in live mode; start it with --live to play the recording."


@dataclass(frozen=True)
class Action:
    """Something the operator can do.

    ``keys`` are values of the browser's ``KeyboardEvent.key`` (letters match either case), the
    first one is printed on the button; ``Space`` and ``Ctrl+z`` stand for what they say. A key may
    mean something else in another mode. ``group`` is ``session`` (the server decides whether it is
    allowed), ``proposal`` (needs a pending view), ``timeline`` (about views chosen there), ``live``
    (playing), ``capture`` (with a camera), ``view`` or ``page`` (always allowed), or ``teaching``
    (while it is open).
    """

    name: str
    title: str
    keys: tuple[str, ...]
    description: str
    group: str

    @property
    def mode(self) -> str:
        """The mode it belongs to, one of ``_MODES``, or nothing if it is always there."""
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
    Action("step", "Step", ("s",), "Choose the next view, flatten it and propose its place.", "session"),
    Action("accept", "Accept", ("a",), "Make the proposed view part of the shape.", "session"),
    Action("reject", "Reject", ("r",), f"Refuse the proposed view (reason: {DEFAULT_REASON}).", "session"),
    Action("reject_menu", "Reject with reason", ("e",), "Refuse the proposed view and say why.", "session"),
    Action(
        "skip",
        "Skip",
        ("k",),
        "Put the proposed view off: it comes again when the shape has grown or the others are done.",
        "session",
    ),
    Action("undo", "Undo", ("u", "Ctrl+z"), "Take the last decision back.", "session"),
    Action("redo", "Redo", ("y", "Ctrl+y"), "Make the decision that was taken back again.", "session"),
    Action(
        "auto",
        "Auto",
        ("g",),
        "Accept by the score and step on, until finished or below its limit.",
        "session",
    ),
    Action("cancel", "Cancel", ("Escape",), "Give up the running computation.", "session"),
    Action(
        "restart",
        "Restart",
        ("n",),
        "Begin anew from the largest view; undo brings all back.",
        "session",
    ),
    Action(
        "reopen",
        "Reopen",
        ("Ctrl+e",),
        "Decide again about the view chosen on the timeline; what was accepted after it follows.",
        "timeline",
    ),
    Action(
        "next_undecided",
        "Next undecided",
        ("j",),
        "Go to the next view on the timeline that waits for a decision.",
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
        "Pick pairs of points, one on the proposal and where it belongs on the shape; again: stop.",
        "proposal",
    ),
    Action("fit_pairs", "Fit pairs", ("Ctrl+Enter",), "Move the proposal so that the pairs fit.", "proposal"),
    Action(
        "refine",
        "Refine from here",
        ("Ctrl+i",),
        "Let the method refine the place from where it is.",
        "proposal",
    ),
    Action("overlay", "Both", ("o",), "Show the proposal on the shape; again: the shape alone.", "proposal"),
    Action("compare_shape", "A: shape", (",",), "Show the shape alone; again: both.", "proposal"),
    Action("compare_proposal", "B: proposal", (".",), "Show the proposal alone; again: both.", "proposal"),
    Action(
        "compare_wipe",
        "Wipe",
        ("w",),
        "Shape and proposal beside a divider to drag; again: both.",
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
        "Show what placed the proposal: curves, lines, strained edges.",
        "proposal",
    ),
    Action("live_play", "Play", ("Space",), "Live mode: play or pause the recording.", "live"),
    Action("live_back", "Frame back", (",",), "Live mode: pause and show the frame before.", "live"),
    Action("live_forward", "Frame forward", (".",), "Live mode: pause and show the next frame.", "live"),
    Action("live_turn", "Direction", ("d",), "Live mode: play the other way round.", "live"),
    Action(
        "capture_turned", "It is there", ("i",), "Capture: the item is at the angle asked for.", "capture"
    ),
    Action("capture_keep", "Keep", ("m",), "Capture: keep the view that was taken.", "capture"),
    Action("capture_repeat", "Repeat", ("j",), "Capture: take the view again.", "capture"),
    Action("layer_color", "Color", ("1",), "Show the color of the cloth.", "view"),
    Action("layer_height", "Height z", ("2",), "Show the height along the turning axis.", "view"),
    Action("layer_z_angle", "Z-angle", ("3",), "Show the Z-angle at which each pixel was seen.", "view"),
    Action("layer_source", "Source", ("4",), "Show which view each pixel came from.", "view"),
    Action("layer_stretch", "Stretch", ("5",), "Show how much the flattening changed lengths.", "view"),
    Action("layer_incidence", "Incidence", ("6",), "Show how obliquely each pixel was seen.", "view"),
    Action("layer_density", "Density", ("7",), "Show how densely the cloth was measured.", "view"),
    Action("layer_place", "Uncertainty", ("8",), "Show the uncertainty of each pixel's place.", "view"),
    Action("fit", "Fit", ("f",), "Fit the whole flattened view into its pane.", "view"),
    Action("zoom_in", "Zoom in", ("+", "="), "Zoom in.", "view"),
    Action("zoom_out", "Zoom out", ("-",), "Zoom out.", "view"),
    Action(
        "look",
        "Look",
        ("Shift+l",),
        "Turn, flip, grid, ruler, colours, contrast: for looking only, the data stay.",
        "view",
    ),
    Action(
        "turn_left_seen",
        "Turn view ↺",
        ("9",),
        "Turn the flattened view for looking, counter-clockwise.",
        "view",
    ),
    Action(
        "turn_right_seen", "Turn view ↻", ("0",), "Turn the flattened view for looking, clockwise.", "view"
    ),
    Action(
        "flip", "Flip", ("Shift+f",), "Exchange left and right of the flattened view for looking.", "view"
    ),
    Action(
        "source_image",
        "Source image",
        ("Shift+i",),
        "Show or fold the source image of the view, with its mask, and the views that saw the pick.",
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
    Action("grid", "Grid", ("#",), "Show or hide a grid with its centimetres.", "view"),
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
        "Point by keys: arrows move (Shift: tenfold), Enter clicks, Space presses and lets go; Esc leaves.",
        "view",
    ),
    Action(
        "follow",
        "Follow",
        ("v",),
        "Let the 3D camera follow the view: where the real camera stood.",
        "view",
    ),
    Action(
        "teach",
        "Teach",
        ("h",),
        "Walk through the method on this recording; nothing is decided. Again: leave.",
        "page",
    ),
    Action("teach_next", "Next", ("PageDown",), "Teaching: the next stage; → does it too.", "teaching"),
    Action("teach_back", "Back", ("PageUp",), "Teaching: the stage before; ← does it too.", "teaching"),
    Action("teach_play", "Play stage", ("k",), "Teaching: play or pause what moves.", "teaching"),
    Action("copy", "Copy pick", ("c",), "Copy the numbers of the current pick.", "page"),
    Action("export", "Export", ("x",), "Take the session away: page, report, figures, animation.", "page"),
    Action(
        "settings",
        "Settings",
        ("Ctrl+,",),
        "What can be set, each with its reset, and the numbers of the method.",
        "page",
    ),
    Action("palette", "Commands", ("Ctrl+k",), "Find a command by a few letters of its name.", "page"),
    Action("log", "Messages", ("l",), "Show all messages.", "page"),
    Action("theme", "Theme", ("t",), "Switch between light and dark.", "page"),
    Action("help", "Keys", ("?",), "Show this sheet.", "page"),
)


def command_of(name: str, state: SessionState, arguments: Mapping[str, Any]) -> Command:
    """Return the session command behind an action's name, as it would be meant now.

    ``arguments`` may hold ``view_index`` (the view the user saw) and ``reason``. A decision without
    a view is meant for the pending one; -1 if there is none, which the session then refuses.
    """
    document = state.document
    pending = -1 if document.pending is None else document.pending.view_index
    view = arguments.get("view_index")
    match name:
        case "step":
            # A cancelled start leaves nothing to step from: the step is the start itself then.
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
    """Say why an action is not allowed now, or None if it is."""
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
    """Return the table for the page, with the reason where an action is not allowed now.

    Without a state it is the table of live mode, which knows no decisions.
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
    """Return the motion of a nudge: a turn about the proposal's own centre, then a shift."""
    if not all(math.isfinite(x) for x in (*center_uv_m, theta_rad, u_m, v_m)):
        return Rigid2(math.nan, math.nan, math.nan)  # the session says why this is refused
    return Rigid2(theta_rad, u_m, v_m).about(center_uv_m)  # type: ignore[arg-type]
