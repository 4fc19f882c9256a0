"""What the import contracts of pyproject.toml cannot say: where heavy libraries load, who reads the truth."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]

NEVER_AT_START = {"open3d", "pyrealsense2", "libusb_package", "rosbags", "matplotlib"}


@dataclass(frozen=True)
class Import:
    file: Path
    line: int
    target: str
    at_start: bool
    for_types: bool

    def __str__(self) -> str:
        return f"{self.file.relative_to(ROOT)}:{self.line} imports {self.target}"


def sources() -> list[Path]:
    return sorted((ROOT / "flatcloth").rglob("*.py")) + [p for p in [ROOT / "app.py"] if p.exists()]


def unit(file: Path) -> str:
    """Return the part of the house a file belongs to: a module or a subpackage."""
    parts = file.relative_to(ROOT).with_suffix("").parts
    name = parts[1] if len(parts) > 1 else parts[0]
    return "" if name == "__init__" else name


def imports(file: Path) -> Iterator[Import]:
    tree = ast.parse(file.read_text())

    def walk(node: ast.AST, at_start: bool, for_types: bool) -> Iterator[Import]:
        for child in ast.iter_child_nodes(node):
            inside = at_start and not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
            typed = for_types or (isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test))
            if isinstance(child, ast.Import):
                for alias in child.names:
                    yield Import(file, child.lineno, alias.name, at_start, for_types)
            elif isinstance(child, ast.ImportFrom):
                assert child.level == 0, f"{file}: relative import"
                for alias in child.names:
                    yield Import(file, child.lineno, f"{child.module}.{alias.name}", at_start, for_types)
            else:
                yield from walk(child, inside, typed)

    yield from walk(tree, at_start=True, for_types=False)


@cache
def all_imports() -> list[Import]:
    return [found for file in sources() for found in imports(file)]


def test_heavy_libraries_are_imported_only_where_they_are_used() -> None:
    early = [
        f
        for f in all_imports()
        if f.target.split(".")[0] in NEVER_AT_START and f.at_start and not f.for_types
    ]
    assert [str(f) for f in early] == []


def test_the_truth_is_read_by_the_evaluation_only() -> None:
    truth = [
        f for f in all_imports() if f.target.startswith("flatcloth.recordings.truth") and not f.for_types
    ]
    readers = {unit(f.file) for f in truth}
    assert readers <= {"recordings", "engine", "commands", "validation"}


def test_nothing_is_pickled() -> None:
    pickling = {"pickle", "marshal", "shelve", "joblib", "dill"}
    assert [str(f) for f in all_imports() if f.target.split(".")[0] in pickling] == []
    loads = [
        f"{file}:{node.lineno}"
        for file in sources()
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.keyword) and node.arg == "allow_pickle" and ast.unparse(node.value) != "False"
    ]
    assert loads == []
