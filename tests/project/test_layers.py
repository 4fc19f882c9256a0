"""What ruff and the import contracts of pyproject.toml cannot say: no array of objects is unpickled."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_nothing_is_pickled() -> None:
    loads = [
        f"{file}:{node.value.lineno}"
        for file in sorted((ROOT / "flatcloth").rglob("*.py"))
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.keyword) and node.arg == "allow_pickle" and ast.unparse(node.value) != "False"
    ]
    assert loads == []
