"""What each change to the method ``paper`` for views in several parts does, alone and together.

``Z-angle`` is the score by coarse texture, height and Z-angle; ``place`` the score by the places in
space, which replaced it; ``estimate`` the initial estimate from pixels at the same place; ``necks`` that
parts are separated at narrow necks.

The variants are methods of their own: ``before`` has none of the changes, each of the others one of
them, ``all`` is the method as it is. Takes some minutes a recording (``--keep DIR`` measures many in
pieces); not part of the default run.
"""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.inputs import Remembered, sources
from benchmarks.output import Options, save
from flatcloth.core.config import Config, FlatteningConfig
from flatcloth.core.types import Bool, FlattenedView, Int32, Progress, RotationAxis, no_progress
from flatcloth.engine.evaluation import compare
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.methods.answers import Alignment
from flatcloth.methods.paper.departures import Aligned, Aligner
from flatcloth.methods.paper.matching import FINE_SMOOTHING_M, Z_ANGLE_SMOOTHING_M, Matcher, mean_z_angle_deg
from flatcloth.methods.paper.method import PaperMethod
from flatcloth.methods.paper.occlusion import occluding_edge_length_m
from flatcloth.methods.registry import register, unregister
from flatcloth.methods.starting import start_by_view
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import Truth
from flatcloth.session.machine import Document, MemorySession, PlacedPart, SessionState, Side

BEFORE_M2 = 0.03
"""S_0 as it was."""
BEFORE_SCORE = 0.25
"""The least score as it was."""


LAG_PX = 6
"""Distance over which Z-angles are compared, in pixels of the flattened view."""
BEFORE_TELLING = 0.25
"""The texture that told fully in that score."""
TELLING_TEXTURE = 0.45
"""The same in the score by coarse texture, height and Z-angle, which that by the place replaced. It was the
random disagreement of a texture as strong as the floor: 1 - sqrt(pi) / 2 exp(1/4) erfc(1/2)."""
CHANCE_HEIGHT = 0.85
"""Heights that agreed less told nothing without texture: wrong placements reached 0.82 to 0.93."""


class TextureMatcher(Matcher):
    """Scores by fine texture with height."""

    score_smoothing_m = FINE_SMOOTHING_M

    def total(self, parts: dict[str, float]) -> float:
        told = min(1.0, self._chance[0] / BEFORE_TELLING)
        return parts["height_agreement"] * (1.0 - told * (1.0 - parts["intensity_agreement"]))


class HeightMatcher(Matcher):
    """Scores by coarse texture, where there is any, otherwise by close height, both with the Z-angle."""

    def total(self, parts: dict[str, float]) -> float:
        told = min(1.0, self._chance[0] / TELLING_TEXTURE)
        height, by_texture = (
            parts["height_agreement"],
            parts["intensity_agreement"] * parts["height_agreement"],
        )
        by_shape = min(1.0, max(0.0, (height - CHANCE_HEIGHT) / (1.0 - CHANCE_HEIGHT)))
        return (told * by_texture + (1.0 - told) * by_shape) * parts["z_angle_agreement"]


@cache
def matcher_of(kept: frozenset[str]) -> type[Matcher]:
    """Return the matcher with some of the changes."""
    kinds: list[type[Matcher]] = []
    if "place" not in kept:
        kinds = [HeightMatcher] if "Z-angle" in kept else [TextureMatcher]
    was: dict[str, float] = {}
    if "noise" not in kept:
        was["z_angle_smoothing_m"] = 0.0
    if "search" not in kept:
        was["z_angle_weight"] = 0.0
    return type("VariantMatcher", (*kinds, Matcher), was)


class Before(PaperMethod):
    """The method without the changes; ``kept`` names those that a variant has."""

    kept: frozenset[str] = frozenset()

    @property
    def matcher_kind(self) -> type[Matcher]:  # type: ignore[override]
        return matcher_of(self.kept)

    @property
    def overlap_area_m2(self) -> float:  # type: ignore[override]
        return PaperMethod.overlap_area_m2.func(self) if "S_0" in self.kept else BEFORE_M2  # type: ignore[attr-defined]

    @property
    def accept_score(self) -> float:
        return super().accept_score if "place" in self.kept else BEFORE_SCORE

    def start_view(self, progress: Progress = no_progress) -> int | None:
        if "start" in self.kept:
            return super().start_view(progress)
        return start_by_view(self._views, progress)

    def occluding_edge_m(self, document: Document, view_index: int, side: Side) -> float:
        if "edges" in self.kept:
            return super().occluding_edge_m(document, view_index, side)
        flattening = self._views.flattening(view_index)
        level = flattening.levels[-1]
        points = level.points_rc[flattening.components[document.placed_components.get(view_index, 0)].members]
        near = _near_samples(flattening.surface.usable, points, level.sampling_interval_px)
        return occluding_edge_length_m(flattening.surface, side, near)

    def settled(self, alignment: Alignment) -> Alignment:
        return super().settled(alignment) if "start stands" in self.kept else alignment

    def first_accepted(self, by_lines: Aligner, by_places: Aligner) -> Alignment:
        if "estimate" in self.kept:
            return super().first_accepted(by_lines, by_places)
        return self.settled(by_lines())

    def choose(self, found: Sequence[Aligned]) -> Aligned:
        if "new area" in self.kept:
            return super().choose(found)
        return max(found, key=lambda a: a.alignment.score.total)

    def also_placed(
        self, document: Document, chosen: Aligned, found: Sequence[Aligned], progress: Progress
    ) -> tuple[PlacedPart, ...]:
        if "parts" in self.kept:
            return super().also_placed(document, chosen, found, progress)
        return ()


