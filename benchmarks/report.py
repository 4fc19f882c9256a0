"""Tables and the picture of the flattening benchmark, from its result alone."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers import BOUND, FLATCLOTH

COLORS = {
    FLATCLOTH: "#d62728",
    BOUND: "#7f7f7f",
    "libigl ARAP": "#1f77b4",
    "libigl SLIM": "#17becf",
    "SciPy least_squares": "#2ca02c",
    "Open3D uvatlas": "#9467bd",
    "scikit-learn Isomap": "#8c564b",
}

Row = dict[str, Any]


def table(result: dict[str, Any]) -> str:
    """Return the Markdown page."""
    machine = result["machine"]
    lines = [
        "# Flattening, measured",
        "",
        "Written by `make bench`. One core of "
        f"{machine['cpu']}; Python {machine['python']}, NumPy {machine['numpy']}, SciPy {machine['scipy']}; "
        f"libigl {machine['libigl']}, Open3D {machine['open3d']}, scikit-learn {machine['scikit-learn']}. "
        f"After warm-up, medians; load of the machine at the start: {machine['load_before']}.",
        "",
        *_peers(result["rows"]),
        *_solver(result["rows"]),
        *_growth(result["rows"]),
        *_frames(result),
        *_sheets(result["sheets"]),
        *_views(result["views"]),
        "## Notes",
        "",
        *[f"- {name}: {note}." for name, note in result["notes"].items()],
        "- Every solver gets the same points. H is Eq. (2); the meshless ones get its pairs, the others the",
        "  triangles whose sides are pairs. RMS is against the exact flat coordinates, after a rigid fit.",
        "- On exact sheets the best H is nearly 0, and its ratio means little.",
        "",
    ]
    return "\n".join(lines)


def _peers(rows: list[Row]) -> list[str]:
    lines = [
        "## Against the peers",
        "",
        "Medians over the problems that both solved: their time and their error over flatcloth's.",
        "",
        "| method | d = 12 | d = 6 | d = 2 | error, exact | error, with noise | error, garments | problems |",
        "|---|---|---|---|---|---|---|---|",
    ]
    own = {_key(r): r for r in rows if r["method"] == FLATCLOTH}
    for method in _methods(rows):
        if method == FLATCLOTH:
            continue
        done = [r for r in rows if r["method"] == method and r["ms"] is not None]
        cells = []
        for d in (12, 6, 2):
            ratios = [r["ms"] / own[_key(r)]["ms"] for r in done if r["sampling_interval_px"] == d]
            cells.append(_times(ratios))
        for group in (_exact, _noisy, _garment):
            chosen = [r for r in done if group(r) and r["rms_mm"] is not None]
            cells.append(_times([r["rms_mm"] / max(own[_key(r)]["rms_mm"], 1e-4) for r in chosen]))
        lines.append(f"| {method} | {' | '.join(cells)} | {len(done)} |")
    return [*lines, ""]


def _solver(rows: list[Row]) -> list[str]:
    lines = [
        "## flatcloth's solver, problem by problem",
        "",
        "| surface | noise mm | d | points | ms | over the bound | RMS mm | best peer's RMS mm | H over best "
        "| flips |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    by_key: dict[tuple[Any, ...], dict[str, Row]] = {}
    for row in rows:
        by_key.setdefault(_key(row), {})[row["method"]] = row
    for methods in by_key.values():
        own = methods[FLATCLOTH]
        peers = [
            r for name, r in methods.items() if name not in (FLATCLOTH, BOUND) and r["rms_mm"] is not None
        ]
        best = min(peers, key=lambda r: r["rms_mm"], default=None)
        beaten = "" if best is None else f"{best['rms_mm']:.2f} ({best['method']})"
        lines.append(
            f"| {own['surface']} | {own['noise_mm'] or ''} | {own['sampling_interval_px']} "
            f"| {own['n_points']} | {own['ms']:.1f} | {own['ms'] / methods[BOUND]['ms']:.1f} "
            f"| {own['rms_mm']:.3f} | {beaten} "
            f"| {own['energy_ratio']:.4g} | {own['flips']} |"
        )
    return [*lines, ""]


def _growth(rows: list[Row]) -> list[str]:
    lines = [
        "## Growth with the number of points",
        "",
        "Time as N to a power, fitted over the problems of 100 points or more; the median at each interval.",
        "",
        "| method | power | d = 12 ms | d = 6 ms | d = 2 ms | d = 1 ms |",
        "|---|---|---|---|---|---|",
    ]
    for method in _methods(rows):
        done = [r for r in rows if r["method"] == method and r["ms"] is not None]
        cells = []
        for d in (12, 6, 2, 1):
            times = [r["ms"] for r in done if r["sampling_interval_px"] == d]
            cells.append(f"{statistics.median(times):.1f}" if times else "")
        power = exponent(done)
        lines.append(f"| {method} | {'' if power is None else f'{power:.2f}'} | {' | '.join(cells)} |")
    return [*lines, ""]


def _frames(result: dict[str, Any]) -> list[str]:
    lines = [
        "## A whole frame",
        "",
        "480 x 848 pixels to flattened views of 2 mm, d = 6, decoding excluded.",
        "",
    ]
    for frame in result["frames"]:
        stages = sorted(frame["stages_ms"].items(), key=lambda item: -item[1])
        lines += [
            f"`{frame['recording']}`: **{frame['frame_ms']:.1f} ms** (median of {frame['views']} views; "
            f"slowest {frame['slowest_ms']:.1f} ms): "
            + ", ".join(f"{name} {ms:.1f}" for name, ms in stages)
            + ".",
            "",
        ]
    return lines


def _sheets(sheets: list[Row]) -> list[str]:
    lines = [
        "## Whole frames of exact sheets",
        "",
        "Every component fitted on its own. With noise: medians over three noises of 1.5 mm, white noise "
        "smoothed over some pixels. Beside the error: how far the noise left in the surface's depth moves "
        "pixels along the surface, which no flattening of that depth can undo.",
        "",
        "| sheet | noise | RMS mm | 95th % mm | moved by noise mm | covered | components | flips |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r['surface']} | {_noise(r)} | {r['rms_mm']:.3f} | {r['p95_mm']:.2f} "
        f"| {r['noise_share_mm']:.2f} | {r['covered_share']:.0%} | {r['components']:g} | {r['flips']:g} |"
        for r in sheets
    ]
    return [*lines, ""]


def _views(views: list[Row]) -> list[str]:
    lines = [
        "## Single views of recordings against the truth",
        "",
        "95th percentile of the error over a view's pixels, each component fitted on its own (10 % trimmed).",
        "",
        "| recording | views | median mm | worst mm | covered, median | covered, least | flips |",
        "|---|---|---|---|---|---|---|",
    ]
    for r in views:
        lost = f" ({r['views_lost']} lost)" if r["views_lost"] else ""
        lines.append(
            f"| {r['recording']} | {r['views']}{lost} | {r['p95_median_mm']:.2f} | {r['p95_worst_mm']:.1f} "
            f"| {r['covered_share_median']:.0%} | {r['covered_share_least']:.0%} | {r['flips']} |"
        )
    return [*lines, ""]


def exponent(rows: Iterable[Row]) -> float | None:
    """Return p of the fit ms = c N^p, or None with too narrow a range."""
    points = [(math.log(r["n_points"]), math.log(r["ms"])) for r in rows if r["n_points"] >= 100]
    if len(points) < 3 or max(p[0] for p in points) - min(p[0] for p in points) < math.log(3):
        return None
    return float(np.polyfit(*zip(*points, strict=True), 1)[0])


def draw(result: dict[str, Any], path: Path) -> None:
    """Draw time against N and error against time."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    rows = result["rows"]
    figure, (growth, exact, noisy) = plt.subplots(1, 3, figsize=(17, 6), layout="constrained")
    for method in _methods(rows):
        done = [r for r in rows if r["method"] == method and r["ms"] is not None]
        style = {"color": COLORS.get(method, "black"), "zorder": 3 if method == FLATCLOTH else 2}
        marker = "x" if method == BOUND else "o"
        n, ms = np.array([r["n_points"] for r in done]), np.array([r["ms"] for r in done])
        growth.scatter(n, ms, s=14, marker=marker, alpha=0.6, linewidths=0.8, **style)
        power = exponent(done)
        label = method if power is None else f"{method}: N^{power:.2f}"
        if power is not None:
            big = n >= 100
            c = np.exp(np.mean(np.log(ms[big]) - power * np.log(n[big])))
            ends = np.array([n[big].min(), n[big].max()])
            growth.plot(
                ends, c * ends**power, linewidth=2.2 if method == FLATCLOTH else 1.2, label=label, **style
            )
        else:
            growth.plot([], [], "o", label=label, **style)
        for axes, group in ((exact, _exact), (noisy, lambda r: not _exact(r))):
            chosen = [r for r in done if r["rms_mm"] is not None and group(r)]
            for d, size in ((12, 12), (6, 28), (2, 60), (1, 110)):
                at = [r for r in chosen if r["sampling_interval_px"] == d]
                if at:
                    axes.scatter(
                        [r["ms"] for r in at],
                        [r["rms_mm"] for r in at],
                        s=size,
                        alpha=0.6,
                        linewidths=0,
                        **style,
                    )
    for axes, title in (
        (growth, "Time against the number of points"),
        (exact, "Error against time: exact sheets"),
        (noisy, "Error against time: noise of 1.5 mm, and garments"),
    ):
        axes.set(xscale="log", yscale="log", title=title)
        axes.grid(which="major", alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    growth.set(xlabel="points N", ylabel="time, ms (one core)")
    growth.legend(frameon=False, fontsize=9, loc="upper left")
    for axes in (exact, noisy):
        axes.set(xlabel="time, ms (one core)", ylabel="RMS error against the truth, mm")
    for size, d in ((12, 12), (28, 6), (60, 2), (110, 1)):
        exact.scatter([], [], s=size, color="gray", linewidths=0, label=f"d = {d} px")
    exact.set_ylim(top=30 * exact.get_ylim()[1])
    exact.legend(frameon=False, fontsize=9, loc="upper right", ncols=4, title="bottom left is better")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _noise(row: Row) -> str:
    return f"{row['noise_mm']:g} mm, over {row['noise_smoothing_px']:g} px" if row["noise_mm"] else ""


def _key(row: Row) -> tuple[Any, ...]:
    return row["surface"], row["noise_mm"], row["sampling_interval_px"]


def _methods(rows: list[Row]) -> list[str]:
    return list(dict.fromkeys(r["method"] for r in rows))


def _exact(row: Row) -> bool:
    return not _noisy(row) and not _garment(row)


def _noisy(row: Row) -> bool:
    return bool(row["noise_mm"])


def _garment(row: Row) -> bool:
    return bool(row["garment"])


def _times(ratios: list[float]) -> str:
    return f"{statistics.median(ratios):.3g}" if ratios else ""
