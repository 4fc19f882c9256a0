"""What a change of the source makes stale of the compiled functions that numba keeps on disk."""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path

from numba.core.caching import _CacheLocator

from benchmarks.free_numbers import ROOT, Constant, is_number, place_of


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
                    if any(is_number(n) and place_of(n) in constant.literals for n in ast.walk(node)):
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
