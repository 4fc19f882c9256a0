"""Whether results are right in a cell: a recording of a kit against the kit, in figures and in sentences.

Errors of the cell itself follow from markers alone. A marker lies at one place of the item, so its sightings
must meet in the object frame, and its diagonals are as long as on the kit. The size of images over their
depth gives the ratio of focal length and depth only; that width and depth exchange as the item turns gives
the focal length by itself.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from flatcloth import __version__
from flatcloth.api.integrating import Sides, integrate
from flatcloth.core.geometry import horizontal_axes, rotations_by
from flatcloth.core.types import FlattenedView, Float64, Int64, Progress, RotationAxis, no_progress
from flatcloth.engine.evaluation import relative_errors_m
from flatcloth.export.figures import Figure, map_drawing
from flatcloth.export.files import write_text
from flatcloth.export.report import page_of, table_html
from flatcloth.recordings.base import Recording
from flatcloth.rendering.drawing import add_ramp
from flatcloth.rendering.layers import legend, rgba
from flatcloth.rendering.pictures import cropped
from flatcloth.validation.kit import Kit, KitError
from flatcloth.validation.markers import KitTruth, Sightings, sightings_of

_LEAST_PIXELS = 50
"""Pieces of which markers show fewer pixels are not judged. Chosen: about a square centimetre."""
_PLACE_STD_M, _LENGTH_STD_M = np.array([0.0002, 0.0002, 0.0007]), 0.0005
"""Expected deviations of a marker's place in camera coordinates, and of its diagonals, by which they are
weighed. Chosen: about those of a D435 at 0.85 m. Deviations of the results come from the residuals."""
_COMMON_STDS = np.array([0.2, 0.2, 0.03, 0.03, 0.05, 0.05])
"""Priors of the unknowns of all views, in their order: more than a cell has that works. Chosen."""
_VIEW_STDS = np.array([0.035, 0.008, 0.008])
"""Priors of the unknowns of each view: more than a cell has that works. Chosen."""
_FIRM = 1e3
"""Weight that holds the mean error of all views at zero: it is the axis' or the item's own. By definition."""
_LEAST_SIGHTINGS, _BEST_SHARE = 50, 0.75
"""Fewer sightings of markers that several views show determine nothing; the others bend most. Chosen."""
_SURE = 4.0
"""Errors within so many deviations are none. Chosen: errors of stereo depth are correlated."""
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
    axis, figures = recording.rotation_axis or shape.axis, _figures(error_mm)
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
        "errors": cell_errors(seen, kit, axis, recording.held_point_m, recording.angles_deg),
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


def cell_errors(
    seen: Sightings, kit: Kit, axis: RotationAxis, held_m: Float64 | None, angles_deg: Sequence[float]
) -> list[dict[str, Any]]:
    """Estimate the errors of a cell; none if too few markers are seen in several views.

    ``axis``, ``held_m`` (3,) and ``angles_deg`` are as recorded. Beyond its deviation an error is a fault.
    """
    used = seen.noise_m <= np.nanquantile(seen.noise_m, _BEST_SHARE)
    _, marker, count = np.unique(seen.marker[used], return_inverse=True, return_counts=True)
    used[used] = count[marker] > 1
    if used.sum() < _LEAST_SIGHTINGS:
        return []
    marker = np.unique(seen.marker[used], return_inverse=True)[1]
    views, view = np.unique(seen.view[used], return_inverse=True)
    angle_rad, held_m = np.radians(np.array(angles_deg)[views]), axis.point_m if held_m is None else held_m
    true_m, corners_m = np.stack([kit.corners_m[i] for i in seen.marker[used]]), seen.corners_m[used]
    diagonals_m = np.linalg.norm(true_m[:, :2] - true_m[:, 2:], axis=2)
    across = np.stack(horizontal_axes(axis))
    prior = np.concatenate([_COMMON_STDS, np.tile(_VIEW_STDS, len(views))])

    def residuals(unknown: Float64) -> Float64:
        """Return them (5 M,) across the line of sight, in depth and of lengths, over their deviations.

        The unknown is: the logarithms of the factors that correct focal length and depth; where the depth
        camera sees the axis less where it is recorded, to the right and to the camera; its tilt in these
        directions; of each view its angle and two of its sway, rad.
        """
        scale = np.exp(unknown[1] - unknown[0] * np.array([1.0, 1.0, 0.0]))
        along, of_view = axis.direction + unknown[4:6] @ across, unknown[6:].reshape(-1, 3)
        turn = rotations_by(np.outer(angle_rad + of_view[:, 0], along / np.linalg.norm(along)))
        sway, place = rotations_by(of_view[:, 1:] @ across), corners_m.mean(axis=1)
        center, held = (axis.point_m + unknown[2:4] @ across) * scale, held_m * scale
        points = np.einsum("nji,nj->ni", sway[view], place * scale - held) + held - center
        points = np.einsum("nji,nj->ni", turn[view], points)
        sums = np.stack([np.bincount(marker, column) for column in points.T], axis=1)
        points -= (sums / np.bincount(marker)[:, None])[marker]
        off = np.einsum("nij,nj->ni", (sway @ turn)[view], points) / scale
        off[:, :2] -= place[:, :2] / place[:, 2:] * off[:, 2:]
        length = np.linalg.norm((corners_m[:, :2] - corners_m[:, 2:]) * scale, axis=2)
        return np.hstack([off / _PLACE_STD_M, (length - diagonals_m) / _LENGTH_STD_M]).T.ravel()

    def cost(scaled: Float64) -> Float64:
        mean = _FIRM * scaled[6:].reshape(-1, 3).mean(axis=0)
        return np.concatenate([residuals(scaled * prior), scaled, mean])

    found = least_squares(cost, np.zeros(len(prior)), loss="soft_l1", max_nfev=30)
    covariance = _covariance(found.jac, cost(found.x), marker) * np.outer(prior, prior)
    below_m = float(((held_m - corners_m) @ axis.direction).max())
    return _errors(found.x * prior, covariance, float(axis.point_m[2]), below_m)


def _covariance(jacobian: Float64, residual: Float64, marker: Int64) -> Float64:
    """Return the covariance of the scaled unknowns: residuals of one marker err together, others do not."""
    weighted = residual * np.power(1.0 + np.square(residual), 0.25)  # soft_l1, as its Jacobian is scaled
    sums, count = np.zeros((int(marker.max()) + 1, jacobian.shape[1])), 5 * len(marker)
    np.add.at(sums, np.tile(marker, 5), jacobian[:count] * weighted[:count, None])
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    return np.asarray(inverse @ (sums.T @ sums) @ inverse)


def _errors(unknown: Float64, covariance: Float64, distance_m: float, below_m: float) -> list[dict[str, Any]]:
    """Return the errors; the axis is recorded at this distance, and the lowest marker is so far below."""
    std = np.sqrt(np.diag(covariance))
    focal, depth, right, near = unknown[:4].tolist()
    # The axis is recorded as the depth camera sees it, or where it truly is: the smaller error counts.
    off_m, seen_m = (abs(near), std[3]), math.exp(depth) * (distance_m - near)
    if abs(depth) > _SURE * std[1]:
        slope = np.array([0.0, seen_m, 0.0, -math.exp(depth)])
        off_m = min(off_m, (abs(seen_m - distance_m), math.sqrt(slope @ covariance[:4, :4] @ slope)))
    axis_mm = 1e3 * np.array([math.hypot(right, off_m[0]), math.hypot(std[2], off_m[1])])
    variance, square = (np.square(each[6:].reshape(-1, 3)).mean(axis=0) for each in (std, unknown))
    beyond = np.sqrt([np.maximum(square - variance, 0.0), variance])
    found = [
        (100 * math.expm1(-depth), 100 * std[1], math.exp(depth)),
        (100 * math.expm1(-focal), 100 * std[0], math.exp(focal)),
        (*axis_mm, 0.0),
        (*np.degrees(beyond[:, 0]), 0.0),
        (*(1e3 * below_m * beyond[:, 1:].mean(axis=1)), 0.0),
    ]
    return [
        {
            **{"name": name, "unit": unit, "size": float(size), "std": float(its_std)},
            "is_fault": bool(abs(size) > max(_SURE * its_std, matters)),
            "text": text.format(size, mend),
        }
        for (name, (unit, matters, text)), (size, its_std, mend) in zip(_FAULTS.items(), found, strict=True)
    ]


def depth_by_incidence(seen: Sightings, kit: Kit) -> list[dict[str, Any]]:
    """Return noise and lengths of depth inside markers, by the angle between line of sight and normal.

    ``longer_percent`` is the median by which sides of markers are too long; bent ones are too short.
    """
    places_m, true_m = seen.corners_m, np.stack([kit.corners_m[i] for i in seen.marker.tolist()])
    side_m, true_side_m = (
        np.linalg.norm(np.diff(c, axis=1), axis=2).mean(axis=1) for c in (places_m, true_m)
    )
    normal = np.cross(places_m[:, 2] - places_m[:, 0], places_m[:, 3] - places_m[:, 1])
    normal, sight = (v / np.linalg.norm(v, axis=1)[:, None] for v in (normal, places_m.mean(axis=1)))
    incidence_deg = np.degrees(np.arccos(np.abs((normal * sight).sum(axis=1))))
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
