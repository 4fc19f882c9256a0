"""Are the claimed standard deviations true, and does the confidence tell right from wrong?

Each recording is integrated without an operator. Its pixels' errors against the truth are compared with
their standard deviations (a reliability curve), and the scores of all natural placements with whether
they are right (a ROC; see ``benchmarks.confidence``). A factor on the standard deviations is fitted
without each garment in turn, so that 98 % of the others' pixels are within three of them plus 1 mm; it
is 1 where they are right as they are.
"""

from __future__ import annotations

import gc
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from benchmarks.confidence import (
    RIGHT_M,
    WRONG_M,
    Laid,
    judged,
    left_out_scores,
    placements_of,
    watched,
)
from benchmarks.inputs import sources
from benchmarks.output import RESULTS, Options, save, save_page, say
from flatcloth.core.types import Float64
from flatcloth.engine.evaluation import compare
from flatcloth.methods.robust.scoring import CONFIDENCE_WEIGHTS, confidence_of

WITHIN, STDS, ALLOWED_MM = 0.98, 3.0, 1.0
_EDGES_MM = (1.5, 2.25, 2.75, 3.5, 5.0, 7.0, 10.0, 15.0, 25.0, 50.0)
_LEAST_PIXELS = 200


@dataclass(frozen=True)
class PixelErrors:
    """One recording's pixels: ``error_mm`` and ``std_mm`` (K,)."""

    recording: str
    garment: str
    error_mm: Float64
    std_mm: Float64

    def within(self, factor: float = 1.0) -> float:
        """Return the share of the pixels within three standard deviations, times a factor, plus 1 mm."""
        return float((self.error_mm <= STDS * factor * self.std_mm + ALLOWED_MM).mean())


def least_factor(found: Sequence[PixelErrors]) -> float:
    """Return the least factor with which 98 % of the pixels of every recording are within three."""
    needed = [np.quantile((s.error_mm - ALLOWED_MM) / (STDS * s.std_mm), WITHIN) for s in found]
    return max(float(np.max(needed)), 0.0)


def curve(found: Sequence[PixelErrors]) -> list[dict[str, float]]:
    """Return for each bin of claimed standard deviations: the claim, the errors' RMS and quantiles, mm."""
    error = np.concatenate([s.error_mm for s in found])
    std = np.concatenate([s.std_mm for s in found])
    rows = []
    for low, high in pairwise(_EDGES_MM):
        own = (std >= low) & (std < high)
        if own.sum() >= _LEAST_PIXELS:
            rows.append(
                {
                    "claimed_mm": round(float(np.median(std[own])), 2),
                    "error_rms_mm": round(float(np.sqrt(np.square(error[own]).mean())), 2),
                    "error_median_mm": round(float(np.median(error[own])), 2),
                    "error_p95_mm": round(float(np.percentile(error[own], 95)), 2),
                    "share": round(float(own.mean()), 4),
                }
            )
    return rows


def rows_of(found: Sequence[PixelErrors]) -> list[dict[str, Any]]:
    """Return a row for each recording, the worst first."""
    rows = []
    for own in found:
        others = [s for s in found if s.garment != own.garment]
        factor = least_factor(others) if others else None
        good = own.error_mm < 2.0
        rows.append(
            {
                "recording": own.recording,
                "within_3_std_share": round(own.within(), 4),
                "std_where_right_mm": round(float(np.median(own.std_mm[good])), 2) if good.any() else None,
                "error_p95_mm": round(float(np.percentile(own.error_mm, 95)), 2),
                "factor_of_other_garments": None if factor is None else round(factor, 2),
                "within_with_that_share": None if factor is None else round(own.within(factor), 4),
            }
        )
    return sorted(rows, key=lambda row: float(row["within_3_std_share"]))


def roc(laid: Sequence[Laid], scores: Float64) -> tuple[Float64, Float64]:
    """Return the shares of wrong and of right natural placements at or above each score, from (0, 0)."""
    natural = np.array([not p.moved for p in laid]) & np.isfinite(scores)
    error = np.array([p.error_m for p in laid])
    right, wrong = (np.sort(scores[natural & own]) for own in (error <= RIGHT_M, error >= WRONG_M))
    steps = np.unique(np.concatenate([right, wrong, [np.inf]]))[::-1]
    shares = [1.0 - np.searchsorted(own, steps) / max(own.size, 1) for own in (wrong, right)]
    return shares[0], shares[1]


def measured(source: str) -> tuple[PixelErrors, list[Laid]]:
    """Return the pixels' errors of a recording's unattended result, and the placements considered for it."""
    found = watched(source)
    recording, truth = found.integration.recording, found.truth
    compared = compare(found.integration.canonical(found.document).view, truth, recording)
    error_mm = 1e3 * np.linalg.norm(compared.flat_uv_m - compared.true_uv_m, axis=1)
    errors = PixelErrors(recording.name, truth.garment, error_mm, compared.std_mm)
    return errors, placements_of(found, np.random.default_rng(crc32(recording.name.encode())))