CHANGES = (
    *("start", "edges", "new area", "parts", "Z-angle", "place", "S_0", "start stands", "estimate"),
    *("noise", "search", "necks"),
)
VARIANTS = {
    "before": frozenset[str](),
    **{name: frozenset({name}) for name in CHANGES},
    "all but place": frozenset(CHANGES) - {"place", "estimate"},
    "all but necks": frozenset(CHANGES) - {"necks"},
    "all": frozenset(CHANGES),
}


def z_angle_noise_deg(view: FlattenedView, axis: RotationAxis, smoothing_m: float) -> float:
    """Return the standard deviation of the Z-angles, averaged as given, from their second differences.

    As :func:`flatcloth.flattening.noise.noise_in_pixels`: the direction and the half with the smaller ones.
    """
    angle = np.radians(mean_z_angle_deg(view, axis, 0.0, smoothing_m))
    found = []
    for a in (angle, angle.T):
        bend = a[: -2 * LAG_PX] + a[2 * LAG_PX :] - 2.0 * a[LAG_PX:-LAG_PX]
        off = np.sort(np.abs(np.arcsin(np.sin(bend[np.isfinite(bend)]))))
        found.append(float(np.degrees(off[: off.size // 2].mean() / (0.325 * math.sqrt(6.0)))))
    return min(found)


def rows_of(source: str, variants: Sequence[str]) -> list[dict[str, Any]]:
    """Return a row for each variant of one recording."""
    recording = Remembered(open_recording(source))
    truth = Remembered(Truth(recording.location))
    rows: list[dict[str, Any]] = []
    first: dict[bool, Integration] = {}
    for name in variants:
        method = f"paper-{name}"
        kind = type("Variant", (Before,), {"kept": VARIANTS[name], "name": method})
        register(method, lambda kind=kind: kind)
        try:
            cuts = "necks" in VARIANTS[name]
            whole = Config(flattening=FlatteningConfig(least_core_samples=0))
            made = Integration(recording, Config() if cuts else whole, method=method)
        finally:
            unregister(method)
        same = first.setdefault(cuts, made)
        made.views._flattenings, made.views._areas = same.views._flattenings, same.views._areas
        document = Run(made, MemorySession(SessionState(len(recording)))).finish().document
        found = compare(made.canonical(document).view, truth, recording).evaluation
        rows.append(
            {
                "recording": recording.name,
                "variant": name,
                "coverage": round(found.coverage, 3),
                "median_mm": round(found.absolute_median_mm, 1),
                "far_share": round(found.absolute_far_share, 3),
                "relative_p95_mm": round(found.relative_p95_mm, 1),
                "views": len(document.used_views),
                "start_view": document.start_view,
                "parts": sum(len(a.also) for a in document.accepted),
            }
        )
        print("{recording:<24}{variant:<14}{coverage:>7.3f}{median_mm:>7.1f}{far_share:>7.1%}"
              "{relative_p95_mm:>7.1f}{views:>4}{parts:>4}".format(**rows[-1]), flush=True)  # fmt: skip
    start, axis = first[False].views.part(rows[0]["start_view"], 0), first[False].axis
    noise = [round(z_angle_noise_deg(start, axis, by_m), 1) for by_m in (0.0, Z_ANGLE_SMOOTHING_M)]
    rows[0]["z_angle_noise_deg"] = noise
    print(f"{recording.name:<24}noise of the Z-angle {noise[0]} deg, averaged {noise[1]}", flush=True)
    return rows


def kept_rows(source: str, variants: Sequence[str], keep: str) -> list[dict[str, Any]]:
    """Return the rows of one recording; those that a folder keeps are not measured again."""
    file = Path(keep) / f"{Path(source).name}.json"
    if keep and file.exists():
        kept: list[dict[str, Any]] = json.loads(file.read_text())
        return kept
    rows = rows_of(source, variants)
    if keep:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(rows))
    return rows


def run(options: Options) -> None:
    """Measure, print and write ``results/paper_steps.json``."""
    variants = ("before", "all") if options.quick else tuple(VARIANTS)
    rows = [
        row for source in sources(options.recordings) for row in kept_rows(source, variants, options.keep)
    ]
    for name in variants:
        own = [row for row in rows if row["variant"] == name]
        middle = {
            key: statistics.median(row[key] for row in own)
            for key in ("coverage", "far_share", "relative_p95_mm")
        }
        print(f"{'median':<24}{name:<14}{middle['coverage']:>7.3f}{'':>7}{middle['far_share']:>7.1%}"
              f"{middle['relative_p95_mm']:>7.1f}")  # fmt: skip
    if not options.quick:
        save("paper_steps", rows, [row["recording"] for row in rows])


def _near_samples(usable: Bool, points_rc: Int32, extent_px: int) -> Bool:
    """Return which usable pixels (H, W) lie within an extent of samples (N, 2)."""
    seeds = np.zeros(usable.shape, dtype=np.uint8)
    seeds[points_rc[:, 0], points_rc[:, 1]] = 1
    size = 2 * extent_px + 1
    near: Bool = (cv2.dilate(seeds, np.ones((size, size), dtype=np.uint8)) > 0) & usable
    return near
