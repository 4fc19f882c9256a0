"""Serves the stages of :mod:`flatcloth.engine.teaching`; the work is cancelled when the client leaves.

An answer is a parcel: JSON with arrays and pictures. How far it is, the state of the page tells.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, astuple, replace
from typing import Any

import msgspec
import numpy as np
from starlette.requests import Request
from starlette.responses import Response

from flatcloth.checking.check import check_lesson
from flatcloth.core.decoding import Finite, MisfitError, fitted
from flatcloth.core.parcel import Parcel
from flatcloth.core.types import Progress, RotationAxis, Uint8
from flatcloth.engine.garment import KnownGarment
from flatcloth.engine.teaching import AlignmentLesson, Parameters, Teaching, edge_uv_m, followed, unused_pairs
from flatcloth.flattening.borders import SPACING_M
from flatcloth.flattening.flatten import Flattening, Level
from flatcloth.flattening.surface import Surface
from flatcloth.garments.example import half_seen_tshirt
from flatcloth.garments.fit import TEMPERATURE
from flatcloth.garments.recognition import NONE, fits_of, probabilities_by
from flatcloth.methods.answers import Plan
from flatcloth.methods.base import Views
from flatcloth.methods.starting import components_by_area
from flatcloth.recordings.mending import Mends
from flatcloth.rendering import layers
from flatcloth.rendering.colormaps import color_table
from flatcloth.rendering.evidence import mistaken
from flatcloth.rendering.pictures import grid_of
from flatcloth.segmentation.explanation import Slice
from flatcloth.segmentation.result import Segmentation
from flatcloth.session.document import Document, Side
from flatcloth.viewer.http import RefusedError, made_for
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol import sent
from flatcloth.viewer.protocol.sent import parcel_of

CM2 = 1e4
"""Square centimetres in a square metre."""
_OFF_THE_SURFACE_ALPHA = 70
"""Opacity (of 255) of pixels off the surface. Chosen."""
_UNKNOWN_ANGLE = -128
"""Code of a pixel without an angle; angles are within 90 degrees."""
_MISTAKES = {
    "turned back": Mends(reverse=True),
    "twice as far": Mends(angle_factor=2.0),
    "longer lens": Mends(focal_factor=1.3),
}
"""Mistakes of a recording that are shown beside it as it is."""

# --- the paper: Fig. 2, the start view, Fig. 4 ------------------------------------------------------


def flattening_parcel(flattening: Flattening, axis: RotationAxis) -> Parcel:
    """Return the drawing data of Fig. 2."""
    surface, view = flattening.surface, flattening.view
    coarse, fine = flattening.levels[0], flattening.levels[-1]
    values = {
        "view_index": surface.frame.view_index,
        "pixel_pitch_mm": 1e3 * surface.pixel_pitch_m,
        "flat": grid_of(view),
        "area_cm2": view.area_m2 * CM2,
        "folded_share": flattening.components[0].folded_share,
    }
    arrays: dict[str, Any] = {
        "image": _image(surface),
        "color": layers.rgba(view, "color", axis, 1),
        "xyz_mm": np.where(view.valid[..., None], np.rint(1e3 * view.xyz_m), 0).astype(np.int16),
        "samples_xy": coarse.points_rc[:, ::-1],
        "pairs": coarse.edges,
        "length_mm": 1e3 * coarse.edge_length_m,
        "unused_pairs": unused_pairs(coarse),
        "triangles": flattening.triangles,
        "corners_uv": fine.uv_m,
        "corners_xy": fine.points_rc[:, ::-1],
    }
    for n, level in enumerate(flattening.levels):
        arrays |= {f"{name}_{n}": array for name, array in _course(level).items()}
    return parcel_of(values, arrays)


def _course(level: Level) -> dict[str, Any]:
    """Return the states of the largest component with its pairs, and the energy of each state."""
    place = np.full(len(level.points_rc), -1)
    place[level.state_members] = np.arange(len(level.state_members))
    pairs = place[level.edges]
    own = (pairs >= 0).all(axis=1)
    # Without a pair there is nothing to minimise, and no state was recorded.
    states = level.states or (level.initial_uv_m[level.state_members],)
    return {
        "states": np.array(states),
        "state_pairs": pairs[own],
        "state_length": level.edge_length_m[own],
        "energy_mm2": 1e6 * np.array(level.energy),
    }


def _image(surface: Surface) -> Uint8:
    """Return the part of the image around the item, pale off the surface (H, W, 4)."""
    alpha = np.where(surface.usable, 255, _OFF_THE_SURFACE_ALPHA).astype(np.uint8)
    return np.dstack([surface.frame.color, alpha])


def start_parcel(views: Views, chosen: int, progress: Progress) -> Parcel:
    """Return the drawing data of the choice of the start view: what each view shows, and those tried."""
    flattening = views.flattening(chosen)
    tried = components_by_area(views, progress)
    values = {
        "view_index": chosen,
        "flat": grid_of(flattening.view),
        "tried": [{"view": view, "part_cm2": CM2 * area_m2} for view, area_m2 in tried],
    }
    color = layers.rgba(flattening.view, "color", views.axis, 1)
    areas = CM2 * views.observed_areas_m2(progress)
    return parcel_of(values, {"image": _image(flattening.surface), "color": color, "area_cm2": areas})


def planning_parcel(flattening: Flattening, plan: Plan) -> Parcel:
    """Return the drawing data of Fig. 4a: Z-angles, curves, occluding edges and the rotation."""
    view = flattening.view
    angle = np.where(view.valid, np.nan_to_num(np.rint(view.z_angle_deg)).clip(-127, 127), _UNKNOWN_ANGLE)
    values = {
        "flat": grid_of(view),
        "z_angle_span_deg": layers.Z_ANGLE_SPAN_DEG,
        "z_angle_colors": color_table("diverging")[::4],
        "plan": plan,
    }
    edges = {f"edge_{side.value}": edge_uv_m(flattening, side) for side in Side}
    return parcel_of(values, {"z_angle_deg": angle.astype(np.int8), **edges})


def alignment_parcel(lesson: AlignmentLesson, axis: RotationAxis, planned: int | None) -> Parcel:
    """Return the drawing data of the rest of Fig. 4; the ``planned`` view may not have been aligned."""
    alignment = lesson.alignment
    views = {"current": lesson.current, "new": lesson.new, "renewed": lesson.renewed.view}
    values = {
        "view_index": lesson.view_index,
        "planned_view": planned,
        **{name: grid_of(view) for name, view in views.items()},
        **{f"{name}_cm2": CM2 * view.area_m2 for name, view in views.items()},
        "initial_score": alignment.initial_score,
        "start_stands": alignment.current_from_new == alignment.initial,
        "search": lesson.search,
        "motions": [astuple(motion) for motion in lesson.search.motions],
        "lines": alignment.correspondence,
    }
    arrays: dict[str, Any] = {
        "image": _image(lesson.flattening.surface),
        **{f"{name}_color": layers.rgba(view, "color", axis, 1) for name, view in views.items()},
        "origin": lesson.origin,
    }
    return parcel_of(values, arrays)


# --- beyond the paper ------------------------------------------------------------------------------


def sides_parcel(found: Segmentation, section: Slice) -> Parcel:
    """Return the drawing data of the sides: the start view as recorded, and a slice of the evidence."""
    observed = found.observed
    labels = found.view(observed.start_view)
    assert labels is not None
    weight, (rows, cols) = observed.graph.weight, labels.side.shape
    values = {
        "view_index": observed.start_view,
        "n_alike": (weight > 0).sum(),
        "n_opposite": (weight < 0).sum(),
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


def garment_parcel(known: KnownGarment | None, axis: RotationAxis, progress: Progress) -> Parcel:
    """Return the drawing data of the recognition of a known garment, or of an example."""
    evidence = half_seen_tshirt() if known is None else known.evidence[0]
    progress(0.1, "fitting every kind")
    fits = fits_of(evidence)
    temperature = TEMPERATURE if known is None else known.by_evidence.temperature
    probabilities = probabilities_by(fits, evidence, temperature)
    progress(0.7, "following the fits")
    states, energy = followed(fits[0], evidence)
    values = {
        "flat": None if known is None else grid_of(known.canonical.view),
        "edges_m": SPACING_M * len(evidence.edge_uv_m),
        "energy": energy,
        "kinds": [
            {
                "name": fit.kind.name,
                "below": fit.log_evidence - fits[0].log_evidence,
                "probability": probabilities[fit.kind.name],
            }
            for fit in fits
        ],
        "none": probabilities[NONE],
    }
    arrays: dict[str, Any] = {
        "edge_uv": evidence.edge_uv_m,
        "edge_trust": evidence.edge_trust,
        "unseen_uv": evidence.unseen_uv_m,
        "inside_uv": evidence.inside_uv_m,
        "states": states,
    }
    if known is not None:
        arrays["shape"] = layers.rgba(known.canonical.view, "color", axis, 1)
    return parcel_of(values, arrays)


# --- the question ----------------------------------------------------------------------------------

OF_ONE_VIEW = ("flattening", "planning", "alignment")
"""Parts that begin with a start view and follow the parameters: Fig. 2, Fig. 4a, the rest of Fig. 4."""
PARTS = (*OF_ONE_VIEW, "start", "sides", "garment", "check")
"""The parts; those of all views: the start view, the side of interest, the garment, the check."""


class Asked(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The query of an address; without a parameter, that of the session is taken.

    ``revision`` is that of the garment: the page asks again when it has changed.
    """

    start_view: int | None = None
    sampling_interval_px: int | None = None
    z_angle_limit_deg: Finite | None = None
    overlap_cm2: Finite | None = None
    revision: int | None = None

    def parameters(self, defaults: Parameters) -> Parameters:
        """Return the parameters that are meant."""
        given = {name: getattr(self, name) for name in asdict(defaults)}
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
        try:
            asked = fitted(dict(request.query_params), Asked, strict=False)
        except MisfitError as error:
            raise RefusedError(f"{error}.", 400) from error
        page, n_views = self._page, len(self._page.integration.recording)
        if not 0 <= (asked.start_view or 0) < n_views:
            raise RefusedError(f"The recording has {n_views} views, none numbered {asked.start_view}.", 400)

        def make(check: Callable[[], None]) -> bytes:
            def progress(share: float, text: str) -> None:
                check()
                page.executor.on_page(lambda: page.tell_lesson(sent.Progress(share=share, text=text)))

            progress(0.0, "Starting")
            return self._lesson(part, asked, progress)

        try:
            made = await made_for(request, page.executor, "lesson", make, "computing")
        finally:
            page.executor.on_page(lambda: page.tell_lesson(None))
        return Response(made, media_type="application/octet-stream", headers={"Cache-Control": "no-store"})

    def _lesson(self, part: str, asked: Asked, progress: Progress) -> bytes:
        integration = self._page.integration
        axis, recording = integration.axis, integration.recording
        if self._teaching is None or self._teaching.views != len(recording):
            self._teaching = Teaching(integration)  # of an active loop, the recording grows
        teaching, view = self._teaching, asked.start_view or 0
        if asked.start_view is None and part in OF_ONE_VIEW:
            view = teaching.start_view(progress)
        parameters = asked.parameters(teaching.defaults)
        paper = teaching.paper(parameters)
        match part:
            case "flattening" | "planning":
                progress(0.1, f"flattening view {view}")
                flattening = paper.views.flattening(view)
                if part == "flattening":
                    parcel = flattening_parcel(flattening, axis)
                else:
                    parcel = planning_parcel(flattening, paper.plan(Document(start_view=view)))
            case "alignment":
                lesson = teaching.alignment(view, parameters, progress)
                planned = paper.plan(Document(start_view=view)).view_index
                parcel = alignment_parcel(lesson, axis, planned)
            case "start":
                parcel = start_parcel(paper.views, teaching.start_view(progress), progress)
            case "sides":
                parcel = sides_parcel(*teaching.sides(progress))
            case "garment":
                parcel = garment_parcel(self._page.garments.last, axis, progress)
            case _:
                checked = check_lesson(recording, integration.views.recorded, axis)
                picture = mistaken(recording, (checked.first, checked.second), _MISTAKES)
                opaque = np.full(picture.shape[:2], 255, np.uint8)
                parcel = parcel_of(checked, {"laid": np.dstack([picture, opaque])})
        used = {"parameters": asdict(parameters), "defaults": asdict(teaching.defaults)}
        return parcel.pack({**used, "start_view": view, "angles_deg": list(recording.angles_deg)})
