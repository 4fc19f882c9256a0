"""Serves the stages of :mod:`flatcloth.engine.teaching`; the work is cancelled when the client leaves.

An answer is a sequence of records: the length of a JSON text and of a body (two uint32, little
endian), the text, the body. ``progress`` records come first; the last record is the lesson, whose
arrays and pictures are parts of its body, or an ``error``.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import threading
from collections.abc import AsyncIterator, Callable
from dataclasses import astuple
from typing import Any

import numpy as np
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from flatcloth.checking.check import CheckLesson, check_lesson
from flatcloth.core.errors import CancelledError, FlatclothError
from flatcloth.core.parcel import Parcel, record
from flatcloth.core.types import MIRROR, Bool, FlattenedView, Int32, Progress, RotationAxis, Uint8, finite
from flatcloth.engine.garment.lesson import GarmentLesson, garment_lesson
from flatcloth.engine.segmenting import SidesLesson
from flatcloth.engine.sheet import outline_loops
from flatcloth.engine.teaching import (
    AlignmentLesson,
    FlatteningLesson,
    Parameters,
    PlanningLesson,
    StartLesson,
    Teaching,
)
from flatcloth.flattening.borders import SPACING_M
from flatcloth.flattening.flatten import Level
from flatcloth.flattening.surface import Surface
from flatcloth.garments.recognition import MISFIT, NONE, misfit_of
from flatcloth.methods.answers import Alignment, ColumnCurves, SidePlan, ZAngleLine
from flatcloth.recordings.mending import Mends
from flatcloth.rendering import layers
from flatcloth.rendering.colormaps import MAPS
from flatcloth.rendering.evidence import mistaken
from flatcloth.rendering.pictures import grid_of
from flatcloth.validation.markers import KitTruth
from flatcloth.viewer.http import RefusedError
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol.picture import OtherSheet, truth_of
from flatcloth.viewer.worker import attempt

CM2 = 1e4
"""Square centimetres in a square metre."""
_OFF_THE_SURFACE_ALPHA = 70
"""Opacity (of 255) of pixels off the surface. Chosen."""
_UNKNOWN_ANGLE = -128
"""Code of a pixel without an angle; angles are within 90 degrees."""


def _picture(parcel: Parcel, name: str, rgba: Uint8) -> None:
    parcel.picture(name, layers.png(rgba), rgba.shape[:2])


# --- Fig. 2 ----------------------------------------------------------------------------------------


def flattening_parcel(lesson: FlatteningLesson, axis: RotationAxis, truth: KitTruth | None = None) -> Parcel:
    """Return the drawing data of Fig. 2, with the error of each pixel if there is a truth."""
    parcel = Parcel()
    flattening = lesson.flattening
    surface = flattening.surface
    _picture(parcel, "image", _image(surface))
    view = flattening.view if truth is None else truth.with_errors(flattening.view)
    parcel.values = {
        "view_index": lesson.view_index,
        "surface_px": int(surface.usable.sum()),
        "pixel_pitch_mm": 1e3 * surface.pixel_pitch_m,
        "depth_mm": 1e3 * float(np.median(surface.xyz_m[..., 2][surface.usable])),
        "levels": [
            _level(parcel, name, level, unused)
            for name, level, unused in zip(
                ("coarse", "fine"), lesson.flattening.levels, lesson.unused_pairs, strict=False
            )
        ],
        "flat": grid_of(view),
        "area_cm2": view.area_m2 * CM2,
        "parts_cm2": [c.view.area_m2 * CM2 for c in flattening.components],
        "folded_share": flattening.components[0].folded_share,
        "triangles": len(flattening.triangles),
    }
    parcel.array("triangles", flattening.triangles, "int32")
    _picture(parcel, "color", layers.rgba(view, "color", axis, 1))
    _picture(parcel, "height", layers.rgba(view, "height", axis, 1))
    _picture(parcel, "normal", _normals(view))
    if view.error_m is not None:
        _picture(parcel, "truth", layers.rgba(view, "truth", axis, 1))
        parcel.array("error_mm", 1e3 * view.error_m, "float32")
    top, left = surface.frame.offset_rc
    valid = view.valid[..., None]
    parcel.array("source_rc", np.where(valid, np.rint(view.source_rc - (top, left)), -1), "int16")
    parcel.array("rgb", view.rgb, "uint8")
    parcel.array("xyz_mm", np.where(valid, np.rint(1e3 * view.xyz_m), 0), "int16")
    parcel.array("normal_percent", np.where(valid, np.rint(100 * view.normal), 0), "int8")
    return parcel


def _level(parcel: Parcel, name: str, level: Level, unused: Int32) -> dict[str, Any]:
    main = np.zeros(len(level.points_rc), dtype=bool)
    main[level.state_members] = True
    # Without a pair there is nothing to minimise, and no state was recorded.
    states = level.states or (level.initial_uv_m[main],)
    parcel.array(f"{name}_points_rc", level.points_rc, "int32")
    parcel.array(f"{name}_edges", level.edges, "int32")
    parcel.array(f"{name}_length_mm", 1e3 * level.edge_length_m, "float32")
    parcel.array(f"{name}_unused", unused, "int32")
    parcel.array(f"{name}_members", level.state_members, "int32")
    parcel.array(f"{name}_states", np.array(states), "float32")
    return {
        "name": name,
        "interval_px": level.sampling_interval_px,
        "points": len(level.points_rc),
        "pairs": len(level.edges),
        "unused": len(unused),
        "mean_length_mm": 1e3 * float(level.edge_length_m.mean()) if len(level.edges) else None,
        "main_points": int(main.sum()),
        "parts": int(level.component.max()) + 1,
        "energy_mm2": [1e6 * h for h in level.energy],
        "state_iterations": list(range(len(states))),
    }


def _image(surface: Surface) -> Uint8:
    """Return the part of the image around the item, pale off the surface (H, W, 4)."""
    return _faded(surface.frame.color, surface.usable)


def _normals(view: FlattenedView) -> Uint8:
    """Return the normals as colours (H, W, 4): red right, green up, blue towards the camera of view 0."""
    toward = np.nan_to_num(view.normal) * np.array([1.0, -1.0, -1.0], dtype=np.float32)
    rgb = np.rint(127.5 + 127.5 * toward).clip(0, 255).astype(np.uint8)
    return np.dstack([rgb, np.where(view.valid, 255, 0).astype(np.uint8)])


# --- the start view --------------------------------------------------------------------------------


def start_parcel(lesson: StartLesson, axis: RotationAxis, session_view: int | None) -> Parcel:
    """Return the drawing data of the choice of the start view; ``session_view`` is that of the session."""
    parcel = Parcel()
    _picture(parcel, "image", _image(lesson.flattening.surface))
    _picture(parcel, "color", layers.rgba(lesson.flattening.view, "color", axis, 1))
    parcel.array("area_cm2", CM2 * lesson.areas_m2, "float32")
    parcel.values = {
        "view_index": lesson.view_index,
        "session_view": session_view,
        "flat": grid_of(lesson.flattening.view),
        "tried": [{"view": view, "part_cm2": CM2 * area_m2} for view, area_m2 in lesson.tried],
    }
    return parcel


# --- Fig. 4 ----------------------------------------------------------------------------------------


def planning_parcel(lesson: PlanningLesson, axis: RotationAxis) -> Parcel:
    """Return the drawing data of Fig. 4a."""
    parcel = Parcel()
    view, plan = lesson.view, lesson.plan
    angle = np.where(view.valid, np.nan_to_num(np.rint(view.z_angle_deg)).clip(-127, 127), _UNKNOWN_ANGLE)
    parcel.array("z_angle_deg", angle, "int8")
    _picture(parcel, "color", layers.rgba(view, "color", axis, 1))
    _curves(parcel, "current", plan.sides[0].curves)
    for edge, uv_m in lesson.edges_uv_m.items():
        parcel.array(f"edge_{edge.value}", uv_m, "float32")
    parcel.values = {
        "view_index": lesson.view_index,
        "flat": grid_of(view),
        "z_angle_span_deg": layers.Z_ANGLE_SPAN_DEG,
        "z_angle_colors": MAPS["diverging"].table()[::4].tolist(),
        "next_view": plan.view_index,
        "side": None if plan.side is None else plan.side.value,
        "rotation_deg": finite(plan.rotation_deg),
        "reason": plan.reason,
        "sides": [_side(s) for s in plan.sides],
    }
    return parcel


def _side(side: SidePlan) -> dict[str, Any]:
    return {
        "side": side.side.value,
        "occluding_edge_mm": 1e3 * side.occluding_edge_m,
        "u_b_mm": finite(1e3 * side.u_b_m),
        "a_0_deg": finite(side.a_0_deg),
        "rotation_deg": finite(side.rotation_deg),
        "view_index": side.view_index,
        "reason": side.reason,
    }


def _curves(parcel: Parcel, name: str, curves: ColumnCurves) -> None:
    parcel.array(f"{name}_u_mm", 1e3 * curves.u_m, "float32")
    parcel.array(f"{name}_h", curves.column_count, "int32")
    parcel.array(f"{name}_a_z_deg", curves.column_mean_z_angle_deg, "float32")


def alignment_parcel(lesson: AlignmentLesson, axis: RotationAxis) -> Parcel:
    """Return the drawing data of the rest of Fig. 4."""
    parcel = Parcel()
    alignment = lesson.proposal.alignment
    _picture(parcel, "image", _image(lesson.flattening.surface))
    for name, view in (("current", lesson.current), ("new", lesson.new), ("renewed", lesson.renewed.view)):
        _picture(parcel, f"{name}_color", layers.rgba(view, "color", axis, 1))
    parcel.array("origin", lesson.origin, "uint8")
    search, first = lesson.search, alignment.initial_score
    parcel.array("cost", search.cost, "float32")
    parcel.array("starts", search.starts * (180 / np.pi, 1e3, 1e3), "float32")
    parcel.array("path", search.path * (180 / np.pi, 1e3, 1e3), "float32")
    side = lesson.proposal.side
    parcel.values = {
        "view_index": lesson.view_index,
        "planned_view": lesson.planned_view,
        "placed_with": lesson.placed_with,
        "side": None if side is None else side.value,
        "current": grid_of(lesson.current),
        "new": grid_of(lesson.new),
        "renewed": grid_of(lesson.renewed.view),
        "current_cm2": lesson.current.area_m2 * CM2,
        "new_cm2": lesson.new.area_m2 * CM2,
        "renewed_cm2": lesson.renewed.view.area_m2 * CM2,
        "initial": astuple(alignment.initial),
        "found": astuple(alignment.current_from_new),
        "initial_score": None if first is None else first.total,
        "score": alignment.score.total,
        "score_parts": {k: finite(float(v)) for k, v in alignment.score.parts.items()},
        "search": {
            "turns_deg": np.degrees(search.turns_rad).tolist(),
            "shifts_mm": (1e3 * search.shifts_m).tolist(),
            "motions": [astuple(m) for m in search.motions],
            "tried": search.tried,
            "end_score": search.end_score,
            "start_stands": alignment.current_from_new == alignment.initial,
        },
        **_correspondence(parcel, alignment),
    }
    return parcel


def _correspondence(parcel: Parcel, alignment: Alignment) -> dict[str, Any]:
    found = alignment.correspondence
    if found is None:
        return {"lines": None}
    _curves(parcel, "current", found.current_curves)
    _curves(parcel, "new", found.new_curves)
    return {
        "lines": {
            "rotation_deg": found.rotation_deg,
            "common_range_deg": list(found.common_range_deg),
            "a_m_deg": found.a_m_deg,
            "height_mm": 1e3 * found.height_m,
            "current": _line(parcel, "current", found.current),
            "new": _line(parcel, "new", found.new),
        }
    }


def _line(parcel: Parcel, name: str, line: ZAngleLine) -> dict[str, Any]:
    parcel.array(f"{name}_pixels_uv", line.pixels_uv_m, "float32")
    return {
        "z_angle_deg": line.z_angle_deg,
        "center_uv_m": line.center_uv_m.tolist(),
        "direction": line.direction.tolist(),
        "point_uv_m": line.point_uv_m.tolist(),
    }


# --- the side of interest --------------------------------------------------------------------------


def check_parcel(lesson: CheckLesson, picture: Uint8) -> Parcel:
    """Return the drawing data of a check: ``picture`` (H, W, 3) shows two views laid on each other."""
    parcel = Parcel()
    opaque = np.full((*picture.shape[:2], 1), 255, np.uint8)
    _picture(parcel, "laid", np.concatenate([picture, opaque], axis=2))
    parcel.array("turn_deg", lesson.turn_deg, "float32")
    parcel.array("share", lesson.share, "float32")
    parcel.values = {
        "view_index": lesson.first,
        "other_view": lesson.second,
        "recorded_deg": lesson.recorded_deg,
        "seen_deg": lesson.seen_deg,
        "std_deg": lesson.std_deg,
    }
    return parcel


def sides_parcel(lesson: SidesLesson) -> Parcel:
    """Return the drawing data of the side of interest."""
    parcel, found, section = Parcel(), lesson.found, lesson.section
    observed, frame = found.observed, lesson.frame
    view = observed.views[frame.view_index]
    item = view.whole(view.item)
    _picture(parcel, "image", _faded(frame.color, item))
    parcel.array("section_mm", 1e3 * section.place_m, "float32")
    parcel.array("section_normal", section.normal, "float32")
    parcel.array("section_side", found.side[section.cluster], "int8")
    parcel.array("alike", section.alike, "int32")
    parcel.array("opposite", section.opposite, "int32")
    parcel.array("section_rc", np.argwhere(np.isin(view.cluster, section.cluster) & view.surface), "int16")
    cut: dict[str, float] = {}
    for piece in found.cut_off:
        if piece.view_index == frame.view_index:
            cut[piece.kind] = cut.get(piece.kind, 0.0) + CM2 * piece.area_m2
    labels = found.view(frame.view_index)
    assert labels is not None
    parcel.array("first_side", labels.side, "int8")
    parcel.array("first_percent", np.rint(100 * labels.certainty), "uint8")
    graph, (rows, cols) = observed.graph, labels.side.shape
    parcel.values = {
        "view_index": frame.view_index,
        "item_px": int(item.sum()),
        "cut_off_cm2": cut,
        "n_views": len(observed.views),
        "clusters": observed.clusters.count,
        "n_alike": int((graph.weight > 0).sum()),
        "n_opposite": int((graph.weight < 0).sum()),
        "samples": observed.config.samples,
        "certainty": found.mean_certainty,
        "found_cm2": CM2 * found.area_of_interest_m2,
        "undecided_cm2": CM2 * found.area_undecided_m2,
        "first": {"rows": rows, "cols": cols, "offset_rc": list(labels.offset_rc)},
    }
    return parcel


# --- the garment -----------------------------------------------------------------------------------


def garment_parcel(lesson: GarmentLesson, axis: RotationAxis) -> Parcel:
    """Return the drawing data of the recognition of the garment."""
    parcel, evidence, view = Parcel(), lesson.evidence, lesson.view
    if view is not None:
        _picture(parcel, "shape", layers.rgba(view, "color", axis, 1))
    parcel.array("edge_uv", evidence.edge_uv_m, "float32")
    parcel.array("edge_normal", evidence.edge_normal, "float32")
    parcel.array("edge_trust", evidence.edge_trust, "float32")
    parcel.array("unseen_uv", evidence.unseen_uv_m, "float32")
    parcel.array("inside_uv", evidence.inside_uv_m, "float32")
    parcel.array("states", lesson.states, "float32")
    for fit in lesson.fits:
        outline = fit.garment_from_piece[0].inverse().apply(fit.outline)
        parcel.array(f"outline_{fit.kind.name}", outline, "float32")
    best = lesson.fits[0].log_evidence
    parcel.values = {
        "flat": None if view is None else grid_of(view),
        "area_cm2": CM2 * evidence.area_m2,
        "edges_m": SPACING_M * len(evidence.edge_uv_m),
        "unseen_m": SPACING_M * len(evidence.unseen_uv_m),
        "trust": float(evidence.edge_trust.mean()) if len(evidence.edge_trust) else None,
        "state_shape": list(lesson.states.shape),
        "energy": lesson.energy.tolist(),
        "widened": lesson.widened.tolist(),
        "temperature": lesson.temperature,
        "kinds": [
            {
                "name": fit.kind.name,
                "below": finite(fit.log_evidence - best),
                "energy": fit.energy,
                "parameters": len(fit.kind.parameters),
                "probability": lesson.probabilities[fit.kind.name],
            }
            for fit in lesson.fits
        ],
        "none": lesson.probabilities[NONE],
        "misfit": misfit_of(lesson.fits[0], evidence),
        "misfit_limit": MISFIT,
    }
    return parcel


# --- both sides ------------------------------------------------------------------------------------


def seams_parcel(other: OtherSheet | None) -> Parcel:
    """Return the drawing data of the seams between both sides.

    Raises
    ------
    FlatclothError
        While they are not known.
    """
    if other is None:
        raise FlatclothError("The other side is being computed; this stage is drawn when it is known.")
    sides, this, its_sheet = other.sides, other.this, other.sheet
    parcel, seams = Parcel(), sides.seams
    for name, sheet in (("this", this), ("other", its_sheet)):
        for n, loop in enumerate(outline_loops(sheet.canonical.view)):
            parcel.array(f"{name}_loop_{n}", loop if name == "this" else loop * MIRROR, "float32")
    none = [np.zeros((0, 2))]
    own = [this.places(seam.this_uv_m)[1] for seam in seams]
    its = [its_sheet.places(seam.other_uv_m)[1] for seam in seams]
    parcel.array("this_uv", np.concatenate([*none, *own]), "float32")
    parcel.array("mirrored_uv", np.concatenate([*none, *its]) * MIRROR, "float32")
    starts = np.cumsum([0, *(len(seam.xyz_m) for seam in seams)])
    joining = [seam.residual_m for seam in seams if not seam.why]
    parcel.values = {
        "this_cm2": CM2 * this.shape_m2,
        "other_cm2": CM2 * its_sheet.shape_m2,
        "this_floating": len(this.pieces),
        "other_floating": len(its_sheet.pieces),
        "residual_mm": 1e3 * float(np.median(np.concatenate(joining))) if joining else None,
        "seams": [
            {
                "start": int(start),
                "places": len(seam.xyz_m),
                "why": seam.why,
            }
            for start, seam in zip(starts, seams, strict=False)
        ],
    }
    return parcel


def _faded(color: Uint8, item: Bool) -> Uint8:
    """Return an image, pale off the item (H, W, 4)."""
    return np.dstack([color, np.where(item, 255, _OFF_THE_SURFACE_ALPHA).astype(np.uint8)])


PARTS = ("flattening", "start", "planning", "alignment", "sides", "garment", "seams", "check")
"""The parts: Fig. 2, the start view, Fig. 4a, the rest of Fig. 4, the side of interest, the garment, both
sides, the check."""
_OF_ALL_VIEWS = ("start", "sides", "garment", "seams", "check")
"""Parts without a start view of their own, and without parameters. By definition."""

SLIDERS: dict[str, dict[str, float]] = {
    "sampling_interval_px": {"low": 8, "high": 24, "step": 2},
    "z_angle_limit_deg": {"low": 20, "high": 75, "step": 5},
    "overlap_cm2": {"low": 50, "high": 800, "step": 1},
}
"""The sliders of the page; the valid range is checked by the parameters themselves."""

Tell = Callable[[bytes, bool], None]
"""Called from any thread with a record, and whether it is the last one."""


class TeachingRoutes:
    """Answers the requests of the teaching mode of a page; computes one lesson at a time."""

    def __init__(self, page: PageController) -> None:
        self._page = page
        self._teaching: Teaching | None = None

    async def serve(self, request: Request) -> Response:
        """Answer a request for a part; its parameters come from the address, or from the session."""
        part = request.path_params["part"]
        if part not in PARTS:
            raise RefusedError(f"Unknown part {part!r:.40}; choose one of {', '.join(PARTS)}.", 404)
        asked = _asked(dict(request.query_params), len(self._page.integration.recording))
        return StreamingResponse(
            self._records(part, asked),
            media_type="application/octet-stream",
            headers={"Cache-Control": "no-store"},
        )

    async def _records(self, part: str, asked: dict[str, Any]) -> AsyncIterator[bytes]:
        """Yield records as they are made, until the last one or until the client leaves."""
        loop, records = asyncio.get_running_loop(), asyncio.Queue[tuple[bytes, bool]]()
        cancelled = threading.Event()

        def tell(data: bytes, last: bool) -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(records.put_nowait, (data, last))

        self._compute(part, asked, tell, cancelled)
        try:
            last = False
            while not last:
                data, last = await records.get()
                yield data
        finally:
            cancelled.set()

    def _compute(self, part: str, asked: dict[str, Any], tell: Tell, cancelled: threading.Event) -> None:
        def progress(share: float, text: str) -> None:
            if cancelled.is_set():
                raise CancelledError
            tell(record({"kind": "progress", "share": share, "text": text}), False)

        def make() -> bytes:
            progress(0.0, "Starting")
            return self._lesson(part, asked, progress)

        def job() -> None:
            with contextlib.suppress(CancelledError):
                made = attempt(make, "computing")
                tell(record({"kind": "error", "text": made}) if isinstance(made, str) else made, True)

        self._page.executor.put("teaching", job)

    def _lesson(self, part: str, asked: dict[str, Any], progress: Progress) -> bytes:
        if self._teaching is None or self._teaching.views != len(self._page.integration.recording):
            self._teaching = Teaching(self._page.integration)  # of an active loop, the recording grows
        teaching, defaults = self._teaching, _plain(self._teaching.defaults)
        start = asked["start_view"]
        if start is None and part not in _OF_ALL_VIEWS:
            start = teaching.start_view(progress)
        parameters = _parameters({**defaults, **{k: v for k, v in asked.items() if k in defaults}})
        axis, recording = self._page.integration.axis, self._page.integration.recording
        view = 0 if start is None else start
        match part:
            case "flattening":
                lesson = teaching.flattening(view, parameters, progress)
                parcel = flattening_parcel(lesson, axis, truth_of(recording))
            case "planning":
                parcel = planning_parcel(teaching.planning(view, parameters, progress), axis)
            case "start":
                parcel = start_parcel(teaching.start(progress), axis, start)
            case "sides":
                parcel = sides_parcel(teaching.sides(progress))
            case "garment":
                parcel = garment_parcel(garment_lesson(self._page.garments.last, progress), axis)
            case "seams":
                parcel = seams_parcel(self._page.other_sheet)
            case "check":
                checked = check_lesson(recording, self._page.integration.views.recorded, axis)
                views = checked.first, checked.second
                mistakes = {
                    "turned back": Mends(reverse=True),
                    "twice as far": Mends(angle_factor=2.0),
                    "longer lens": Mends(focal_factor=1.3),
                }
                parcel = check_parcel(checked, mistaken(recording, views, mistakes))
            case _:
                parcel = alignment_parcel(teaching.alignment(view, parameters, progress), axis)
        common = {
            "kind": part,
            "parameters": _plain(parameters),
            "defaults": defaults,
            # The range of a slider includes the session's own value.
            "sliders": {
                name: {**slider, "low": min(slider["low"], own), "high": max(slider["high"], own)}
                for (name, own), slider in zip(defaults.items(), SLIDERS.values(), strict=True)
            },
            "recording": recording.name,
            "start_view": view,
            "angles_deg": list(recording.angles_deg),
        }
        return parcel.pack(common)


# --- the question ----------------------------------------------------------------------------------


def _plain(parameters: Parameters) -> dict[str, float]:
    return {
        "sampling_interval_px": parameters.sampling_interval_px,
        "z_angle_limit_deg": parameters.z_angle_limit_deg,
        "overlap_cm2": round(parameters.overlap_area_m2 * CM2, 6),
    }


def _parameters(values: dict[str, float]) -> Parameters:
    return Parameters(
        sampling_interval_px=int(values["sampling_interval_px"]),
        z_angle_limit_deg=values["z_angle_limit_deg"],
        overlap_area_m2=values["overlap_cm2"] / CM2,
    )


def _asked(given: dict[str, str], n_views: int) -> dict[str, Any]:
    """Read the parameters of an address.

    Raises
    ------
    RefusedError
        If a parameter is unknown or not a valid number.
    """
    known: dict[str, Callable[[str], float]] = {
        "start_view": int,
        "sampling_interval_px": int,
        "z_angle_limit_deg": float,
        "overlap_cm2": float,
        "revision": int,  # of garment or other side: the page asks again when it has changed
    }
    asked: dict[str, Any] = {"start_view": None}
    for name, text in given.items():
        if name not in known:
            raise RefusedError(f"Unknown parameter {name!r:.40}; choose one of {', '.join(known)}.", 400)
        try:
            value = known[name](text)
            is_valid = math.isfinite(value)
        except (ValueError, OverflowError):
            is_valid = False
        if not is_valid:
            raise RefusedError(f"{name}: {text!r:.40} is not a valid number.", 400)
        asked[name] = value
    start = asked["start_view"]
    if start is not None and not 0 <= start < n_views:
        raise RefusedError(f"start_view: the recording has {n_views} views, none numbered {start}.", 400)
    return asked
