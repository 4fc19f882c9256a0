"""Whether results are right in a cell: a recording of a kit against the kit, in figures and in sentences."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

from flatcloth import __version__
from flatcloth.api.integrating import Sides, integrate
from flatcloth.core.errors import EvaluationError
from flatcloth.core.types import FlattenedView, Intrinsics, Progress, finite, no_progress
from flatcloth.engine.evaluation import FAR_M, Comparison, compare, picture
from flatcloth.export.files import write_text
from flatcloth.export.report import page_of, table_html
from flatcloth.recordings.base import Recording, altered, images_of
from flatcloth.recordings.truth import TrueView
from flatcloth.rendering.drawing import data_url, png_of
from flatcloth.validation.cell import cell_errors
from flatcloth.validation.kit import Kit, KitError, read_kit
from flatcloth.validation.markers import Sightings, sightings_of


@dataclass
class KitTruth:
    """The truth that markers show: the place of pixels inside and between them, linear in the image."""

    seen: Sightings
    kit: Kit
    camera: Intrinsics
    panel_of_interest: int

    def __getitem__(self, view_index: int) -> TrueView:
        """Return the truth of one view."""
        shape = (self.camera.height, self.camera.width)
        flat = np.full((*shape, 2), np.nan, dtype=np.float32)
        of_view = np.flatnonzero(self.seen.view == view_index)
        rows = [n for n in of_view if self.kit.sheet[self.seen.marker[n]] == self.panel_of_interest]
        if rows:
            image = self.seen.corners_px[rows].reshape(-1, 2)
            places = np.concatenate([self.kit.corners_m[i] for i in self.seen.marker[rows]])
            between = Delaunay(image)
            corners, at = places[between.simplices], image[between.simplices]
            longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
            turned = [np.linalg.det(each[:, 1:] - each[:, :1]) for each in (corners, at)]
            near = (longest <= self.kit.reach_m) & (turned[0] * turned[1] > 0)
            low, high = np.ceil(image.min(axis=0)).astype(int), np.floor(image.max(axis=0)).astype(int) + 1
            pixels = np.argwhere(np.ones(high - low)) + low
            inside = between.find_simplex(pixels)
            x, y = (shown := pixels[(inside >= 0) & near[inside]]).T
            flat[y, x] = LinearNDInterpolator(between, places)(shown)
        known = np.isfinite(flat[..., 0])
        panel = (known * self.panel_of_interest).astype(np.uint8)
        return TrueView(panel=panel, outer_face=known, flat_uv_m=flat)


def compared_with_kit(
    view: FlattenedView, seen: Sightings, kit: Kit, recording: Recording
) -> Comparison | None:
    """Compare a piece of the shape with the sheet that most of its markers are of; None if it shows none.

    The definitions are those of ``flatcloth evaluate``. Masks are of one side, so they are not used.
    """
    unmasked = altered(recording, read=lambda n: images_of(recording[n])._replace(mask=None))
    found: list[Comparison] = []
    for sheet in sorted({kit.sheet[i] for i in seen.marker.tolist()}):
        with suppress(EvaluationError):
            found.append(compare(view, KitTruth(seen, kit, recording.intrinsics, sheet), unmasked))
    return max(found, key=lambda compared: len(compared.true_uv_m), default=None)


@dataclass(frozen=True)
class Validation:
    """What a recording of a kit shows: ``document`` for JSON, with ``lines`` in words, and the pieces."""

    document: dict[str, Any]
    seen: Sightings
    pieces: dict[str, tuple[FlattenedView, Comparison]]

    def write(self, folder: Path | None, shared: Path | None) -> list[str]:
        """Write page and document to a folder, and what others may have to a file; say what is written."""
        others = {key: value for key, value in self.document.items() if key not in ("recording", "lines")}
        files = {shared: json.dumps(others, indent=1) + "\n"} if shared else {}
        if folder:
            files[folder / "validation.html"] = self.page()
            files[folder / "validation.json"] = json.dumps(self.document, indent=1) + "\n"
        for file, text in files.items():
            write_text(file, text)
        return [f"Written: {', '.join(map(str, files))}"] if files else []

    def page(self) -> str:
        """Return sentences, a picture of where this side is off, and the table, as self-contained HTML."""
        name, (_, compared) = next(iter(self.pieces.items()))
        form = "{size:.2f} \u00b1 {std:.2f} {unit}"
        rows = [(error["name"], form.format(**error)) for error in self.document["errors"]]
        body = [
            "<h1>Is it right in this cell?</h1>",
            *(f"<p>{escape(line)}</p>" for line in self.document["lines"]),
            f'<figure class="hero"><img src="{data_url(png_of(picture(compared)), "image/png")}" alt="">',
            f"<figcaption>{name}: shape, kit, and error; {1e3 * FAR_M:g} mm is yellow.</figcaption></figure>",
            table_html(("error", "size, one standard deviation"), rows),
        ]
        return page_of(f"{self.document['recording']}: validation", body)


def kit_of(recording: Recording, given: Path | None) -> Kit:
    """Read the kit that was given, else the ``kit.json`` in the folder of the recording."""
    path = given or Path(recording.location) / "kit.json"
    if given is None and not path.is_file():
        raise KitError(f"{recording.location}: has no kit.json. Say what it shows: --kit kit.json.")
    if not (kit := read_kit(path)).is_measured:
        raise KitError(f"{path}: stickers are not measured. Photograph them: flatcloth kit --from-photo.")
    return kit


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
    found = {name: (view, compared_with_kit(view, seen, kit, recording)) for name, view in views.items()}
    pieces = {name: (view, compared) for name, (view, compared) in found.items() if compared is not None}
    if not pieces:
        raise KitError(f"{recording.location}: no marker lies in the shape; flatcloth run says what does.")
    all_pieces = [compared for _, compared in pieces.values()]
    error_mm = np.concatenate([1e3 * np.linalg.norm(c.flat_uv_m - c.true_uv_m, axis=1) for c in all_pieces])
    std_mm = np.concatenate([compared.std_mm for compared in all_pieces])
    own = np.where(std_mm >= 0, error_mm <= 3 * std_mm + 1, np.nan)
    median_mm, p95_mm = np.percentile(error_mm, (50, 95)).tolist()
    turning = recording.rotation_axis or shape.axis, recording.held_point_m, recording.angles_deg
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
        "is_within": p95_mm <= within_mm,
        "shape": {
            "median_mm": median_mm,
            "p95_mm": p95_mm,
            "within_3_std_share": finite(float(own.mean())),
            "compared_share": len(error_mm) / sum(compared.evaluation.pixels for compared in all_pieces),
        },
        "pieces": {
            name: {
                k: finite(v) for k, v in asdict(its.evaluation).items() if k.endswith(("_mm", "far_share"))
            }
            for name, (_, its) in pieces.items()
        },
        "errors": cell_errors(seen, kit, *turning),
    }
    return Validation(document | {"lines": _lines(document)}, seen, pieces)


def _lines(document: dict[str, Any]) -> list[str]:
    shape, markers, errors = document["shape"], document["markers"], document["errors"]
    asked = "as asked" if document["is_within"] else f"not the {document['within_mm']:g} mm that are asked"
    own, main = shape["within_3_std_share"], next(iter(document["pieces"].values()))
    faults = [error["text"] for error in errors if error["is_fault"]]
    return [
        f"{document['recording']}: {markers['seen']} of {markers['of_kit']} markers of the kit "
        f"{document['kit']}, {markers['sightings']} times.",
        f"In this cell 95 % of the cloth is within {shape['p95_mm']:.1f} mm of its place, half of it within "
        f"{shape['median_mm']:.1f} mm: {asked}. Markers show {shape['compared_share']:.0%} of the shape; "
        "the rest is often worse.",
        f"Distances of 20 to 200 mm are right to {main['relative_p95_mm']:.1f} mm (95 %).",
        *([] if own is None else [f"{own:.1%} of the cloth is within three of its own deviations."]),
        *(faults if errors else ["Too few markers are seen in two views to judge camera, axis and angles."]),
        *([] if faults or not errors else ["The markers show no error of camera, axis or angles."]),
    ]
