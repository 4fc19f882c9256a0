"""Whether results are right in a cell: a recording of a kit against the kit, in figures and in sentences.

Errors of the cell itself follow from markers alone: :mod:`flatcloth.validation.adjustment`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.api.integrating import Sides, integrate
from flatcloth.core.types import FlattenedView, Float64, Progress, RotationAxis, no_progress
from flatcloth.engine.evaluation import relative_errors_m
from flatcloth.export.figures import Figure, map_drawing
from flatcloth.export.files import write_file
from flatcloth.export.report import page_of, table_html
from flatcloth.recordings.base import Recording
from flatcloth.rendering.drawing import add_ramp
from flatcloth.rendering.layers import legend, rgba
from flatcloth.rendering.pictures import cropped
from flatcloth.validation.adjustment import adjusted
from flatcloth.validation.kit import Kit, KitError, lengths
from flatcloth.validation.markers import KitTruth, Sightings, sightings_of

_LEAST_PIXELS = 50
"""Pieces of which markers show fewer pixels are not judged. Chosen: about a square centimetre."""
_STEP_DEG = 20
"""Width of the ranges of incidence of which depth is told. Chosen."""


@dataclass(frozen=True)
class Validation:
    """What a recording of a kit shows: a ``document`` for JSON, and the ``shape``, a view for each piece."""

    document: dict[str, Any]
    seen: Sightings
    truth: KitTruth
    axis: RotationAxis
    shape: dict[str, FlattenedView]

    def write(self, folder: Path | None, shared: Path | None) -> list[str]:
        """Write page and document to a folder, and what others may have to a file; say what is written."""
        others = {key: value for key, value in self.document.items() if key not in ("recording", "lines")}
        files = {shared: json.dumps(others, indent=1) + "\n"} if shared else {}
        if folder:
            files[folder / "validation.html"] = page_of("Is it right in this cell?", self.page())
            files[folder / "validation.json"] = json.dumps(self.document, indent=1) + "\n"
        for file, text in files.items():
            write_file(file, text.encode())
        return [f"Written: {', '.join(map(str, files))}"] if files else []

    def page(self) -> Iterator[str]:
        """Yield sentences, pictures of where each piece is off, and the tables, as HTML."""
        yield "<h1>Is it right in this cell?</h1>"
        yield from (f"<p>{escape(line)}</p>" for line in self.document["lines"])
        for name, flat in self.shape.items():
            view = self.truth.with_errors(flat)
            drawing, axes = map_drawing(cropped(rgba(view, "truth", self.axis, 1), view), name)
            about = legend(view, "truth", self.axis, ())
            add_ramp(axes, about["title"], about["colors"], about["low"], about["high"])
            yield f"<figure>{Figure(name=name, caption=name, drawing=drawing).svg()}</figure>"
        for name, rows in ((n, self.document[n.lower()]) for n in ("Errors", "Depth", "Pieces", "Views")):
            cells = [[v if isinstance(v, str) else f"{v:.3g}" for v in row.values()] for row in rows]
            yield f"<h2>{name}</h2>" + table_html([k.replace("_", " ") for k in next(iter(rows), {})], cells)


def validate(
    recording: Recording,
    kit: Kit,
    *,
    method: str | None = None,
    sides: Sides = "both",
    within_mm: float = 10.0,
    progress: Progress = no_progress,
) -> Validation:
    """Integrate a recording of a kit as :func:`flatcloth.integrate` does, and compare it with the kit.

    ``within_mm`` is asked of 95 % of the cloth. ``FlatclothError`` says what is missing, also if markers are.
    """
    seen = sightings_of(recording, kit, progress)
    shape = integrate(recording, method=method, sides=sides, progress=progress)
    axis = recording.rotation_axis or shape.axis
    errors, moved_px = adjusted(seen, kit, axis, recording.held_point_m, recording.angles_deg)
    seen = replace(seen, corners_px=seen.corners_px - moved_px)
    views = {"this side": shape.view} | ({"other side": shape.other} if shape.other is not None else {})
    for side, its_pieces in (("this side", shape.pieces), ("other side", shape.other_pieces)):
        views |= {f"{side}, piece {n}": view for n, view in enumerate(its_pieces, start=1)}
    truth = KitTruth(kit, seen.of_view)
    shares: dict[str, float] = {}
    pieces, pixels, every_mm = [], [], []
    for name, view in views.items():
        known, flat_m, true_m = truth.compared(view)
        shares[name] = float(known.sum() / view.valid.sum())
        if known.sum() >= _LEAST_PIXELS:
            error_mm = 1e3 * np.linalg.norm(flat_m - true_m, axis=1)
            std_mm = np.nan if view.placement_std_m is None else 1e3 * view.placement_std_m[known]
            pixels.append(np.column_stack(np.broadcast_arrays(error_mm, std_mm, view.view_index[known])))
            # Errors vary slowly over the cloth: what is not shown counts as wrong as the nearest that is.
            every_mm.append(error_mm[cKDTree(np.argwhere(known)).query(np.argwhere(view.valid))[1]])
            pieces.append(_piece(name, every_mm[-1], error_mm, flat_m, true_m))
    if not pieces:
        raise KitError(f"{recording.location}: no marker lies in the shape; flatcloth run says what does.")
    error_mm, std_mm, source = np.concatenate(pixels).T
    own = error_mm[std_mm >= 0] <= 3 * std_mm[std_mm >= 0] + 1  # those of pieces that float are not known
    figures = _figures(np.concatenate(every_mm)) | _figures(error_mm, "shown_")
    document = {
        "format": "flatcloth-validation/1",
        "recording": recording.name,
        "kit": kit.name,
        "sensor": None,  # for the user to fill in
        "camera": asdict(recording.intrinsics),
        "distance_m": float(np.nanmedian(seen.corners_m[..., 2])),
        "method": shape.data.integration.method,
        "markers": {"of_kit": len(kit.corners_m), "seen": len({*seen.marker}), "sightings": len(seen.marker)},
        "within_mm": within_mm,
        "is_within": figures["p95_mm"] <= within_mm,
        "shape": {
            **figures,
            "within_3_std_share": float(own.mean()) if len(own) else None,
            "shown": {name: share for name, share in shares.items() if "," not in name},
        },
        "pieces": pieces,
        "views": [
            {"view": n, "angle_deg": recording.angles_deg[n], "markers": len(seen.of_view(n))}
            | _figures(error_mm[source == n])
            for n in np.unique(source).astype(int).tolist()
        ],
        "depth": depth_by_incidence(seen, kit),
        "errors": errors,
    }
    judged = {piece["piece"]: views[piece["piece"]] for piece in pieces}
    return Validation(document | {"lines": _lines(document)}, seen, truth, axis, judged)


def _figures(error_mm: Float64, of: str = "") -> dict[str, float]:
    median_mm, p95_mm = np.percentile(error_mm, (50, 95)).tolist()
    return {f"{of}median_mm": median_mm, f"{of}p95_mm": p95_mm}


def _piece(name: str, all_mm: Float64, shown_mm: Float64, flat_m: Float64, true_m: Float64) -> dict[str, Any]:
    """Return the figures of a piece; ``longer_percent`` is how much too long it is as a whole."""
    relative_mm = 1e3 * relative_errors_m(flat_m, true_m, np.random.default_rng(0))
    longer = 100 * float(flat_m.std(axis=0).sum() / true_m.std(axis=0).sum() - 1.0)
    absolute = _figures(all_mm) | _figures(shown_mm, "shown_")
    return {"piece": name} | absolute | _figures(relative_mm, "relative_") | {"longer_percent": longer}


def _lines(document: dict[str, Any]) -> list[str]:
    shape, markers, errors = document["shape"], document["markers"], document["errors"]
    asked = "as asked" if document["is_within"] else f"not the {document['within_mm']:g} mm that are asked"
    own = shape["within_3_std_share"]
    shown = ", ".join(f"{name} to {100 * share:.0f} %" for name, share in shape["shown"].items())
    rest = [f"{e['named_from']:.1f} {e['unit']} ({e['name']})" for e in errors if not e["is_fault"]]
    other = f"No other error of the cell is seen; one of {', '.join(rest)} or more would be named."
    return [
        f"{document['recording']}: {markers['seen']} of {markers['of_kit']} markers, kit {document['kit']}.",
        f"In this cell 95 % of the cloth is within {shape['p95_mm']:.1f} mm of its place, half of it within "
        f"{shape['median_mm']:.1f} mm: {asked}. Markers show {shown} (within {shape['shown_p95_mm']:.1f} and "
        f"{shape['shown_median_mm']:.1f} mm); the rest counts as wrong as the nearest that they show.",
        *([] if own is None else [f"{100 * own:.1f} % of the cloth is within three of its own deviations."]),
        *(error["text"] for error in errors if error["is_fault"]),
        *([other] if rest else [] if errors else ["Markers show too little of camera, axis and angles."]),
    ]


def depth_by_incidence(seen: Sightings, kit: Kit) -> list[dict[str, Any]]:
    """Return noise and lengths of depth inside markers, by the angle between line of sight and normal.

    ``longer_percent`` is the median by which sides of markers are too long; bent ones are too short.
    """
    longer = lengths(seen.corners_m)[:, :4].mean(axis=1) / kit.side_m - 1
    step = np.degrees(np.arccos(seen.cosine)) // _STEP_DEG
    return [
        {
            "incidence_deg": f"{_STEP_DEG * n} to {_STEP_DEG * (n + 1)}",
            "noise_mm": 1e3 * float(np.median(seen.noise_m[step == n])),
            "longer_percent": 100 * float(np.median(longer[step == n])),
        }
        for n in np.unique(step[np.isfinite(step)]).astype(int).tolist()
    ]
