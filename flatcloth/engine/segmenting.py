"""Recordings without masks, in a session: the side of interest is found, and the recording has masks then.

``prepare`` is the slow part (seconds, in the background), ``SideSolver.solve`` the quick one (a stroke);
``masked`` is what the rest of the program integrates.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from flatcloth.core.errors import SegmentationError
from flatcloth.core.strokes import Decision, ImageStroke, why_off_image
from flatcloth.core.types import Progress, RgbdFrame, no_progress
from flatcloth.engine.views import RecordedViews
from flatcloth.recordings.base import Recording, ViewImages, altered
from flatcloth.registration.axis import THREADS
from flatcloth.segmentation.observed import Evidence, gather_evidence
from flatcloth.segmentation.result import Segmentation
from flatcloth.segmentation.solver import SideSolver
from flatcloth.session.store import Keeper

MOST_VIEWS = 600
"""Views in which sides are found. They are registered together: time and memory grow with the square (1,000
views of 160 x 120 pixels took 1.7 GB and 144 s)."""
MOST_PIXELS = 200_000_000
"""Pixels of all of them, which are in memory at the same time: 7 bytes each."""


def masked(recording: Recording, segmentation: Segmentation) -> Recording:
    """Return a recording whose views have the masks of a segmentation; masks of its own are not used.

    Its attributes are those of the recording, ``has_masks`` included, so that a session folder takes it
    for the same recording; its notes also list the sides found, regions cut off, and conflicts.
    """
    kinds = sorted({cut.kind for cut in segmentation.observed.cut_off})
    cut = (f"Cut off as no part of the item: {', '.join(kinds)}.",) if kinds else ()

    def read(view_index: int) -> ViewImages:
        frame, mask = recording[view_index], segmentation.mask(view_index)
        return ViewImages(frame.color, frame.depth_m, frame.depth_m < 0.0 if mask is None else mask)

    own = tuple(getattr(recording, "notes", ()))
    return altered(recording, read=read, notes=(*own, segmentation.text, *cut, *segmentation.conflicts))


def prepare(views: RecordedViews, progress: Progress = no_progress) -> SideSolver:
    """Read all views of a recording, without their masks, and return a solver for the sides.

    Raises
    ------
    SegmentationError
        If no view shows an item, or there are two.
    RecordingError
        If a view cannot be read.
    """
    return SideSolver(evidence_of(views, progress))


def evidence_of(
    views: RecordedViews, progress: Progress = no_progress, *, confirmed: bool = False
) -> Evidence:
    """Return the evidence of all views of the sides, where no stroke will ask for more; errors as above.

    The poses of the cameras may be ``confirmed``.
    """
    own = views.axis, views.held_point_m, views.config
    return gather_evidence(_all(views), *own, progress=progress, confirmed=confirmed)


def _all(views: RecordedViews) -> list[RgbdFrame]:
    n, camera = len(views.recording), views.recording.intrinsics
    if n > MOST_VIEWS or n * camera.width * camera.height > MOST_PIXELS:
        raise SegmentationError(
            f"{views.recording.location}: {n} views of {camera.width} x {camera.height} pixels without "
            f"masks; the side of interest is found in at most {MOST_VIEWS} views, "
            f"{MOST_PIXELS / 1e6:.0f} million pixels. Keep fewer views, or give masks."
        )
    with ThreadPoolExecutor(THREADS) as pool:
        return [*pool.map(views.recorded, range(n))]


def take_strokes(views: RecordedViews, session: Keeper, strokes: Sequence[Decision]) -> None:
    """Record strokes that a session does not have yet, before it continues.

    With masks of the recording that agree, strokes are not recorded.

    Raises
    ------
    SegmentationError
        If a stroke touches no image, or contradicts the mask of its view for most of the cloth under it.
    """
    recording, camera = views.recording, views.recording.intrinsics
    for n, stroke in enumerate(strokes, start=1):
        why = why_off_image(stroke, len(recording), camera.height, camera.width)
        if why is None and recording.has_masks and isinstance(stroke, ImageStroke):
            mask = recording[stroke.view_index].mask
            assert mask is not None
            at = np.rint(np.asarray(stroke.points_rc)).astype(int)
            at = np.clip(at, 0, np.array(mask.shape) - 1)
            if (float(mask[at[:, 0], at[:, 1]].mean()) > 0.5) != (stroke.side == "this"):
                why = (
                    f"it contradicts the mask of view {stroke.view_index}; take out the stroke, or segment a "
                    "copy of the recording without its masks."
                )
        if why is not None:
            raise SegmentationError(f"{recording.location}: decision {n}: {why}")
    for stroke in () if recording.has_masks else strokes:
        if stroke not in session.state.document.strokes:
            session.record(stroke)


def summary(segmentation: Segmentation) -> dict[str, Any]:
    """Return the part of a report about a segmentation, ready for JSON: areas in cm2."""
    return {
        "text": segmentation.text,
        "facing_view": segmentation.facing_view,
        "certainty": round(segmentation.mean_certainty, 4),
        "area_cm2": round(1e4 * segmentation.area_of_interest_m2, 1),
        "undecided_cm2": round(1e4 * segmentation.area_undecided_m2, 1),
        "decisions": len(segmentation.decisions),
        "conflicts": list(segmentation.conflicts),
        "cut_off": [
            {"view_index": cut.view_index, "kind": cut.kind, "area_cm2": round(1e4 * cut.area_m2, 1)}
            for cut in segmentation.observed.cut_off
        ],
    }
