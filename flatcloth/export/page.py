"""A session as one HTML page without server and network: 3D and flattened view, with its timeline."""

from __future__ import annotations

import base64
import hashlib
import itertools
import json
import posixpath
import re
import zlib
from collections.abc import Callable, Mapping
from html import escape
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.core.geometry import horizontal_axes, object_from_camera, window_of
from flatcloth.core.parcel import Parcel
from flatcloth.core.resources import static_folder
from flatcloth.core.types import FlattenedView, Float64, Floats, RotationAxis, finite
from flatcloth.engine.sheet import Sheet, lay_out
from flatcloth.export.figures import LAYER_WORDS, verdict_text
from flatcloth.export.files import printed
from flatcloth.export.garment import summary
from flatcloth.export.growth import Growth
from flatcloth.export.session import OpenedSession
from flatcloth.grasping.grips import grip_numbers
from flatcloth.rendering.colormaps import piece_color
from flatcloth.rendering.drawing import data_url, webp_of
from flatcloth.rendering.layers import LAYERS, hex_of, is_known, legend, rgba
from flatcloth.rendering.pictures import grid_of
from flatcloth.session.journal import Pick

FORMAT = "flatcloth-page/1"
MOST_AROUND = 6000
"""Points per step of the camera's surroundings; more would only enlarge the page."""
AROUND_SPACING_M = 0.007
"""Distance of the points around the item in the offline page. Chosen for the size of the file."""

POINT_STEP_M = 0.0005
"""Points are rounded to this: half the unit of most depth images."""
_AROUND_STEPS = np.uint16(8)
"""Points around the item are rounded to so many times that. Chosen for the size of the file."""
_NORMAL_LEVELS = 40
"""Normals are rounded to this part of a unit vector: 1.3 degrees at most. Chosen for the file's size."""
_AROUND_COLOR_BITS = np.uint8(0xF0)
"""Bits of their colours that are kept. Chosen for the size of the file."""

_COLORS = 64
"""Colours of the layers of values, of the 256 on the operator page. Chosen for the size of the file."""

Integers = TypeVar("Integers", bound=np.integer[Any])

_IMPORT = re.compile(r'^@?import (?:(\{[^}]*\}) from )?"([^"]+)";\n', re.MULTILINE)
_COMMENT = re.compile(
    r"^[ \t]*(?:/\*(?:[^*]|\*(?!/))*\*/[ \t]*|//[^\n]*)\n|/\*\*(?:[^*\n]|\*(?!/))*\*/ ?", re.MULTILINE
)
_EXPORTED = re.compile(r"^export (?:async )?(?:const|function|class) (\w+)", re.MULTILINE)


def page(session: OpenedSession) -> str:
    """Return the page as HTML text, with all its data."""
    parcel = Parcel()
    history = _history(session, parcel)
    parts = {
        "history": printed(json.dumps(history, allow_nan=False)),
        # The highest level takes five times as long, for 2 % less. Measured.
        "arrays": base64.b64encode(zlib.compress(parcel.pack(), 7, 31)).decode("ascii"),
    }
    return filled("offline/offline", f"{session.history.header.recording.name} \u00b7 flatcloth", parts)


def filled(name: str, title: str, parts: Mapping[str, str], more_policy: str = "") -> str:
    """Return a page of ``static/`` with its title and parts filled in; no text can close its own element.

    All pages have a policy, an icon, a style sheet and a script; the module with which the script starts, and
    the style sheet, have the ``name`` of the page.
    """
    static = static_folder()
    script, style = whole(static, f"{name}.js"), whole(static, f"{name}.css")
    digests = (hashlib.sha256(text.encode()).digest() for text in (script, style))
    own_script, own_style = (f"'sha256-{base64.b64encode(digest).decode('ascii')}'" for digest in digests)
    every = {part: text.replace("<", "\\u003c") for part, text in parts.items()} | {
        "title": escape(title),
        # Only the page's own script, and no loading.
        "policy": f"default-src 'none'; script-src {own_script}; style-src {own_style}; img-src data: blob:;"
        f" base-uri 'none'; form-action 'none'{more_policy}",
        "icon": data_url((static / "icon.svg").read_bytes(), "image/svg+xml"),
        "style": style,
        "script": script,
    }
    template = (static / f"{name}.html").read_text("utf-8")
    return re.sub(r"@(\w+)@", lambda found: every[found[1]], template)


def whole(folder: Path, entry: str) -> str:
    """Return a module, or a style sheet, of a folder with all that it imports, as one text without comments.

    Each module that is imported becomes a function, called at once, that returns what the module exports.

    Raises
    ------
    FlatclothError
        If one of them cannot be read; the message names it.
    """
    found: dict[str, str] = {}

    def add(name: str) -> None:
        if name in found:
            return
        with os_errors_as(FlatclothError, f"{folder / name}: cannot be read", "Reinstall flatcloth."):
            source = _COMMENT.sub("", (folder / name).read_text("utf-8"))
        of = {way: posixpath.normpath(f"{name}/../{way}") for _, way in _IMPORT.findall(source)}
        for each in of.values():
            add(each)
        exports = ", ".join(_EXPORTED.findall(source))
        source = _EXPORTED.sub(lambda got: got[0].removeprefix("export "), source)
        for imported, way in _IMPORT.findall(source):
            names = f'const {imported.replace(" as ", ": ")} = modules["{of[way]}"];\n' if imported else ""
            source = _IMPORT.sub(names, source, count=1)
        if name.endswith(".js") and name != entry:
            source = f'modules["{name}"] = (() => {{\n{source}return {{ {exports} }};\n}})();\n'
        found[name] = source

    add(entry)
    return ("const modules = {};\n" if entry.endswith(".js") else "") + "".join(found.values())


