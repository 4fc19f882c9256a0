"""The check of a recording: every view is read once, a handful of pairs is registered."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from flatcloth.checking.color import Shown, color_findings, odds_of, pairing_findings, reduced
from flatcloth.checking.comparison import Comparison, Reading, findings_of
from flatcloth.checking.findings import MOST_SURE, Check
from flatcloth.checking.hypotheses import (
    MOST_TILT_DEG,
    axes,
    focal_lengths,
    orders,
    seen_axis,
    sideways,
    slips,
    turnings,
)
from flatcloth.checking.images import (
    EXTENT_M,
    ViewLook,
    background_findings,
    coverage_findings,
    exposure_findings,
    look_at,
    mask_findings,
    unit_findings,
)
from flatcloth.checking.turns import features_of, free_moves, item_pixels, share_at, shows_turn
from flatcloth.core.config import SurfaceConfig
from flatcloth.core.errors import RecordingError, SurfaceError
from flatcloth.core.types import Float64, Progress, RgbdFrame, RotationAxis, no_progress
from flatcloth.flattening.surface import foreground_mask
from flatcloth.recordings.base import Recording
from flatcloth.registration.axis import THREADS
from flatcloth.registration.axis_estimation import UP, choose_views
from flatcloth.registration.view_features import ViewFeatures

_MOST_VIEWS = 36
"""Views that are read. Chosen: a turn in steps of 10 degrees."""
_FIRST = 3
"""Views by which the item and its distance are found. Chosen."""
_EXTENT_SHARE = EXTENT_M / 0.9
"""The item reaches this share of its distance around its middle, in any unit. Chosen: EXTENT_M at 0.9 m."""
_MOST_STEP_DEG = 15.0
"""With larger steps a contradiction means nothing: a registration finds the turn from a start within about
this. Measured: of the 34 recordings every second to fourth view seem to contradict each other in four."""


@dataclass(frozen=True, kw_only=True)
class _Seen:
    """What is kept of a view: how it looks, also reduced, and its features."""

    look: ViewLook
    shown: Shown
    features: ViewFeatures | None


def check_recording(
    recording: Recording,
    frame: Callable[[int], RgbdFrame] | None = None,
    progress: Progress = no_progress,
) -> Check:
    """Check whether a recording is right.

    Parameters
    ----------
    recording : Recording
        The recording; at most 36 of its views are read, spread over the turn.
    frame : callable, optional
        Reads a view, by several threads; by default the recording does.
    progress : callable
        Called with a share and a text.

    Returns
    -------
    Check
        Without findings if nothing is wrong.

    Raises
    ------
    RecordingError
        If no view can be read.
    """
    read = frame or recording.__getitem__
    numbers = _chosen(recording.angles_deg)
    known = _readable(read, numbers[:: max(1, len(numbers) // _FIRST)][:_FIRST])
    first = list(known.values())
    usual_m = _usual_depth_m(first, recording.rotation_axis)
    if not math.isfinite(usual_m):
        return Check(unjudged="no view shows a surface of the item")
    extent_m = max(EXTENT_M, _EXTENT_SHARE * usual_m)
    height_m = float(np.median([look_at(f, item_pixels(f, usual_m, extent_m)).height_m for f in first]))
    wrong_unit = unit_findings(usual_m, height_m, recording.rotation_axis)
    if wrong_unit:
        return Check(findings=tuple(wrong_unit), views=len(numbers), pairs=0)
    seen = list(_seen_views(lambda n: known[n] if n in known else read(n), numbers, usual_m, progress))
    return _checked(recording, seen)


_KNOWN = "known_check"


def checked(
    recording: Recording,
    frame: Callable[[int], RgbdFrame] | None = None,
    progress: Progress = no_progress,
) -> Check:
    """Return :func:`check_recording`, kept with the recording; made again once a growing one has doubled."""
    known = known_check(recording)
    if known is None or 0 < 2 * known.views <= min(len(recording), _MOST_VIEWS):
        known = check_recording(recording, frame, progress)
        with contextlib.suppress(AttributeError):  # a format of another package may have __slots__
            setattr(recording, _KNOWN, known)
    return known


def known_check(recording: Recording) -> Check | None:
    """Return what :func:`checked` found of a recording; None if it was not called."""
    known: Check | None = getattr(recording, _KNOWN, None)
    return known


def _checked(recording: Recording, seen: Sequence[_Seen]) -> Check:
    axis = recording.rotation_axis
    looks, views = [s.look for s in seen], [s.features for s in seen if s.features is not None]
    findings = mask_findings(looks) if recording.has_masks else []
    background = background_findings(looks)
    findings += background
    if not recording.is_growing:  # its angles are being chosen by what they show
        findings += coverage_findings([recording.angles_deg[look.view_index] for look in looks])
    findings += exposure_findings(looks)
    captured = sorted(seen, key=lambda one: one.look.view_index)
    numbers = [one.look.view_index for one in captured]
    items, colors = odds_of([one.shown for one in captured])
    pairing = pairing_findings(items, colors, numbers, len(recording))
    every = recording.intrinsics.height / items.shape[1]
    findings += pairing or color_findings(items, colors, numbers, every)
    # Without an axis it is the vertical of a level camera through the item.
    middle = np.median([view.middle_m for view in views], axis=0) if views else np.zeros(3)
    vertical = RotationAxis(point_m=middle, direction=UP, estimated=True)
    recorded = Reading(angles_deg={view.view_index: view.angle_deg for view in views}, axis=axis or vertical)
    shown = {one.look.view_index: one.shown for one in captured}
    comparison = Comparison(views, shown, recorded, recording.held_point_m)
    seen_at = None if axis else seen_axis(list(comparison.best_moves().values()), recorded.axis)
    if seen_at is not None and seen_at.tilt_deg < MOST_TILT_DEG:
        recorded = comparison.recorded = replace(recorded, axis=seen_at.axis)
    agreeing = 0
    if len(views) > 1:
        odds = comparison.log_odds(recorded)
        agreeing = sum(
            odds.get(link, -1.0) > 0.0 for link in recorded.neighbours if shows_turn(recorded.turn_deg(link))
        )
        if not background and not pairing:  # which does not turn; which turns as other views are recorded
            is_fine = recorded.step_deg <= _MOST_STEP_DEG
            simple = [turnings, axes, focal_lengths, slips] if is_fine else [turnings]
            findings += findings_of(comparison, simple, [sideways, orders] if is_fine else [])
    findings.sort(key=lambda finding: (not finding.stops, -min(finding.probability, MOST_SURE)))
    why = "" if agreeing else _unjudged([view.angle_deg for view in views])
    return Check(findings=tuple(findings), views=len(looks), pairs=agreeing, unjudged=why)


def _unjudged(angles_deg: Sequence[float]) -> str:
    """Return why no two views agree with their angles, in the order of these."""
    if len(angles_deg) < 2:
        return "fewer than two views show a surface of the item"
    step = float(np.median(np.diff(angles_deg)))
    if not shows_turn(step):
        return (
            f"its views are recorded {step:.2g} degrees apart, too {'near' if step < 1 else 'far'} to compare"
        )
    return "no two neighbouring views show the same surface"


def _chosen(angles_deg: Sequence[float]) -> list[int]:
    """Return the views that are read, in order of their angles: spread over the turn, or over what there is.

    Angles in another unit are no turn.
    """
    ranked = sorted(range(len(angles_deg)), key=lambda n: angles_deg[n])
    spread = choose_views(angles_deg, _MOST_VIEWS)
    is_turn = np.ptp(angles_deg) <= 360.0 and len(spread) > _MOST_VIEWS / 4
    if is_turn or len(ranked) <= _MOST_VIEWS:
        return sorted(spread, key=lambda n: angles_deg[n])
    return [ranked[n] for n in np.linspace(0, len(ranked) - 1, _MOST_VIEWS).round().astype(int)]


def _readable(read: Callable[[int], RgbdFrame], numbers: Sequence[int]) -> dict[int, RgbdFrame]:
    """Return the readable ones of some views; a damaged view is reported when it is requested."""
    found, errors = {}, []
    for n in numbers:
        try:
            found[n] = read(n)
        except RecordingError as error:
            errors.append(error)
    if errors and not found:
        raise errors[0]
    return found


def _usual_depth_m(frames: Sequence[RgbdFrame], axis: RotationAxis | None) -> float:
    """Return the median depth of the foreground; NaN if there is none."""
    depths = []
    for frame in frames:
        try:
            item = foreground_mask(frame, axis, SurfaceConfig())
        except SurfaceError:
            item = frame.depth_m > 0  # as in another unit; if all is far, it is the background
        if item.any():
            depths.append(float(np.median(frame.depth_m[item])))
    return float(np.median(depths)) if depths else math.nan


def _seen_views(
    read: Callable[[int], RgbdFrame], numbers: Sequence[int], usual_m: float, progress: Progress
) -> Iterator[_Seen]:
    """Look at each view; a damaged one is reported when it is requested."""

    def look(n: int) -> _Seen | None:
        try:
            frame = read(n)
        except RecordingError:
            return None
        near = item_pixels(frame, usual_m, EXTENT_M)
        return _Seen(look=look_at(frame, near), shown=reduced(frame, near), features=features_of(frame, near))

    with ThreadPoolExecutor(THREADS) as pool:
        for n, seen in enumerate(pool.map(look, numbers)):
            progress(n / len(numbers), "checking the recording")
            if seen is not None:
                yield seen


# --- for the teaching mode ------------------------------------------------------------------------

_MOST_DEG, _STEP_DEG = 60.0, 2.5
"""Turns that are shown. Chosen: beyond, two views share little cloth."""


@dataclass(frozen=True, kw_only=True)
class CheckLesson:
    """Two neighbours: ``share`` (N,) of their points agrees after the turns ``turn_deg`` (N,).

    They show the turn ``seen_deg``, with its deviation.
    """

    first: int
    second: int
    recorded_deg: float
    seen_deg: float
    std_deg: float
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
    if one is None or other is None or not (moves := free_moves(one, other, axis, recorded)):
        raise SurfaceError(f"Views {first} and {second} have nothing in common; use more views.")
    turns = np.arange(-_MOST_DEG, _MOST_DEG + 0.5 * _STEP_DEG, _STEP_DEG)
    return CheckLesson(
        first=first,
        second=second,
        recorded_deg=recorded,
        seen_deg=moves[0].turn_deg(axis),
        std_deg=moves[0].std_deg(axis),
        turn_deg=turns,
        share=np.array([share_at(one, other, axis, float(turn)) for turn in turns]),
    )
