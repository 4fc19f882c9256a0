"""How much each numeric constant of the numerics matters: each is halved and doubled, and results compared.

A variant changes one number in the source as it is imported; no file is written. Each is integrated in a
process of its own, one recording after another until one shows an effect. With ``--keep DIR`` what was
measured is kept, one file a constant, and not measured again: the study can be interrupted. A whole number
changes by one at least.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib.abc
import importlib.machinery
import json
import multiprocessing
import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core.caching import _CacheLocator

from benchmarks.inputs import Remembered, sources
from benchmarks.output import Options, save, save_page, say
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import read_truth

ROOT = Path(__file__).parents[1]
NUMERICS = ("methods", "flattening", "segmentation", "garments", "registration")
FACTORS = (0.5, 2.0)
FORMULA = {0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 90.0, 180.0, 360.0, 255.0, 1e3, 1e4, 1.4826}
"""Numbers inside functions that are part of a formula or change a unit; 1.4826 is the deviation of a normal
distribution in units of its median absolute deviation."""
NO_ROUNDING = 1e-5, 1e9
"""Inside functions, smaller numbers guard against rounding and division by zero, larger ones are infinite."""
LIMIT_S, TIME_NOISE = 300, 0.3
"""A variant is ended after this time, and listed as slower if it takes more by this share."""
COMPARED = {
    "absolute_median_mm": 0.05, "absolute_p95_mm": 0.3, "coverage": 0.005, "firm_far_share": 0.001,
    "within_3_std_share": 0.002,
}  # fmt: skip
"""Figures of ``accuracy``, each with the smallest change that is listed: as processors differ."""
TABLES = ("garments/kinds/", "garments/example.py")
"""Dimensions of garments, with their means, deviations and ranges: data, not free numbers of the method."""


@dataclass(frozen=True)
class Constant:
    """A numeric constant in the source: all numbers of one assignment, or one number inside a function."""

    file: str
    name: str
    literals: tuple[tuple[int, int], ...]
    """Line and column of each number."""
    values: tuple[float, ...]
    text: str
    """What is said about it."""
    is_inline: bool

    @property
    def key(self) -> str:
        """A name for files: the same when the constant moves, another when its value changes."""
        values = "_".join(f"{value:g}" for value in self.values[:4])
        return re.sub(r"[^\w.+-]+", "-", f"{package_of(self.file)}--{self.name}--{values}")


def constants_of(path: Path) -> list[Constant]:
    """Return the constants of a module that could have been chosen otherwise.

    Module-level names in capitals, defaults of the fields of classes, and floats inside functions. Left out
    are numbers ``by definition``, tables with texts in them, whole numbers inside functions, shares of
    progress, and what :data:`FORMULA` and :data:`NO_ROUNDING` name.
    """
    source = path.read_text()
    file = str(path.relative_to(ROOT))
    return [*_assigned(ast.parse(source), source, file), *_inline(ast.parse(source), source, file)]


def _assigned(module: ast.Module, source: str, file: str) -> Iterator[Constant]:
    lines = source.splitlines()
    classes = [
        node
        for node in module.body
        if isinstance(node, ast.ClassDef) and "Enum" not in "".join(map(ast.unparse, node.bases))
    ]
    for owner, body in [("", module.body), *((f"{c.name}.", c.body) for c in classes)]:
        for statement, following in zip(body, [*body[1:], ast.Pass()], strict=True):
            if not isinstance(statement, ast.Assign | ast.AnnAssign) or statement.value is None:
                continue
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            names = [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]
            found = [n for n in ast.walk(statement.value) if isinstance(n, ast.Constant)]
            numbers = [n for n in found if _is_number(n)]
            if not names or not (owner or names[0].isupper()) or not numbers:
                continue
            if any(isinstance(n.value, str) for n in found):
                continue
            told = getattr(following.value, "value", None) if isinstance(following, ast.Expr) else None
            comment = lines[(statement.end_lineno or statement.lineno) - 1].partition("#")[2]
            text = " ".join((told if isinstance(told, str) else comment).split())
            if "y definition" in text:
                continue
            values = statement.value.elts if isinstance(statement.value, ast.Tuple) else []
            apart = len(names) == len(values) > 1
            for k, name in enumerate(names if apart else names[:1]):
                own = [n for n in ast.walk(values[k]) if n in numbers] if apart else numbers
                if own and (not owner or any(n.value not in (0, 1) for n in own)):
                    yield _constant(file, owner + name, own, text, is_inline=False)


def _inline(module: ast.Module, source: str, file: str) -> Iterator[Constant]:
    lines, functions = source.splitlines(), (ast.FunctionDef, ast.AsyncFunctionDef)
    seen: set[tuple[int, int]] = set()
    for function in (node for node in ast.walk(module) if isinstance(node, functions)):
        calls = [node for node in ast.walk(function) if isinstance(node, ast.Call)]
        shares = {n for c in calls if "progress" in ast.unparse(c.func) for a in c.args for n in ast.walk(a)}
        for node in set(ast.walk(function)) - shares:
            if not _is_number(node) or not isinstance(node.value, float) or _place(node) in seen:
                continue
            seen.add(_place(node))
            size = abs(node.value)
            if size not in FORMULA and NO_ROUNDING[0] < size < NO_ROUNDING[1]:
                comment = lines[node.lineno - 1].partition("#")[2].strip()
                yield _constant(file, f"{function.name}()", [node], comment, is_inline=True)


def _is_number(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Constant)
        and isinstance(node.value, int | float)
        and not isinstance(node.value, bool)
    )


def _place(node: Any) -> tuple[int, int]:
    return node.lineno, node.col_offset


def _constant(file: str, name: str, numbers: Sequence[Any], text: str, *, is_inline: bool) -> Constant:
    places, values = tuple(map(_place, numbers)), tuple(float(n.value) for n in numbers)
    return Constant(file, name, places, values, text, is_inline)


def all_constants() -> list[Constant]:
    """Return the constants of the numerics, but for :data:`TABLES`."""
    paths = [p for package in NUMERICS for p in sorted((ROOT / "flatcloth" / package).rglob("*.py"))]
    measured = [path for path in paths if not any(table in path.as_posix() for table in TABLES)]
    return [constant for path in measured for constant in constants_of(path)]


def scaled(module: ast.Module, places: Sequence[tuple[int, int]], factor: float) -> ast.Module:
    """Return the module with the numbers at some places multiplied by a factor."""

    class Scaled(ast.NodeTransformer):
        def visit_Constant(self, node: ast.Constant) -> ast.AST:
            if _place(node) in places and _is_number(node):
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
        self.recording, self.truth = Remembered(open_recording(source)), Remembered(read_truth(source))
        for view in range(len(self.recording)):
            self.recording[view], self.truth[view]

    def figures(self, package: str) -> dict[str, Any]:
        """Integrate; return the figures and a digest of all that was computed."""
        from benchmarks import accuracy, segmented, unattended

        began_s = time.process_time()
        recording: Any = self.recording
        if package == "segmentation":
            recording = segmented.after_one_stroke(recording, self.truth)
        integration, document = unattended.integrated(recording, "paper" if package == "paper" else "robust")
        view = integration.canonical(document).view
        seconds = time.process_time() - began_s
        figures = accuracy.figures_of(integration, document, self.truth)
        digest = hashlib.sha256(repr(document.garment).encode())
        for array in (view.xyz_m, view.valid, view.placement_std_m):
            digest.update(np.ascontiguousarray(array).tobytes())
        return {**figures, "seconds": round(seconds, 2), "digest": digest.hexdigest()[:16]}

    def measured(self, package: str, constant: Constant | None = None, factor: float = 1.0) -> dict[str, Any]:
        """Return the figures of a variant, or its error, from a process that is forked off."""
        here, there = multiprocessing.Pipe(duplex=False)
        child = multiprocessing.get_context("fork").Process(
            target=self._work, args=(there, package, constant, factor)
        )
        with tempfile.TemporaryDirectory() as folder:
            if constant is not None and (stale := stale_kernels(constant)):
                keep_kernels(Path(folder), stale)
                numba.config.CACHE_DIR = folder
            child.start()
            there.close()
            numba.config.CACHE_DIR = ""
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
            there.send({"error": f"{type(error).__name__}: {error}"[:200]})


@functools.cache
def stale_kernels(constant: Constant) -> frozenset[Path]:
    """Return the modules whose compiled functions a change of a constant makes stale; none if none uses it.

    These are the module and those that import it, directly or not: numba compiles constants, and functions of
    other modules, into what it keeps on disk.
    """
    return importers(constant.file) if _is_compiled(constant) else frozenset()


@functools.cache
def importers(file: str) -> frozenset[Path]:
    """Return the module and those with compiled functions that import it, directly or not."""
    sources = _sources()
    found, new = set[Path](), {ROOT / file}
    while new:
        found |= new
        names = [str(p.relative_to(ROOT)).removesuffix(".py").replace("/", ".") for p in new]
        imported = re.compile("|".join(f"^from {re.escape(name)} import" for name in names), re.MULTILINE)
        new = {path for path, text in sources.items() if "njit" in text and imported.search(text)} - found
    return frozenset(path for path in found if "njit" in sources[path])


@functools.cache
def _sources() -> dict[Path, str]:
    return {path: path.read_text() for path in (ROOT / "flatcloth").rglob("*.py")}


def _is_compiled(constant: Constant) -> bool:
    """Return whether a compiled function uses the constant, or another that is made from it."""
    for path in importers(constant.file):
        module = ast.parse(_sources()[path])
        names = {constant.name}
        for node in module.body:
            if isinstance(node, ast.Assign) and names & _names(node):
                names |= _names(*node.targets)
        for node in ast.walk(module):
            if isinstance(node, ast.FunctionDef) and "njit" in "".join(map(ast.unparse, node.decorator_list)):
                if constant.is_inline and path == ROOT / constant.file:
                    if any(_is_number(n) and _place(n) in constant.literals for n in ast.walk(node)):
                        return True
                elif names & _names(node):
                    return True
    return False


def _names(*nodes: ast.AST) -> set[str]:
    return {n.id for node in nodes for n in ast.walk(node) if isinstance(n, ast.Name)}


def keep_kernels(folder: Path, stale: frozenset[Path], tree: Path = ROOT) -> None:
    """Fill a cache folder of numba, for a copy of the program, with links to kernels that are not stale."""
    for kept in (ROOT / "flatcloth").rglob("*.nb[ic]"):
        module = kept.parent.parent / f"{kept.name.partition('.')[0]}.py"
        if module not in stale:
            copy = tree / module.relative_to(ROOT)
            own = folder / _CacheLocator.get_suitable_cache_subpath(str(copy))
            own.mkdir(exist_ok=True)
            (own / kept.name).symlink_to(kept)


def run(options: Options) -> None:
    """Measure, print, and write ``results/constants.json`` and ``.md`` unless ``quick``."""
    kept = Path(options.keep) if options.keep else Path(tempfile.mkdtemp(prefix="constants-"))
    kept.mkdir(parents=True, exist_ok=True)
    constants, rows = all_constants(), []
    for source in sources(options.recordings):
        study(constants, Read(source), kept)
    for constant in constants:
        found, base = measured_before(constant, kept)
        if found["2.0"]:
            rows.append(row_of(constant, found, base))
    if not options.quick:
        rows.sort(key=lambda row: (row["package"], -row["sensitivity"]))
        save("constants", rows, sources(options.recordings))
        save_page("constants", page(rows), sources(options.recordings))


def study(constants: Sequence[Constant], read: Read, kept: Path) -> None:
    """Measure one recording for each constant that no other recording has shown an effect of."""
    for constant in constants:
        package = package_of(constant.file)
        file = kept / f"as-it-is--{package}.json"
        base = json.loads(file.read_text()) if file.exists() else []
        if read.name not in [figures["recording"] for figures in base]:
            base.append(read.measured(package))
            file.write_text(json.dumps(base))
        found, base = measured_before(constant, kept)
        if read.name in [figures["recording"] for figures in found["2.0"]]:
            continue
        if row_of(constant, found, base)["changes"] == "the result":
            continue
        for factor in FACTORS:
            found[str(factor)].append(read.measured(package, constant, factor))
        (kept / f"{constant.key}.json").write_text(json.dumps(found))
        row = row_of(constant, found, base)
        say("   ".join(f"{key} {value}" for key, value in row.items()))


def measured_before(constant: Constant, kept: Path) -> tuple[dict[str, list[dict[str, Any]]], list[Any]]:
    """Return what is kept of a constant, by factor, and the figures of the recordings as they are."""
    file = kept / f"{constant.key}.json"
    found = json.loads(file.read_text()) if file.exists() else {str(factor): [] for factor in FACTORS}
    return found, json.loads((kept / f"as-it-is--{package_of(constant.file)}.json").read_text())


def package_of(file: str) -> str:
    """Return ``paper`` for the method of that name, and the package for all else."""
    return "paper" if file.startswith("flatcloth/methods/paper/") else file.split("/")[1]


def row_of(constant: Constant, found: dict[str, list[dict[str, Any]]], base: list[Any]) -> dict[str, Any]:
    """Return what the variants of a constant change, of all recordings the most."""
    effects, changed, sensitivity = [], False, 0.0
    for figures in found.values():
        worst: dict[str, float] = {}
        for own in figures:
            if "error" in own:
                worst, changed, sensitivity = {}, True, float("inf")
                break
            before = next(figures for figures in base if figures["recording"] == own["recording"])
            changed |= own["digest"] != before["digest"]
            for key, least in COMPARED.items():
                difference = own[key] - before[key]
                if abs(difference) > abs(worst.get(key, 0.0)) and abs(difference) >= least:
                    worst[key] = round(difference, 4)
            ratio = own["seconds"] / before["seconds"]
            if ratio > 1.0 + TIME_NOISE and not stale_kernels(constant):  # else they were compiled
                worst["time"] = round(max(ratio, worst.get("time", 0.0)), 2)
        sensitivity = max(sensitivity, *(abs(v) / COMPARED.get(k, 1.0) for k, v in worst.items()), 0.0)
        effects.append("; ".join(f"{k} {v:+g}" for k, v in worst.items()))
    return {
        "package": package_of(constant.file),
        "file": constant.file,
        "name": constant.name,
        "values": list(constant.values),
        "halved": effects[0],
        "doubled": effects[-1],
        "changes": "nothing" if not changed else "the result" if sensitivity else "the last digits",
        "sensitivity": sensitivity,
    }


def page(rows: Sequence[dict[str, Any]]) -> str:
    """Return the Markdown page."""
    counts = Counter(row["package"] for row in rows)
    lines = "\n".join(
        f"| {row['file'].removeprefix('flatcloth/')} | {row['name']} | "
        f"{', '.join(f'{v:g}' for v in row['values'][:4])} | {row['changes']} | {row['halved'] or '-'} | "
        f"{row['doubled'] or '-'} |"
        for row in rows
    )
    numbers = ", ".join(f"{package} {n}" for package, n in sorted(counts.items()))
    return f"""# Constants of the numerics, halved and doubled

{len(rows)} in all: {numbers}. Differences are the largest of the recordings that were needed to see one; "the
last digits": all are smaller than {COMPARED}.

| file | name | value | it changes | halved | doubled |
|---|---|---|---|---|---|
{lines}
"""
