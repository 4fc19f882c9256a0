"""How much each numeric constant of the numerics matters: each is halved and doubled, and results compared.

A variant changes one number in the source as it is imported; no file is written. Each is integrated in a
process of its own, one recording after another until one shows an effect. A whole number changes by one at
least. What ``results/constants.json`` has is not measured again. With ``--keep DIR`` neither is what was
measured before an interruption; several processes with the same folder share the work.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.abc
import importlib.machinery
import json
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numba
import numpy as np

from benchmarks.free_numbers import ROOT, Constant, Identity, all_constants, is_number, package_of, place_of
from benchmarks.inputs import Remembered, sources
from benchmarks.kept_kernels import keep_kernels, stale_kernels
from benchmarks.output import RESULTS, Options, once, save, say
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import Truth

if TYPE_CHECKING:
    from flatcloth.core.types import FlattenedView
    from flatcloth.engine.garment import GarmentService
    from flatcloth.methods.answers import JoinedSides
    from flatcloth.session.document import Document

FACTORS = (0.5, 2.0)
LIMIT_S, TIME_NOISE = 300, 0.3
"""A variant is ended after this time, and listed as slower if it takes more by this share."""
COMPARED = {
    "absolute_median_mm": 0.05, "absolute_p95_mm": 0.3, "coverage": 0.005,
    "this_seen": 0.005, "this_firm_share": 0.005, "this_firm_median_mm": 0.05, "this_firm_far_share": 0.001,
    "this_within_3_std_share": 0.002, "other_seen": 0.005, "other_firm_share": 0.005,
    "other_firm_median_mm": 0.05, "other_firm_far_share": 0.001, "other_within_3_std_share": 0.002,
    "related_median_mm": 0.2, "related_p95_mm": 0.5, "true_kind_probability": 0.02, "points_median_mm": 1.0,
}  # fmt: skip
"""Figures of ``sides`` and ``garments`` or, for the method ``paper``, of ``accuracy``, each with the smallest
change that is listed: as processors differ."""


CONVERGENCE = "_STILL_M"
"""The constant that ends the minimisation. How far results move with it is taken for their noise: where few
places of a seam hold a large piece, any change moves it by millimetres. ..."""
_NOISE_FACTOR = 1.5
"""... Changes by other constants are listed if they are larger by this factor."""


def scaled(module: ast.Module, places: Sequence[tuple[int, int]], factor: float) -> ast.Module:
    """Return the module with the numbers at some places multiplied by a factor."""

    class Scaled(ast.NodeTransformer):
        def visit_Constant(self, node: ast.Constant) -> ast.AST:
            if place_of(node) in places and is_number(node):
                value: Any = node.value
                changed = value * factor
                if isinstance(value, int):
                    changed = round(changed)
                    changed += (changed == value) * (1 if factor > 1.0 else -1)
                return ast.copy_location(ast.Constant(changed), node)
            return node

    return Scaled().visit(module)


class _Variant(importlib.abc.MetaPathFinder, importlib.machinery.SourceFileLoader):
    """Imports one module with some numbers scaled."""

    def __init__(self, file: str, places: Sequence[tuple[int, int]], factor: float) -> None:
        super().__init__(file.removesuffix(".py").replace("/", "."), str(ROOT / file))
        self.places, self.factor = places, factor

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        if fullname != self.name:
            return None
        return importlib.machinery.ModuleSpec(fullname, self, origin=self.path)

    def get_code(self, fullname: str) -> Any:
        tree = scaled(ast.parse(Path(self.path).read_text()), self.places, self.factor)
        return compile(tree, self.path, "exec")

    def exec_module(self, module: Any) -> None:
        module.__file__ = self.path
        super().exec_module(module)


class Read:
    """A recording and its truth, read once and shared with the forked processes.

    Only the forked processes import the numerics, each with the numbers of its variant.
    """

    def __init__(self, source: str) -> None:
        self.name = Path(source).name
        self.recording, self.truth = Remembered(open_recording(source)), Remembered(Truth(source))
        self._as_it_is: dict[str, dict[str, Any]] = {}
        self._noise: dict[str, dict[str, float]] = {}

    def as_it_is(self, package: str) -> dict[str, Any]:
        """Return the figures without a change, computed once."""
        if package not in self._as_it_is:
            for view in range(len(self.recording)):  # read once, before processes are forked off
                self.recording[view], self.truth[view]
            self._as_it_is[package] = self.measured(package)
        return self._as_it_is[package]

    def noise(self, package: str) -> dict[str, float]:
        """Return how far each figure moves with :data:`CONVERGENCE`, computed once."""
        if package not in self._noise:
            before = self.as_it_is(package)
            (limit,) = (constant for constant in all_constants() if constant.name == CONVERGENCE)
            moved = [self.measured(package, limit, factor) for factor in FACTORS]
            self._noise[package] = {
                key: max(abs(own.get(key, before[key]) - before[key]) for own in moved)
                for key in COMPARED
                if key in before
            }
        return self._noise[package]

    def figures(self, package: str) -> dict[str, Any]:
        """Integrate; return the figures and a digest of all that was computed."""
        began_s = time.process_time()
        figures, arrays, text = (self._one_side if package == "paper" else self._both_sides)(package)
        digest = hashlib.sha256(text.encode())
        for array in arrays:
            if array is not None:  # the method ``paper`` has no standard deviations
                digest.update(np.ascontiguousarray(array).tobytes())
        seconds = time.process_time() - began_s
        return {**figures, "seconds": round(seconds, 2), "digest": digest.hexdigest()[:16]}

    def _one_side(self, package: str) -> tuple[dict[str, Any], list[Any], str]:
        from benchmarks import accuracy, unattended

        integration, document = unattended.integrated(self.recording, package)
        figures = accuracy.figures_of(integration, document, self.truth)
        return figures, _arrays_of(integration.canonical(document).view), ""

    def _both_sides(self, package: str) -> tuple[dict[str, Any], list[Any], str]:
        from benchmarks import segmentation, sides, unattended

        recording: Any = self.recording
        if package == "segmentation":
            recording = segmentation.after_one_stroke(recording, self.truth)
        service, document = unattended.integrated_sides(recording)
        this, joined = sides.written(service, document)
        figures = sides.figures_of(this, joined, self.truth, self.recording)
        figures |= garment_figures(service, document, self.truth, joined)
        arrays = _arrays_of(this)
        if not isinstance(joined, str):
            arrays += _arrays_of(joined.other.view)
        return figures, arrays, repr((document.garment, figures))

    def measured(self, package: str, constant: Constant | None = None, factor: float = 1.0) -> dict[str, Any]:
        """Return the figures of a variant, or its error, from a process that is forked off."""
        here, there = multiprocessing.Pipe(duplex=False)
        child = multiprocessing.get_context("fork").Process(
            target=self._work, args=(there, package, constant, factor)
        )
        with tempfile.TemporaryDirectory() as folder:
            if constant is not None and (stale := stale_kernels(constant)):
                keep_kernels(Path(folder), stale)
                numba.config.CACHE_DIR = folder  # type: ignore[attr-defined]
            child.start()
            there.close()
            numba.config.CACHE_DIR = ""  # type: ignore[attr-defined]
            found: dict[str, Any] = {"error": f"no result after {LIMIT_S} s"}
            if here.poll(LIMIT_S):
                try:
                    found = here.recv()
                except EOFError:
                    found = {"error": "the process died"}
            child.kill()
            child.join()
        return {"recording": self.name, **found}

    def _work(self, there: Any, package: str, constant: Constant | None, factor: float) -> None:
        if constant is not None:
            sys.meta_path.insert(0, _Variant(constant.file, constant.literals, factor))
        try:
            there.send(self.figures(package))
        except Exception as error:  # noqa: BLE001
            text = f"{type(error).__name__}: {error}".replace(str(self.recording.location), self.name)
            there.send({"error": text[:90]})


def _arrays_of(view: FlattenedView) -> list[Any]:
    return [view.xyz_m, view.valid, view.placement_std_m]


def garment_figures(
    service: GarmentService, document: Document, truth: Any, joined: JoinedSides | str
) -> dict[str, float]:
    """Return how probable the true kind of garment is, and how far off the named points are that are seen.

    Nothing is returned for a recording without true points.
    """
    from flatcloth.engine.evaluation import compare_garment, read_true_points

    known = service.of(document)
    points = read_true_points(Path(service.integration.recording.location))
    if points is None:
        return {}
    shape = known.canonical
    compared = compare_garment(known.found, shape.view, shape.floating, truth, points, joined)
    errors_mm = list(compared.seen_mm.values())
    return {
        "true_kind_probability": compared.probability,
        "points_median_mm": float(np.median(errors_mm)) if errors_mm else float("nan"),
    }


def run(options: Options) -> None:
    """Measure what ``results/constants.json`` lacks, print, and write it unless ``quick``."""
    kept = Path(options.keep or tempfile.mkdtemp(prefix="constants-"))
    kept.mkdir(parents=True, exist_ok=True)
    file = RESULTS / "constants.json"
    before = json.loads(file.read_text())["figures"] if file.exists() else []
    rows = {identity(row): row for row in before}
    reads = [Read(source) for source in sources(options.recordings)]
    for constant in all_constants():
        if constant.identity not in rows and (
            row := once(kept / f"{constant.key}.json", partial(measured_row, constant, reads))
        ):
            rows[constant.identity] = row
            say("   ".join(f"{key} {value}" for key, value in row.items()))
    if not options.quick:
        present = sorted(constant.identity for constant in all_constants())
        save("constants", [rows[name] for name in present if name in rows], sources(options.recordings))


def identity(row: dict[str, Any]) -> Identity:
    """Return the constant of a row."""
    return row["file"], row["name"], tuple(row["values"])


def measured_row(constant: Constant, reads: Sequence[Read]) -> dict[str, Any]:
    """Return what a constant changes, halved and doubled, on the first recording that shows an effect.

    Of several recordings without an effect it is the most of each figure.
    """
    effects: dict[float, dict[str, Any]] = {factor: {} for factor in FACTORS}
    changed, count = False, 0
    for read in reads:
        before, noise = read.as_it_is(package_of(constant.file)), read.noise(package_of(constant.file))
        for factor in FACTORS:
            own = read.measured(package_of(constant.file), constant, factor)
            changed |= own.get("digest") != before["digest"]
            effects[factor] |= effect_of(own, before, noise, is_timed=not stale_kernels(constant))
        count += 1
        if any(effects.values()):
            break
    halved, doubled = (
        "; ".join(f"{k} {v:+g}" if isinstance(v, float) else v for k, v in effects[factor].items())
        for factor in FACTORS
    )
    return {
        "file": constant.file,
        "name": constant.name,
        "values": list(constant.values),
        "halved": halved,
        "doubled": doubled,
        "changes": "the result" if halved or doubled else "the last digits" if changed else "nothing",
        "recordings": count,
    }


def effect_of(
    own: dict[str, Any], before: dict[str, Any], noise: dict[str, float], *, is_timed: bool
) -> dict[str, Any]:
    """Return the figures of a variant that moved by more than their noise and than :data:`COMPARED`."""
    if "error" in own:
        return {"error": own["error"]}
    found: dict[str, Any] = {}
    for key, least in COMPARED.items():
        if (key in own) != (key in before):
            found[key] = "gone" if key in before else "new"
        elif key in own and abs(own[key] - before[key]) >= max(least, _NOISE_FACTOR * noise[key]):
            found[key] = round(own[key] - before[key], 4)
    if is_timed and own["seconds"] > (1.0 + TIME_NOISE) * before["seconds"]:
        found["time"] = f"time x {own['seconds'] / before['seconds']:.1f}"
    return found
