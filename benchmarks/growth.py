"""How the result of ``robust`` grows: coverage and error against the number of views, chosen one by one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.inputs import sources
from benchmarks.output import RESULTS, Options, recordings_of, save, say
from benchmarks.unattended import one_by_one
from flatcloth.engine.evaluation import compare

KEPT = ("coverage", "relative_median_mm", "relative_p95_mm", "absolute_median_mm", "absolute_p95_mm")


def run(options: Options) -> None:
    """Measure, print and write ``results/growth.{json,png}`` after every recording."""
    rows: list[dict[str, Any]] = []
    for source in sources(options.recordings):
        new = rows_of(source)
        say(f"{new[0]['recording']}: {len(new)} views")
        rows += new
        save("growth", rows, recordings_of(rows))
        draw(rows, RESULTS / "growth.png")
    print(table(rows))


def rows_of(source: str) -> list[dict[str, Any]]:
    """Return the figures after the start view and after each view that is chosen and accepted."""
    integration, document, truth = one_by_one(source)
    rows = []
    for n in range(len(document.accepted) + 1):
        prefix = replace(document, accepted=document.accepted[:n], pending=None)
        figures = compare(integration.canonical(prefix).view, truth, integration.recording).evaluation
        last = document.accepted[n - 1].view_index if n else document.start_view
        rows.append(
            {
                "recording": integration.recording.name,
                "views": len(prefix.used_views),
                "added_view": last,
                **{key: round(getattr(figures, key), 4) for key in KEPT},
            }
        )
    return rows


def table(rows: list[dict[str, Any]]) -> str:
    """Return coverage and relative p95 (mm) after the views, a line for each recording."""
    lines = ["coverage / relative p95 mm after the views"]
    for name, own in _by_recording(rows).items():
        chosen = [r for r in own if r["views"] in (1, 2, 4, 8, 12, 16) or r is own[-1]]
        cells = [f"{r['views']}: {r['coverage']:.3f} / {r['relative_p95_mm']:.1f}" for r in chosen]
        lines.append(f"{name:<24}{'   '.join(cells)}")
    return "\n".join(lines)


def draw(rows: list[dict[str, Any]], file: Path) -> None:
    """Draw both against the number of views."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (top, bottom) = pyplot.subplots(2, 1, figsize=(8, 8), sharex=True, layout="constrained")
    for name, own in _by_recording(rows).items():
        views = [r["views"] for r in own]
        top.plot(views, [r["coverage"] for r in own], marker=".", label=name)
        bottom.plot(views, [r["relative_p95_mm"] for r in own], marker=".", label=name)
    top.set(ylabel="coverage of the reachable cloth", ylim=(0, 1))
    bottom.set(ylabel="relative error, 95th percentile (mm)", xlabel="views integrated")
    bottom.set_ylim(bottom=0)
    for axes in (top, bottom):
        axes.grid(alpha=0.3)
    top.legend(fontsize="small")
    figure.savefig(file, dpi=110)
    pyplot.close(figure)


def _by_recording(rows: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    grouped: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        grouped.setdefault(row["recording"], []).append(row)
    return grouped
