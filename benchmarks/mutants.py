"""Whether the tests of the numerics notice changes: single mutations at random, each against its own folder.

Cosmic Ray changes one operator, comparison or number of a module of the numerics; the tests of the folder of
the same name must fail then. A mutant that they do not notice is used to integrate recordings: if no result
changes, to the last bit, it does not count as a change of behaviour. The sample is drawn with a fixed seed.
With ``--keep DIR`` what was found of each mutant is kept, and not repeated; several processes with the same
folder share the work.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from cosmic_ray import plugins
from cosmic_ray.ast import get_ast
from cosmic_ray.mutating import mutate_code

from benchmarks.free_numbers import NUMERICS, ROOT, package_of
from benchmarks.inputs import sources
from benchmarks.kept_kernels import importers, keep_kernels
from benchmarks.output import Options, once, save, say

SEED, COUNT, QUICK_COUNT = 29, 300, 20
LIMIT_S = 300
"""A mutant whose tests take longer is noticed: loops that do not end."""
OPERATORS = re.compile(
    r"core/(ReplaceBinaryOperator_(Add_Sub|Sub_Add|Mul_Div|Div_Mul|BitAnd_BitOr|BitOr_BitAnd)"
    r"|ReplaceComparisonOperator_(Lt_GtE|LtE_Gt|Gt_LtE|GtE_Lt|Lt_LtE|Gt_GtE|Eq_NotEq|NotEq_Eq|Is_IsNot|IsNot_Is)"
    r"|ReplaceAndWithOr|ReplaceOrWithAnd|ReplaceTrueWithFalse|ReplaceFalseWithTrue|AddNot|NumberReplacer"
    r"|ReplaceUnaryOperator_(USub_UAdd|Invert_.*|Delete_(USub|Invert|Not)))$"
)
"""Of Cosmic Ray's operators those that a slip of the pen could be."""

INTEGRATED = """
import json, sys
from benchmarks.constants import Read
print(json.dumps(Read(sys.argv[1]).figures(sys.argv[2])))
"""


def run(options: Options) -> None:
    """Try, print, and write ``results/mutants.json`` after each unless ``quick``.

    The share that is printed is that of the noticed ones among all that change behaviour.
    """
    kept = Path(options.keep or tempfile.mkdtemp(prefix="mutants-"))
    kept.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    digests = Digests(kept, sources(options.recordings))
    for file, operator, occurrence in sample(QUICK_COUNT if options.quick else COUNT):
        own = kept / f"{file.replace('/', '-')}--{operator.partition('/')[2]}-{occurrence}.json"
        row = once(own, partial(row_of, file, operator, occurrence, digests))
        if row is None:
            continue
        rows.append(row)
        counts = Counter(row["found"] for row in rows)
        share = counts["noticed"] / max(counts["noticed"] + counts["missed"], 1)
        say("   ".join([*map(str, rows[-1].values()), f"{share:.1%} of {len(rows)}"]))
        if not options.quick:
            ordered = sorted(rows, key=lambda row: (row["found"], row["file"]))
            figures = {"seed": SEED, "of": COUNT, "counts": counts, "rows": ordered}
            save("mutants", figures, sources(options.recordings))


def sample(count: int) -> list[tuple[str, str, int]]:
    """Return files, operators and occurrences: modules are drawn by their number of possible mutations."""
    sites = []
    for package in NUMERICS:
        for path in sorted((ROOT / "flatcloth" / package).rglob("*.py")):
            tree = get_ast(path.read_text())
            for name in sorted(filter(OPERATORS.match, plugins.operator_names())):
                operator = plugins.get_operator(name)()
                found = sum(len(list(operator.mutation_positions(node))) for node in _nodes(tree))
                sites += [(str(path.relative_to(ROOT)), name, k) for k in range(found)]
    # By a hash, so that a change of one file leaves the mutants of the others as they were drawn before.
    sites.sort(key=lambda site: hashlib.sha256(f"{SEED} {site}".encode()).digest())
    chosen = []
    for file, name, k in sites:
        source = (ROOT / file).read_text()
        mutated = mutate_code(source, plugins.get_operator(name)(), k)
        if mutated is not None and _code(mutated) not in (None, _code(source)):
            chosen.append((file, name, k))
        if len(chosen) == count:
            break
    return chosen


