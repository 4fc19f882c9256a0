"""Serves the stages of :mod:`flatcloth.engine.teaching`; the work is cancelled when the client leaves.

An answer is a parcel: JSON with arrays and pictures. How far it is, the state of the page tells.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, replace
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from starlette.requests import Request
from starlette.responses import Response

from flatcloth.checking.check import CheckLesson, check_lesson
from flatcloth.core.decoding import Finite, MisfitError, fitted
from flatcloth.core.errors import FlatclothError
from flatcloth.core.parcel import Parcel
from flatcloth.core.types import MIRROR, FlattenedView, Int32, Progress, RotationAxis, Uint8
from flatcloth.engine.sheet import outline_loops
from flatcloth.engine.teaching import (
    AlignmentLesson,
    FlatteningLesson,
    GarmentLesson,
    Parameters,
    PlanningLesson,
    SidesLesson,
    StartLesson,
    Teaching,
    garment_lesson,
)
from flatcloth.flattening.borders import SPACING_M
from flatcloth.flattening.flatten import Level
from flatcloth.flattening.surface import Surface
from flatcloth.garments.recognition import MISFIT, NONE, misfit_of
from flatcloth.methods.answers import ColumnCurves, SidePlan, ZAngleLine
from flatcloth.recordings.mending import Mends
from flatcloth.rendering import layers
from flatcloth.rendering.colormaps import MAPS
from flatcloth.rendering.evidence import mistaken
from flatcloth.rendering.pictures import grid_of
from flatcloth.viewer.http import GONE, RefusedError, made_for
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol import sent
from flatcloth.viewer.protocol.picture import OtherSheet, truth_of
from flatcloth.viewer.protocol.sent import parcel_of

if TYPE_CHECKING:
    from flatcloth.validation.markers import KitTruth

CM2 = 1e4
"""Square centimetres in a square metre."""
_OFF_THE_SURFACE_ALPHA = 70
"""Opacity (of 255) of pixels off the surface. Chosen."""
_UNKNOWN_ANGLE = -128
"""Code of a pixel without an angle; angles are within 90 degrees."""

# --- Fig. 2 ----------------------------------------------------------------------------------------


def flattening_parcel(lesson: FlatteningLesson, axis: RotationAxis, truth: KitTruth | None = None) -> Parcel:
    """Return the drawing data of Fig. 2, with the error of each pixel if there is a truth."""
    flattening = lesson.flattening
    surface = flattening.surface
    view = flattening.view if truth is None else truth.with_errors(flattening.view)
    top, left = surface.frame.offset_rc
    valid = view.valid[..., None]
    arrays: dict[str, Any] = {
        "image": _image(surface),
        "triangles": flattening.triangles,
        "color": layers.rgba(view, "color", axis, 1),
        "height": layers.rgba(view, "height", axis, 1),
        "normal": _normals(view),
        "source_rc": np.where(valid, np.rint(view.source_rc - (top, left)), -1).astype(np.int16),
        "rgb": view.rgb,
        "xyz_mm": np.where(valid, np.rint(1e3 * view.xyz_m), 0).astype(np.int16),
        "normal_percent": np.where(valid, np.rint(100 * view.normal), 0).astype(np.int8),
    }
    if view.error_m is not None:
        arrays |= {"truth": layers.rgba(view, "truth", axis, 1), "error_mm": 1e3 * view.error_m}
    levels = []
    for name, level, unused in zip(("coarse", "fine"), flattening.levels, lesson.unused_pairs, strict=False):
        about, of_level = _level(level, unused)
        levels.append({"name": name, **about})
        arrays |= {f"{name}_{part}": array for part, array in of_level.items()}
    values = {
        "view_index": lesson.view_index,
        "surface_px": surface.usable.sum(),
        "pixel_pitch_mm": 1e3 * surface.pixel_pitch_m,
        "depth_mm": 1e3 * np.median(surface.xyz_m[..., 2][surface.usable]),
        "levels": levels,
        "flat": grid_of(view),
        "area_cm2": view.area_m2 * CM2,
        "parts_cm2": [c.view.area_m2 * CM2 for c in flattening.components],
        "folded_share": flattening.components[0].folded_share,
        "triangles": len(flattening.triangles),
    }
    return parcel_of(values, arrays)


def _level(level: Level, unused: Int32) -> tuple[dict[str, Any], dict[str, Any]]:
    main = np.zeros(len(level.points_rc), dtype=bool)
    main[level.state_members] = True
    # Without a pair there is nothing to minimise, and no state was recorded.
    states = level.states or (level.initial_uv_m[main],)
    about = {
        "interval_px": level.sampling_interval_px,
        "points": len(level.points_rc),
        "pairs": len(level.edges),
        "unused": len(unused),
        "mean_length_mm": 1e3 * level.edge_length_m.mean() if len(level.edges) else None,
        "main_points": main.sum(),
        "parts": level.component.max() + 1,
        "energy_mm2": [1e6 * h for h in level.energy],
        "state_iterations": list(range(len(states))),
    }
    arrays: dict[str, Any] = {
        "points_rc": level.points_rc,
        "edges": level.edges,
        "length_mm": 1e3 * level.edge_length_m,
        "unused": unused,
        "members": level.state_members,
        "states": np.array(states),
    }
    return about, arrays


def _image(surface: Surface) -> Uint8:
    """Return the part of the image around the item, pale off the surface (H, W, 4)."""
    alpha = np.where(surface.usable, 255, _OFF_THE_SURFACE_ALPHA).astype(np.uint8)
    return np.dstack([surface.frame.color, alpha])


def _normals(view: FlattenedView) -> Uint8:
    """Return the normals as colours (H, W, 4): red right, green up, blue towards the camera of view 0."""
    toward = np.nan_to_num(view.normal) * np.array([1.0, -1.0, -1.0], dtype=np.float32)
    rgb = np.rint(127.5 + 127.5 * toward).clip(0, 255).astype(np.uint8)
    return np.dstack([rgb, np.where(view.valid, 255, 0).astype(np.uint8)])


# --- the start view --------------------------------------------------------------------------------


def start_parcel(lesson: StartLesson, axis: RotationAxis, session_view: int | None) -> Parcel:
    """Return the drawing data of the choice of the start view; ``session_view`` is that of the session."""
    view = lesson.flattening.view
    values = {
        "view_index": lesson.view_index,
        "session_view": session_view,
        "flat": grid_of(view),
        "tried": [{"view": view, "part_cm2": CM2 * area_m2} for view, area_m2 in lesson.tried],
    }
    image, color = _image(lesson.flattening.surface), layers.rgba(view, "color", axis, 1)
    return parcel_of(values, {"image": image, "color": color, "area_cm2": CM2 * lesson.areas_m2})


# --- Fig. 4 ----------------------------------------------------------------------------------------


def planning_parcel(lesson: PlanningLesson, axis: RotationAxis) -> Parcel:
    """Return the drawing data of Fig. 4a."""
    view, plan = lesson.view, lesson.plan
    angle = np.where(view.valid, np.nan_to_num(np.rint(view.z_angle_deg)).clip(-127, 127), _UNKNOWN_ANGLE)
    values = {
        "view_index": lesson.view_index,
        "flat": grid_of(view),
        "z_angle_span_deg": layers.Z_ANGLE_SPAN_DEG,
        "z_angle_colors": MAPS["diverging"].table()[::4],
        "next_view": plan.view_index,
        "side": plan.side,
        "rotation_deg": plan.rotation_deg,
        "reason": plan.reason,
        "sides": [_side(s) for s in plan.sides],
    }
    arrays: dict[str, Any] = {
        "z_angle_deg": angle.astype(np.int8),
        "color": layers.rgba(view, "color", axis, 1),
        **_curves("current", plan.sides[0].curves),
        **{f"edge_{edge.value}": uv_m for edge, uv_m in lesson.edges_uv_m.items()},
    }
    return parcel_of(values, arrays)


def _side(side: SidePlan) -> dict[str, Any]:
    return {
        "side": side.side,
        "occluding_edge_mm": 1e3 * side.occluding_edge_m,
        "u_b_mm": 1e3 * side.u_b_m,
        "a_0_deg": side.a_0_deg,
        "rotation_deg": side.rotation_deg,
        "view_index": side.view_index,
        "reason": side.reason,
    }


def _curves(name: str, curves: ColumnCurves) -> dict[str, Any]:
    return {
        f"{name}_u_mm": 1e3 * curves.u_m,
        f"{name}_h": curves.column_count,
        f"{name}_a_z_deg": curves.column_mean_z_angle_deg,
    }


def alignment_parcel(lesson: AlignmentLesson, axis: RotationAxis) -> Parcel:
    """Return the drawing data of the rest of Fig. 4."""
    alignment = lesson.proposal.alignment
    views = {"current": lesson.current, "new": lesson.new, "renewed": lesson.renewed.view}
    search, first, found = lesson.search, alignment.initial_score, alignment.correspondence
    values = {
        "view_index": lesson.view_index,
        "planned_view": lesson.planned_view,
        "placed_with": lesson.placed_with,
        "side": lesson.proposal.side,
        **{name: grid_of(view) for name, view in views.items()},
        **{f"{name}_cm2": CM2 * view.area_m2 for name, view in views.items()},
        "initial": astuple(alignment.initial),
        "found": astuple(alignment.current_from_new),
        "initial_score": None if first is None else first.total,
        "score": alignment.score.total,
        "score_parts": alignment.score.parts,
        "search": {
            "turns_deg": np.degrees(search.turns_rad),
            "shifts_mm": 1e3 * search.shifts_m,
            "motions": [astuple(m) for m in search.motions],
            "tried": search.tried,
            "end_score": search.end_score,
            "start_stands": alignment.current_from_new == alignment.initial,
        },
        "lines": None
        if found is None
        else {
            "rotation_deg": found.rotation_deg,
            "common_range_deg": found.common_range_deg,
            "a_m_deg": found.a_m_deg,
            "height_mm": 1e3 * found.height_m,
            "current": _line(found.current),
            "new": _line(found.new),
        },
    }
    arrays: dict[str, Any] = {
        "image": _image(lesson.flattening.surface),
        **{f"{name}_color": layers.rgba(view, "color", axis, 1) for name, view in views.items()},
        "origin": lesson.origin,
        "cost": search.cost,
        "starts": search.starts * (180 / np.pi, 1e3, 1e3),
        "path": search.path * (180 / np.pi, 1e3, 1e3),
    }
    if found is not None:
        for name, curves, line in (
            ("current", found.current_curves, found.current),
            ("new", found.new_curves, found.new),
        ):
            arrays |= {**_curves(name, curves), f"{name}_pixels_uv": line.pixels_uv_m}
    return parcel_of(values, arrays)


def _line(line: ZAngleLine) -> dict[str, Any]:
    names = ("z_angle_deg", "center_uv_m", "direction", "point_uv_m")
    return {name: getattr(line, name) for name in names}


# --- the check of the recording, and the side of interest --------------------------------------------


def check_parcel(lesson: CheckLesson, picture: Uint8) -> Parcel:
    """Return the drawing data of a check: ``picture`` (H, W, 3) shows two views laid on each other."""
    values = {
        "view_index": lesson.first,
        "other_view": lesson.second,
        "recorded_deg": lesson.recorded_deg,
        "seen_deg": lesson.seen_deg,
        "std_deg": lesson.std_deg,
    }
    laid = np.dstack([picture, np.full(picture.shape[:2], 255, np.uint8)])
    return parcel_of(values, {"laid": laid, "turn_deg": lesson.turn_deg, "share": lesson.share})


def sides_parcel(lesson: SidesLesson) -> Parcel:
    """Return the drawing data of the side of interest."""
    found, section = lesson.found, lesson.section
    observed, view_index = found.observed, lesson.frame.view_index
    labels = found.view(view_index)
    assert labels is not None
    weight, (rows, cols) = observed.graph.weight, labels.side.shape
    values = {
        "view_index": view_index,
        "n_alike": (weight > 0).sum(),
        "n_opposite": (weight < 0).sum(),
        "samples": observed.config.samples,
        "certainty": found.mean_certainty,
        "found_cm2": CM2 * found.area_of_interest_m2,
        "undecided_cm2": CM2 * found.area_undecided_m2,
        "first": {"rows": rows, "cols": cols},
    }
    arrays: dict[str, Any] = {
        "section_mm": 1e3 * section.place_m,
        "section_normal": section.normal,
        "section_side": found.side[section.cluster],
        "alike": section.alike,
        "opposite": section.opposite,
        "first_side": labels.side,
    }
    return parcel_of(values, arrays)


# --- the garment -----------------------------------------------------------------------------------


def garment_parcel(lesson: GarmentLesson, axis: RotationAxis) -> Parcel:
    """Return the drawing data of the recognition of the garment."""
    evidence, view, best = lesson.evidence, lesson.view, lesson.fits[0]
    arrays: dict[str, Any] = {
        "edge_uv": evidence.edge_uv_m,
        "edge_normal": evidence.edge_normal,
        "edge_trust": evidence.edge_trust,
        "unseen_uv": evidence.unseen_uv_m,
        "inside_uv": evidence.inside_uv_m,
        "states": lesson.states,
        **{
            f"outline_{fit.kind.name}": fit.garment_from_piece[0].inverse().apply(fit.outline)
            for fit in lesson.fits
        },
    }
    if view is not None:
        arrays["shape"] = layers.rgba(view, "color", axis, 1)
    values = {
        "flat": None if view is None else grid_of(view),
        "area_cm2": CM2 * evidence.area_m2,
        "edges_m": SPACING_M * len(evidence.edge_uv_m),
        "unseen_m": SPACING_M * len(evidence.unseen_uv_m),
        "trust": evidence.edge_trust.mean() if len(evidence.edge_trust) else None,
        "state_shape": lesson.states.shape,
        "energy": lesson.energy,
        "widened": lesson.widened,
        "temperature": lesson.temperature,
        "kinds": [
            {
                "name": fit.kind.name,
                "below": fit.log_evidence - best.log_evidence,
                "energy": fit.energy,
                "parameters": len(fit.kind.parameters),
                "probability": lesson.probabilities[fit.kind.name],
            }
            for fit in lesson.fits
        ],
        "none": lesson.probabilities[NONE],
        "misfit": misfit_of(best, evidence),
        "misfit_limit": MISFIT,
    }
    return parcel_of(values, arrays)


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
    this, its_sheet, seams = other.this, other.sheet, other.sides.seams
    none = [np.zeros((0, 2))]
    own = [this.places(seam.this_uv_m)[1] for seam in seams]
    its = [its_sheet.places(seam.other_uv_m)[1] for seam in seams]
    arrays: dict[str, Any] = {
        "this_uv": np.concatenate([*none, *own]),
        "mirrored_uv": np.concatenate([*none, *its]) * MIRROR,
    }
    for name, sheet, mirror in (("this", this, np.ones(2)), ("other", its_sheet, MIRROR)):
        for n, loop in enumerate(outline_loops(sheet.canonical.view)):
            arrays[f"{name}_loop_{n}"] = loop * mirror
    starts = np.cumsum([0, *(len(seam.xyz_m) for seam in seams)])
    joining = [seam.residual_m for seam in seams if not seam.why]
    values = {
        "this_cm2": CM2 * this.shape_m2,
        "other_cm2": CM2 * its_sheet.shape_m2,
        "this_floating": len(this.pieces),
        "other_floating": len(its_sheet.pieces),
        "residual_mm": 1e3 * np.median(np.concatenate(joining)) if joining else None,
        "seams": [
            {"start": start, "places": len(seam.xyz_m), "why": seam.why}
            for start, seam in zip(starts, seams, strict=False)
        ],
    }
    return parcel_of(values, arrays)


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


class Asked(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The query of an address; without a parameter, that of the session is taken.

    ``revision`` is that of the garment or of the other side: the page asks again when it has changed.
    """

    start_view: int | None = None
    sampling_interval_px: int | None = None
    z_angle_limit_deg: Finite | None = None
    overlap_cm2: Finite | None = None
    revision: int | None = None

    def parameters(self, defaults: Parameters) -> Parameters:
        """Return the parameters that are meant."""
        given: dict[str, Any] = {
            "sampling_interval_px": self.sampling_interval_px,
            "z_angle_limit_deg": self.z_angle_limit_deg,
            "overlap_area_m2": None if self.overlap_cm2 is None else self.overlap_cm2 / CM2,
        }
        return replace(defaults, **{name: value for name, value in given.items() if value is not None})


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
        asked, page = self._asked(dict(request.query_params)), self._page

        def make(check: Callable[[], None]) -> bytes:
            def progress(share: float, text: str) -> None:
                check()
                page.executor.on_page(lambda: page.tell_lesson(sent.Progress(share=share, text=text)))

            progress(0.0, "Starting")
            return self._lesson(part, asked, progress)

        try:
            made = await made_for(request, page.executor, "teaching", make, "computing")
        finally:
            page.executor.on_page(lambda: page.tell_lesson(None))
        if made is None:
            return GONE
        return Response(made, media_type="application/octet-stream", headers={"Cache-Control": "no-store"})

    def _asked(self, query: dict[str, str]) -> Asked:
        """Read the parameters of an address.

        Raises
        ------
        RefusedError
            If a parameter is unknown or not a valid number.
        """
        try:
            asked = fitted(query, Asked, strict=False)
        except MisfitError as error:
            raise RefusedError(f"{error}.", 400) from error
        n_views = len(self._page.integration.recording)
        if asked.start_view is not None and not 0 <= asked.start_view < n_views:
            reason = f"the recording has {n_views} views, none numbered {asked.start_view}."
            raise RefusedError(f"start_view: {reason}", 400)
        return asked

    def _lesson(self, part: str, asked: Asked, progress: Progress) -> bytes:
        if self._teaching is None or self._teaching.views != len(self._page.integration.recording):
            self._teaching = Teaching(self._page.integration)  # of an active loop, the recording grows
        teaching, defaults = self._teaching, _plain(self._teaching.defaults)
        start = asked.start_view
        if start is None and part not in _OF_ALL_VIEWS:
            start = teaching.start_view(progress)
        parameters = asked.parameters(teaching.defaults)
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
