"""Are the claimed standard deviations true?

Each recording is integrated without an operator, and the errors of all its pixels against the truth are
compared with their standard deviations. ``benchmarks.accuracy`` has the share within three of them.
"""

from __future__ import annotations

import gc
from collections.abc import Sequence
from itertools import pairwise

import matplotlib
import numpy as np

from benchmarks.inputs import sources
from benchmarks.markdown import table
from benchmarks.output import RESULTS, Options, Row, save, save_page, say
from benchmarks.unattended import unattended
from flatcloth.core.types import Float64
from flatcloth.engine.evaluation import claimed_std_m, trimmed_motion, true_places

_EDGES_MM = (1.5, 2.25, 2.75, 3.5, 5.0, 7.0, 10.0, 15.0, 25.0, 50.0)
_LEAST_PIXELS = 200


def run(options: Options) -> None:
    """Measure and print; write ``results/reliability.json``, ``.md`` and ``.png`` unless ``quick``."""
    names, errors_mm, stds_mm = sources(options.recordings), list[Float64](), list[Float64]()
    for name in names:
        integration, document, truth = unattended(name)
        view = integration.canonical(document).view
        at, true, known = true_places(view, truth)
        std_m = claimed_std_m(view, known)
        errors_mm.append(1e3 * np.linalg.norm(trimmed_motion(at, true, std_m).apply(at) - true, axis=1))
        stds_mm.append(1e3 * std_m)
        del integration, view
        gc.collect()  # an integration and its caches refer to one another
        say(name)
    rows = curve(np.concatenate(errors_mm), np.concatenate(stds_mm))
    say(page(rows))
    if not options.quick:
        save("reliability", rows, names)
        save_page("reliability", page(rows), names)
        _draw(rows)


def curve(error_mm: Float64, std_mm: Float64) -> list[Row]:
    """Return for each bin of claimed standard deviations: the claim, the errors' RMS and quantiles, mm."""
    rows = []
    for low, high in pairwise(_EDGES_MM):
        own = (std_mm >= low) & (std_mm < high)
        if own.sum() >= _LEAST_PIXELS:
            rows.append(
                {
                    "claimed_mm": round(float(np.median(std_mm[own])), 2),
                    "error_rms_mm": round(float(np.sqrt(np.square(error_mm[own]).mean())), 2),
                    "error_median_mm": round(float(np.median(error_mm[own])), 2),
                    "error_p95_mm": round(float(np.percentile(error_mm[own], 95)), 2),
                    "share": round(float(own.mean()), 4),
                }
            )
    return rows


def page(rows: Sequence[Row]) -> str:
    """Return the Markdown page."""
    head = ("claimed mm", "error RMS mm", "median mm", "p95 mm", "share of the pixels")
    return f"""# Are standard deviations true?

![Reliability curve](reliability.png)

Pixels by claimed standard deviation, all recordings:

{table(head, (row.values() for row in rows))}
"""


def _draw(rows: Sequence[Row]) -> None:
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(5, 4.5), layout="constrained")
    limits = (1.0, 60.0)
    axes.plot(limits, limits, color="0.6", linestyle="--", label="RMS error as claimed")
    for key, name in (("rms", "RMS"), ("median", "median"), ("p95", "95th percentile")):
        claimed, errors = ([row[k] for row in rows] for k in ("claimed_mm", f"error_{key}_mm"))
        axes.plot(claimed, errors, marker="o", label=name)
    axes.set(xscale="log", yscale="log", xlabel="claimed standard deviation, mm", ylabel="error, mm")
    axes.legend()
    figure.savefig(RESULTS / "reliability.png", dpi=100)