def _nodes(node: Any) -> Any:
    yield node
    for child in getattr(node, "children", ()):
        yield from _nodes(child)


def _code(source: str) -> str | None:
    """Return the code without annotations, which change nothing; None if Python cannot read it."""
    try:
        module = ast.parse(source)
    except SyntaxError:
        return None
    for node in ast.walk(module):
        if isinstance(node, ast.arg | ast.AnnAssign):
            node.annotation = ast.Constant(0)
        if isinstance(node, ast.FunctionDef):
            node.returns = None
    return ast.dump(module)


@dataclass(frozen=True)
class Digests:
    """Digests of what is computed from recordings without a change; each is computed once and kept."""

    kept: Path
    recordings: list[str]

    def is_same(self, package: str, tree: Path, environment: Mapping[str, str]) -> bool:
        """Return whether a copy of the program with a mutant computes the same from each recording."""
        for recording in self.recordings:
            file = self.kept / f"as-it-is--{package}--{Path(recording).name}.json"
            if not file.exists():
                file.write_text(self._digest_of(recording, package, ROOT, os.environ))
            try:
                own = self._digest_of(recording, package, tree, environment)
            except (subprocess.SubprocessError, ValueError):
                return False
            if own != file.read_text():
                return False
        return True

    def _digest_of(self, recording: str, package: str, tree: Path, environment: Mapping[str, str]) -> str:
        words = [sys.executable, "-c", INTEGRATED, str(Path(recording).resolve()), package]
        done = subprocess.run(
            words, cwd=tree, env=environment, capture_output=True, text=True, timeout=LIMIT_S, check=True
        )
        return str(json.loads(done.stdout)["digest"])


def row_of(file: str, operator: str, occurrence: int, digests: Digests) -> dict[str, Any]:
    """Return what became of one mutant: noticed, missed, or without effect."""
    source = (ROOT / file).read_text()
    mutated = mutate_code(source, plugins.get_operator(operator)(), occurrence)
    assert mutated is not None
    lines = zip(source.splitlines(), mutated.splitlines(), strict=True)
    line = next(n for n, (old, new) in enumerate(lines, start=1) if old != new)
    row = {"file": file, "line": line, "mutant": mutated.splitlines()[line - 1].strip()}
    with tempfile.TemporaryDirectory() as name:
        tree, kernels = Path(name) / "tree", Path(name) / "kernels"
        copied = ("flatcloth", "tests", "benchmarks", "recordings", "static", "pyproject.toml", "app.py")
        tree.mkdir()
        subprocess.run(["cp", "-al", *copied, str(tree)], cwd=ROOT, check=True)
        (tree / file).unlink()
        (tree / file).write_text(mutated)
        kernels.mkdir()
        keep_kernels(kernels, importers(file), tree)
        environment = {
            **os.environ,
            "PYTHONPATH": str(tree),
            "NUMBA_CACHE_DIR": str(kernels),
            "OPENBLAS_NUM_THREADS": "1",
        }
        words = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests_of(file)]
        if not _passes(words, tree, environment):
            return {**row, "found": "noticed"}
        if not digests.is_same(package_of(file), tree, environment):
            return {**row, "found": "missed"}
    return {**row, "found": "without effect"}


def tests_of(file: str) -> list[str]:
    """Return the test files of a module's folder, those that import the module first."""
    name = file.removesuffix(".py").replace("/", ".")
    parent, _, stem = name.rpartition(".")
    imported = re.compile(rf"from {re.escape(name)} import|from {re.escape(parent)} import .*\b{stem}\b")
    tests = sorted((ROOT / "tests" / file.split("/")[1]).rglob("test_*.py"))
    ordered = sorted(tests, key=lambda path: imported.search(path.read_text()) is None)
    return [str(path.relative_to(ROOT)) for path in ordered]


def _passes(words: list[str], tree: Path, environment: Mapping[str, str]) -> bool:
    try:
        done = subprocess.run(words, cwd=tree, env=environment, capture_output=True, timeout=LIMIT_S)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0