def _history(session: OpenedSession, parcel: Parcel) -> dict[str, Any]:
    history, growth, integration = session.history, session.growth, session.integration
    view, axis, recording = growth.view, integration.axis, integration.recording
    garment, sides = session.data.garment, session.data.joined
    around, around_rgb = _around(session)
    every = np.concatenate([view.xyz_m[growth.first_step >= 0].astype(np.float64), *around])
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    step_m = float(max((high - low).max() / 65535, POINT_STEP_M))

    def levels(xyz_m: Floats) -> NDArray[np.uint16]:  # integer steps: finer than any sensor, half the size
        return np.asarray(np.rint((xyz_m - low) / step_m).clip(0, 65535), dtype=np.uint16)

    this = _side(session, parcel, growth.sheet, growth.first_step, growth.source_step, levels)
    coarse = _AROUND_STEPS * (levels(np.concatenate(around)) // _AROUND_STEPS)
    parcel.array("around_xyz", differences(coarse))
    parcel.array("around_rgb", differences(np.concatenate(around_rgb) & _AROUND_COLOR_BITS))
    starts = np.cumsum([0, *(len(points) for points in around)]).tolist()
    shown_low, shown_high = np.nanpercentile(every, 0.5, axis=0), np.nanpercentile(every, 99.5, axis=0)
    along = (every - axis.point_m) @ axis.direction
    ends = np.nanmin(along) - 0.05, np.nanmax(along) + 0.05
    other = None
    if sides is not None:  # as seen from its own outside
        sheet = lay_out(sides.other)
        first = np.where(sheet.view.valid, 0, -1).astype(np.int16)
        other = _side(session, parcel, sheet, first, sheet.view.view_index, levels, "other ")
        other |= {"is_related": sides.is_related, "area_cm2": 1e4 * sides.other.view.area_m2}
    return {
        "format": FORMAT,
        "recording": {
            "name": history.header.recording.name,
            "description": recording.description,
            "angles_deg": list(recording.angles_deg),
        },
        "method": history.header.method,
        "finished": history.document.finished,
        **this,
        "bounds": {"low": low.tolist(), "step": step_m},
        "extent": {"low": shown_low.tolist(), "high": shown_high.tolist()},
        "half_extents_m": _half_extents_m(every, (shown_low + shown_high) / 2, axis),
        "axis": {
            "direction": axis.direction.tolist(),
            "across": [across.tolist() for across in horizontal_axes(axis)],
            "line": [(axis.point_m + end * axis.direction).tolist() for end in ends],
        },
        "around_spacing_m": AROUND_SPACING_M,
        "around": [{"start": a, "count": b - a} for a, b in itertools.pairwise(starts)],
        "steps": _steps(growth, axis),
        "decisions": _decisions(session),
        "picks": [_pick(session, pick) for pick in history.picks],
        "garment": {"text": garment, "found": None}
        if isinstance(garment, str)
        else {"text": "", "found": summary(garment)},
        "other": other,
    }


def _side(
    session: OpenedSession,
    parcel: Parcel,
    sheet: Sheet,
    first: NDArray[np.int16],
    source: NDArray[np.int16],
    levels: Callable[[Floats], NDArray[np.uint16]],
    prefix: str = "",
) -> dict[str, Any]:
    """Return a side, and put its pixels into the parcel, each name with a prefix.

    ``first`` (H, W) is the step of each pixel, -1 off the cloth, ``source`` the step whose view it shows.
    """
    view = sheet.view
    window = window_of(view.valid) or np.s_[0:0, 0:0]
    cloth, corner = first[window] >= 0, [window[0].start, window[1].start]
    parcel.array(f"{prefix}first", first[window].ravel())
    parcel.array(f"{prefix}source", source[window].ravel())
    xyz = view.xyz_m[window][cloth].astype(np.float64)
    parcel.array(f"{prefix}xyz", differences(levels(xyz)))
    normals = np.rint(_NORMAL_LEVELS * np.nan_to_num(view.normal[window][cloth])).astype(np.int8)
    parcel.array(f"{prefix}normal", differences(normals))
    source_rc = np.clip(np.rint(view.source_rc[window][cloth]), 0, 65535)
    parcel.array(f"{prefix}source_rc", differences(source_rc.astype(np.uint16)))
    return {
        "count": len(xyz),
        "grid": {
            **grid_of(view),
            "rows": window[0].stop - corner[0],
            "cols": window[1].stop - corner[1],
            "origin_uv_m": view.uv_from_rc(np.array(corner)).tolist(),
            "corner_rc": corner,
        },
        "pieces": pieces_of(sheet),
        "layers": _layers(session, parcel, view, window, prefix),
    }


def pieces_of(sheet: Sheet) -> list[dict[str, Any]]:
    """Return the floating pieces of a side, for the pages."""
    pieces = []
    for n, piece in enumerate(sheet.pieces, start=1):
        about = {"label": piece.label, "reason": piece.reason, "placed": piece.placed is not None}
        shown = {"color": hex_of(piece_color(n)), "grid": grid_of(piece.view)}
        pieces.append({**about, "area_cm2": 1e4 * piece.view.area_m2, **shown})
    return pieces


def differences(values: NDArray[Integers]) -> NDArray[Integers]:
    """Return an array (N, C) as the differences (C, N) of each row from the one before, which zip better.

    They wrap around at the limits of the type, as do the sums that restore the values.
    """
    columns = values.T
    return np.diff(columns, axis=1, prepend=np.zeros((len(columns), 1), dtype=columns.dtype))


def _around(session: OpenedSession) -> tuple[list[Float64], list[NDArray[np.uint8]]]:
    """Return for each step the rest of its view, reduced to about one point per cube of the spacing."""
    points, colors = [], []
    for step in session.growth.steps:
        cloud = session.integration.views.cloud(step.view_index)
        cell = np.floor(cloud.xyz_m / AROUND_SPACING_M).astype(np.int64)
        cell -= cell.min(axis=0, initial=0)
        number = np.ravel_multi_index(tuple(cell.T), tuple(cell.max(axis=0, initial=0) + 1))
        _, kept = np.unique(number, return_index=True)
        if len(kept) > MOST_AROUND:
            kept = kept[np.linspace(0, len(kept) - 1, MOST_AROUND).astype(np.intp)]
        points.append(cloud.xyz_m[kept].astype(np.float64))
        colors.append(cloud.rgb[kept])
    return points, colors


def _half_extents_m(xyz: Float64, center: Float64, axis: RotationAxis) -> list[float]:
    """Return the extent of the item from its centre: across the axis (all around), and along it."""
    offset = xyz - center
    along = offset @ axis.direction
    across = np.linalg.norm(offset - along[:, None] * axis.direction, axis=1)
    return [float(np.nanpercentile(across, 99.5)), float(np.nanpercentile(np.abs(along), 99.5))]


def _steps(growth: Growth, axis: RotationAxis) -> list[dict[str, Any]]:
    return [
        {
            "order": step.order,
            "view_index": step.view_index,
            "angle_deg": step.angle_deg,
            "area_cm2": 1e4 * step.area_m2,
            "floating_cm2": 1e4 * step.floating_m2,
            "added_cm2": 1e4 * step.added_m2,
            "told": "the start view" if step.decision is None else verdict_text(step.decision),
            "camera_m": object_from_camera(axis, step.angle_deg).translation_m.tolist(),
        }
        for step in growth.steps
    ]


def _decisions(session: OpenedSession) -> list[dict[str, Any]]:
    angles_deg = session.integration.recording.angles_deg
    steps = {step.decision.number: step.order for step in session.growth.steps if step.decision is not None}
    return [
        {
            "view_index": decision.view_index,
            "angle_deg": angles_deg[decision.view_index],
            "verdict": decision.verdict,
            "told": verdict_text(decision),
            "stands": decision.stands,
            "step": steps.get(decision.number),
        }
        for decision in session.history.decisions
    ]


def _pick(session: OpenedSession, pick: Pick) -> dict[str, Any]:
    view, rc = session.view_of(pick.side), session.pixel_of(pick)
    placed = None if view is None or rc is None else (view.uv_from_rc(np.array(rc)), view.z_angle_deg[rc])
    return {
        "id": pick.id,
        "name": pick.name,
        "side": pick.side,
        "rc": rc,
        "uv_m": placed and placed[0].tolist(),
        "miss_m": 0.0,
        "position_held_m": [finite(x) for x in pick.position_held_m.tolist()],
        "normal_held": [finite(x) for x in pick.normal_held.tolist()],
        "z_angle_deg": placed and finite(float(placed[1])),
        "view_index": pick.view_index,
        "source_rc": [finite(x) for x in pick.source_rc],
        "grip": grip_numbers(session.pose_of(pick)),
    }


def _layers(
    session: OpenedSession, parcel: Parcel, view: FlattenedView, window: tuple[slice, slice], prefix: str
) -> list[dict[str, Any]]:
    integration = session.integration
    angles_deg = integration.recording.angles_deg
    made = []
    for name in LAYERS:
        if not is_known(view, name, integration.axis):
            continue
        image = rgba(view, name, integration.axis, len(angles_deg), colors=_COLORS)[window]
        parcel.picture(f"{prefix}layer {name}", webp_of(image), image.shape[:2], "webp")
        title, about = LAYER_WORDS[name]
        made.append(
            {
                "name": name,
                "title": title,
                "about": about,
                "legend": legend(view, name, integration.axis, angles_deg),
            }
        )
    return made
