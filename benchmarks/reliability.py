"""Are the claimed standard deviations true?

Each recording is integrated without an operator. Its pixels' errors against the truth are compared with
their standard deviations (a reliability curve). A factor on the standard deviations is fitted without each
garment in turn, so that 98 % of the others' pixels are within three of them plus 1 mm; it is 1 where they
are right as they are.
"""

from __future__ import annotations

import gc
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.inputs import sources
from benchmarks.output import RESULTS, Options, save, save_page, say
from benchmarks.unattended import unattended
from flatcloth.core.types import Float64
from flatcloth.engine.evaluation import compare

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


def measured(source: str) -> PixelErrors:
    """Return the pixels' errors of a recording's unattended result."""
    integration, document, truth = unattended(source)
    compared = compare(integration.canonical(document).view, truth, integration.recording)
    error_mm = 1e3 * np.linalg.norm(compared.flat_uv_m - compared.true_uv_m, axis=1)
    return PixelErrors(integration.recording.name, truth.garment, error_mm, compared.std_mm)


def keep(file: Path, errors: PixelErrors) -> None:
    """Write what was measured of a recording."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("wb") as stream:
        np.savez_compressed(stream, **{key: np.asarray(value) for key, value in vars(errors).items()})


def kept(file: Path) -> PixelErrors:
    """Read what :func:`keep` wrote."""
    with np.load(file, allow_pickle=False) as data:
        return PixelErrors(str(data["recording"]), str(data["garment"]), data["error_mm"], data["std_mm"])


def run(options: Options) -> None:
    """Measure and print; write ``results/reliability.json``, ``.md`` and ``.png`` unless ``quick``."""
    names, errors = sources(options.recordings), []
    for name in names:
        file = Path(options.keep) / f"{Path(name).name}.npz" if options.keep else None
        found = kept(file) if file is not None and file.exists() else measured(name)
        if file is not None and not file.exists():
            keep(file, found)
        gc.collect()  # an integration and its caches refer to one another
        errors.append(found)
        say(f"{found.recording:<24} {found.within():.1%} within three standard deviations")
    figures = {"recordings": rows_of(errors), "curve": curve(errors)}
    say(page(figures))
    if not options.quick:
        save("reliability", figures, names)
        save_page("reliability", page(figures), names)
        _draw(errors)


def page(figures: dict[str, Any]) -> str:
    """Return the Markdown page."""
    rows = "\n".join("| " + " | ".join(str(v) for v in row.values()) + " |" for row in figures["recordings"])
    bins = "\n".join("| " + " | ".join(str(v) for v in row.values()) + " |" for row in figures["curve"])
    return f"""# Are standard deviations true?

![Reliability curve](reliability.png)

Recordings, the worst first. The factor is fitted on the recordings of all other garments.

| recording | within 3 std + 1 mm | std where error < 2 mm | error p95 mm | factor | within with it |
|---|---|---|---|---|---|
{rows}

Pixels by claimed standard deviation, all recordings:

| claimed mm | error RMS mm | median mm | p95 mm | share of the pixels |
|---|---|---|---|---|
{bins}
"""


def _draw(errors: Sequence[PixelErrors]) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(5, 4.5), layout="constrained")
    rows = curve(errors)
    claimed = [row["claimed_mm"] for row in rows]
    limits = (1.0, 60.0)
    axes.plot(limits, limits, color="0.6", linestyle="--", label="RMS error as claimed")
    for key, name in (
        ("error_rms_mm", "RMS"),
        ("error_median_mm", "median"),
        ("error_p95_mm", "95th percentile"),
    ):
        axes.plot(claimed, [row[key] for row in rows], marker="o", label=name)
    axes.set(xscale="log", yscale="log", xlabel="claimed standard deviation, mm", ylabel="error, mm")
    axes.legend()
    figure.savefig(RESULTS / "reliability.png", dpi=100)
