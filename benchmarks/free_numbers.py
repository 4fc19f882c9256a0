"""The free numbers of the numerics: what could have been chosen otherwise, found in the source."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

ROOT = Path(__file__).parents[1]
NUMERICS = ("shape", "methods", "flattening", "segmentation", "garments", "registration")
FORMULA = {0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 90.0, 180.0, 360.0, 255.0, 1e3, 1e4, 1.4826}
"""Numbers inside functions that are part of a formula or change a unit; 1.4826 is the deviation of a normal
distribution in units of its median absolute deviation."""
NO_ROUNDING = 1e-5, 1e9
"""Inside functions, smaller numbers guard against rounding and division by zero, larger ones are infinite."""
TABLES = ("garments/kinds/", "garments/example.py")
"""Dimensions of garments, with their means, deviations and ranges: data, not free numbers of the method."""
Identity = tuple[str, str, tuple[float, ...]]
"""File, name and values of a constant."""


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
    def identity(self) -> Identity:
        """What it is known by: another when its value changes."""
        return self.file, self.name, self.values

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
            numbers = [n for n in found if is_number(n)]
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
            if not is_number(node) or not isinstance(node.value, float) or place_of(node) in seen:
                continue
            seen.add(place_of(node))
            size = abs(node.value)
            if size not in FORMULA and NO_ROUNDING[0] < size < NO_ROUNDING[1]:
                comment = lines[node.lineno - 1].partition("#")[2].strip()
                yield _constant(file, f"{function.name}()", [node], comment, is_inline=True)


def is_number(node: ast.AST) -> TypeGuard[ast.Constant]:
    """Return whether a node is a number, and no truth value."""
    return (
        isinstance(node, ast.Constant)
        and isinstance(node.value, int | float)
        and not isinstance(node.value, bool)
    )


def place_of(node: Any) -> tuple[int, int]:
    """Return line and column of a node."""
    return node.lineno, node.col_offset


def _constant(file: str, name: str, numbers: Sequence[Any], text: str, *, is_inline: bool) -> Constant:
    places, values = tuple(map(place_of, numbers)), tuple(float(n.value) for n in numbers)
    return Constant(file, name, places, values, text, is_inline)


def all_constants() -> list[Constant]:
    """Return the constants of the numerics, but for :data:`TABLES`."""
    paths = [p for package in NUMERICS for p in sorted((ROOT / "flatcloth" / package).rglob("*.py"))]
    measured = [path for path in paths if not any(table in path.as_posix() for table in TABLES)]
    return [constant for path in measured for constant in constants_of(path)]


def package_of(file: str) -> str:
    """Return ``paper`` for the method of that name, and the package for all else."""
    return "paper" if file.startswith("flatcloth/methods/paper/") else file.split("/")[1]