def keep(file: Path, errors: PixelErrors, laid: Sequence[Laid]) -> None:
    """Write what was measured of a recording."""
    file.parent.mkdir(parents=True, exist_ok=True)
    about = {"recording": errors.recording, "garment": errors.garment, "laid": [asdict(p) for p in laid]}
    with file.open("wb") as stream:
        np.savez_compressed(
            stream, error_mm=errors.error_mm, std_mm=errors.std_mm, about=np.array(json.dumps(about))
        )


def kept(file: Path) -> tuple[PixelErrors, list[Laid]]:
    """Read what :func:`keep` wrote."""
    with np.load(file, allow_pickle=False) as data:
        about = json.loads(str(data["about"]))
        errors = PixelErrors(about["recording"], about["garment"], data["error_mm"], data["std_mm"])
    return errors, [Laid(**placement) for placement in about["laid"]]


def run(options: Options) -> None:
    """Measure and print; write ``results/reliability.json``, ``.md`` and ``.png`` unless ``quick``."""
    names = sources(options.recordings)
    errors, laid = [], []
    for name in names:
        file = Path(options.keep) / f"{Path(name).name}.npz" if options.keep else None
        found = kept(file) if file is not None and file.exists() else measured(name)
        if file is not None and not file.exists():
            keep(file, *found)
        gc.collect()  # an integration and its caches refer to one another
        errors.append(found[0])
        laid += found[1]
        say(f"{errors[-1].recording:<24} {errors[-1].within():.1%} within three standard deviations")
    scores = np.array([confidence_of(p.parts, CONFIDENCE_WEIGHTS) for p in laid])
    left_out = left_out_scores(laid)
    figures = {
        "recordings": rows_of(errors),
        "curve": curve(errors),
        **judged(laid, scores, left_out),
    }
    say(page(figures))
    if not options.quick:
        save("reliability", figures, names)
        save_page("reliability", page(figures), names)
        _draw(errors, laid, {"as used": scores, "garment left out": left_out})


def page(figures: dict[str, Any]) -> str:
    """Return the Markdown page."""
    rows = "\n".join("| " + " | ".join(str(v) for v in row.values()) + " |" for row in figures["recordings"])
    bins = "\n".join("| " + " | ".join(str(v) for v in row.values()) + " |" for row in figures["curve"])
    kinds = ("natural", "natural_garment_left_out", "moved", "moved_garment_left_out")
    columns = ("right", "wrong", "area_under_roc", "right_accepted", "wrong_accepted")
    told = "\n".join(
        f"| {kind.replace('_', ' ')} | " + " | ".join(str(figures[kind].get(c, "")) for c in columns) + " |"
        for kind in kinds
    )
    return f"""# Are standard deviations and confidences true?

![Reliability curve and ROC](reliability.png)

Recordings, the worst first. The factor is fitted on the recordings of all other garments.

| recording | within 3 std + 1 mm | std where error < 2 mm | error p95 mm | factor | within with it |
|---|---|---|---|---|---|
{rows}

Pixels by claimed standard deviation, all recordings:

| claimed mm | error RMS mm | median mm | p95 mm | share of the pixels |
|---|---|---|---|---|
{bins}

Placements: natural ones are those that the method considered, moved ones are wrong on purpose.

| wrong placements | right | wrong | area under the ROC | right accepted | wrong accepted |
|---|---|---|---|---|---|
{told}
"""


def _draw(errors: Sequence[PixelErrors], laid: Sequence[Laid], scores: dict[str, Float64]) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 4.5), layout="constrained")
    rows = curve(errors)
    claimed = [row["claimed_mm"] for row in rows]
    limits = (1.0, 60.0)
    left.plot(limits, limits, color="0.6", linestyle="--", label="RMS error as claimed")
    for key, name in (
        ("error_rms_mm", "RMS"),
        ("error_median_mm", "median"),
        ("error_p95_mm", "95th percentile"),
    ):
        left.plot(claimed, [row[key] for row in rows], marker="o", label=name)
    left.set(xscale="log", yscale="log", xlabel="claimed standard deviation, mm", ylabel="error, mm")
    left.legend()
    for name, own in scores.items():
        wrong_share, right_share = roc(laid, own)
        right.step(wrong_share, right_share, where="post", label=name)
    right.set(
        xlabel="natural wrong placements accepted",
        ylabel="right placements accepted",
        xlim=(0, 1),
        ylim=(0, 1),
    )
    right.legend(loc="lower right")
    figure.savefig(RESULTS / "reliability.png", dpi=100)
