"""Whether results are right in a cell: a recording of a kit against the kit, in figures and in sentences.

Errors of the cell itself follow from markers alone: :mod:`flatcloth.validation.adjustment`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from flatcloth import __version__
from flatcloth.api.integrating import Sides, integrate
from flatcloth.core.types import FlattenedView, Float64, Progress, RotationAxis, no_progress
from flatcloth.engine.evaluation import relative_errors_m
from flatcloth.export.figures import Figure, map_drawing
from flatcloth.export.files import write_text
from flatcloth.export.report import page_of, table_html
from flatcloth.recordings.base import Recording
from flatcloth.rendering.drawing import add_ramp
from flatcloth.rendering.layers import legend, rgba
from flatcloth.rendering.pictures import cropped
from flatcloth.validation.adjustment import Adjustment, adjusted
from flatcloth.validation.kit import Kit, KitError
from flatcloth.validation.markers import KitTruth, Sightings, sightings_of

_LEAST_PIXELS = 50
"""Pieces of which markers show fewer pixels are not judged. Chosen: about a square centimetre."""
_SURE = 3.0
"""Errors within so many deviations are none. Chosen."""
_SHARED_STD = 0.003
"""Deviation of focal length and depth that the sightings share, as folds are smoothed: right cells are off by
.2 to .5 %. Measured by ``python -m benchmarks validation``."""
_SCORINGS = 50
"""Chosen: more change nothing."""
_STEP_DEG = 20
"""Width of the ranges of incidence of which depth is told. Chosen."""
_FAULTS = {
    "depth": ("%", 1.0, "Depth is off by {:+.1f} %: --depth-factor {:.3f} mends it."),
    "focal length": ("%", 1.0, "The focal length is off by {:+.1f} %: --focal-factor {:.4f} mends it."),
    "axis": ("mm", 2.0, "The turning axis is {:.1f} mm off: --estimate-axis mends it."),
    "angles": ("deg", 0.3, "The angles of views are {:.1f} degrees off, root mean square."),
    "sway": ("mm", 2.0, "The lowest marker sways by {:.1f} mm from view to view, root mean square."),
}
"""Unit, the size from which on it matters, the sentence. Sizes are chosen: each moves cloth by about 2 mm."""


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
            write_text(file, text)
        return [f"Written: {', '.join(map(str, files))}"] if files else []

    def page(self) -> Iterator[str]:
        """Yield sentences, pictures of where each piece is off, and the tables, as HTML."""
        yield "<h1>Is it right in this cell?</h1>"
        yield from (f"<p>{escape(line)}</p>" for line in self.document["lines"])
        for name, flat in self.shape.items():
            view = self.truth.with_errors(flat)
            for layer in ("color", "truth"):
                drawing, axes = map_drawing(cropped(rgba(view, layer, self.axis, 1), view), name)
                if (about := legend(view, layer, self.axis, ()))["kind"] == "ramp":
                    add_ramp(axes, about["title"], about["colors"], about["low"], about["high"])
                yield f"<figure>{Figure(name=name, caption=name, drawing=drawing).svg()}</figure>"
        form = "{size:.2f} \u00b1 {std:.2f} {unit}"
        errors = [(error["name"], form.format(**error)) for error in self.document["errors"]]
        yield table_html(("error of the cell", "size, one standard deviation"), errors)
        for rows in (self.document[name] for name in ("depth", "pieces", "views")):
            cells = [[v if isinstance(v, str) else f"{v:.3g}" for v in row.values()] for row in rows]
            yield table_html([name.replace("_", " ") for name in next(iter(rows), {})], cells)


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
    if cell := adjusted(seen, kit, axis, recording.held_point_m, recording.angles_deg):
        seen = replace(seen, corners_px=seen.corners_px - cell.moved_px)
    views = {"this side": shape.view} | ({"other side": shape.other} if shape.other is not None else {})
    for side, its_pieces in (("this side", shape.pieces), ("other side", shape.other_pieces)):
        views |= {f"{side}, piece {n}": view for n, view in enumerate(its_pieces, start=1)}
    truth = KitTruth(kit, seen.of_view)
    compared = {name: truth.compared(view) for name, view in views.items()}
    views = {name: view for name, view in views.items() if compared[name][0].sum() >= _LEAST_PIXELS}
    if not views:
        raise KitError(f"{recording.location}: no marker lies in the shape; flatcloth run says what does.")
    pieces, pixels = [_piece(name, *compared[name][1:]) for name in views], []
    for name, view in views.items():
        known, flat_m, true_m = compared[name]
        std_m = np.nan if view.placement_std_m is None else view.placement_std_m[known]
        off_m = np.linalg.norm(flat_m - true_m, axis=1)
        pixels.append(np.column_stack(np.broadcast_arrays(1e3 * off_m, 1e3 * std_m, view.view_index[known])))
    error_mm, std_mm, source = np.concatenate(pixels).T
    own = error_mm[std_mm >= 0] <= 3 * std_mm[std_mm >= 0] + 1  # those of pieces that float are not known
    figures = _figures(error_mm)
    document = {
        "format": "flatcloth-validation/1",
        "flatcloth": __version__,
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
            "compared_share": len(error_mm) / sum(int(view.valid.sum()) for view in views.values()),
        },
        "pieces": pieces,
        "views": [
            {"view": n, "angle_deg": recording.angles_deg[n], "markers": len(seen.of_view(n))}
            | _figures(error_mm[source == n])
            for n in np.unique(source).astype(int).tolist()
        ],
        "depth": depth_by_incidence(seen, kit),
        "errors": cell_errors(cell) if cell else [],
    }
    return Validation(document | {"lines": _lines(document)}, seen, truth, axis, views)


def _figures(error_mm: Float64) -> dict[str, float]:
    return {"median_mm": float(np.median(error_mm)), "p95_mm": float(np.percentile(error_mm, 95))}


def _piece(name: str, flat_m: Float64, true_m: Float64) -> dict[str, Any]:
    """Return the figures of a piece; ``longer_percent`` is how much too long it is as a whole."""
    relative_mm = 1e3 * relative_errors_m(flat_m, true_m, np.random.default_rng(0))
    longer = 100 * float(flat_m.std(axis=0).sum() / true_m.std(axis=0).sum() - 1.0)
    relative = {f"relative_{figure}": value for figure, value in _figures(relative_mm).items()}
    absolute = _figures(1e3 * np.linalg.norm(flat_m - true_m, axis=1))
    return {"piece": name} | absolute | relative | {"longer_percent": longer}


def _lines(document: dict[str, Any]) -> list[str]:
    shape, markers, errors = document["shape"], document["markers"], document["errors"]
    asked = "as asked" if document["is_within"] else f"not the {document['within_mm']:g} mm that are asked"
    own, main, depth = shape["within_3_std_share"], document["pieces"][0], document["depth"]
    faults = [error["text"] for error in errors if error["is_fault"]]
    return [
        f"{document['recording']}: {markers['seen']} of {markers['of_kit']} markers of the kit "
        f"{document['kit']}, {markers['sightings']} times.",
        f"In this cell 95 % of the cloth is within {shape['p95_mm']:.1f} mm of its place, half of it within "
        f"{shape['median_mm']:.1f} mm: {asked}. Markers show {shape['compared_share']:.0%} of the shape; "
        "the rest is often worse.",
        f"Distances of 20 to 200 mm are right to {main['relative_p95_mm']:.1f} mm (95 %); the whole is "
        f"off by {main['longer_percent']:+.1f} % in length.",
        *([] if own is None else [f"{own:.1%} of the cloth is within three of its own deviations."]),
        *(
            f"Depth seen at {row['incidence_deg']} degrees: noise of {row['noise_mm']:.1f} mm; lengths are "
            f"off by {row['longer_percent']:+.1f} %."
            for row in depth
        ),
        *(
            faults
            or [f"Markers show {'no error of' if errors else 'too little of'} camera, axis and angles."]
        ),
    ]


def cell_errors(found: Adjustment) -> list[dict[str, Any]]:
    """Return the errors of a cell with their deviations; one that is beyond it, and matters, is a fault."""
    std = np.sqrt(np.diag(found.covariance))
    std[:2] = np.hypot(std[:2], _SHARED_STD)
    focal, depth, right, near = found.common[:4].tolist()
    # The axis is recorded as the depth camera sees it; if that is off, or where it truly is.
    seen_m = math.exp(-depth) * (found.distance_m - near)
    slope = np.array([0.0, -seen_m, 0.0, -math.exp(-depth)])
    off_m = abs(seen_m - found.distance_m), math.sqrt(slope @ found.covariance[:4, :4] @ slope)
    if abs(depth) > max(_SURE * std[1], _FAULTS["depth"][1] / 100):
        off_m = min(off_m, (abs(near), math.hypot(std[3], _SHARED_STD * found.distance_m)))
    angle, *sway = (_spread(found.of_view[:, k], np.square(std[6 + k :: 3])) for k in range(3))
    sizes = [
        (100 * math.expm1(-depth), 100 * std[1], math.exp(depth)),
        (100 * math.expm1(-focal), 100 * std[0], math.exp(focal)),
        (1e3 * math.hypot(right, off_m[0]), 1e3 * math.hypot(std[2], off_m[1]), 0.0),
        (*np.degrees(angle), 0.0),
        (*(1e3 * found.below_m * np.mean(sway, axis=0)), 0.0),
    ]
    return [
        {
            **{"name": name, "unit": unit, "size": float(size), "std": float(its_std)},
            "is_fault": bool(abs(size) > max(_SURE * its_std, matters)),
            "text": text.format(size, mend),
        }
        for (name, (unit, matters, text)), (size, its_std, mend) in zip(_FAULTS.items(), sizes, strict=True)
    ]


def _spread(off: Float64, variance: Float64) -> Float64:
    """Return the deviation of errors (V,) of views beyond the variances (V,) of their estimates, and its own.

    That of most likelihood, by the scoring of Fisher.
    """
    square = 0.0
    for _ in range(_SCORINGS):
        weight = np.square(1 / (square + variance))
        square = max(float(weight @ (np.square(off) - variance)) / float(weight.sum()), 0.0)
    return np.array([math.sqrt(square), math.sqrt(square + math.sqrt(2 / weight.sum())) - math.sqrt(square)])


def depth_by_incidence(seen: Sightings, kit: Kit) -> list[dict[str, Any]]:
    """Return noise and lengths of depth inside markers, by the angle between line of sight and normal.

    ``longer_percent`` is the median by which sides of markers are too long; bent ones are too short.
    """
    places_m, true_m = seen.corners_m, np.stack([kit.corners_m[i] for i in seen.marker.tolist()])
    side_m, true_side_m = (
        np.linalg.norm(np.diff(c, axis=1), axis=2).mean(axis=1) for c in (places_m, true_m)
    )
    incidence_deg = np.degrees(np.arccos(seen.cosine))
    return [
        {
            "incidence_deg": f"{low} to {low + _STEP_DEG}",
            "sightings": int(own.sum()),
            "noise_mm": 1e3 * float(np.median(seen.noise_m[own])),
            "longer_percent": 100 * float(np.median(side_m[own] / true_side_m[own])) - 100,
        }
        for low in range(0, 90, _STEP_DEG)
        if (own := incidence_deg // _STEP_DEG * _STEP_DEG == low).any()
    ]
