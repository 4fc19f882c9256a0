"""What keeps the code small: a budget of lines for each room, and a source beside each constant."""

import ast
import json
import re
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.constants import identity
from benchmarks.free_numbers import all_constants, package_of

ROOT = Path(__file__).parents[2]
PYTHON = [
    path for folder in ("flatcloth", "benchmarks", "tests") for path in sorted((ROOT / folder).rglob("*.py"))
]
BUDGETS = Path(__file__).with_name("budgets.toml")


def lines_of(room: str) -> int:
    """Return the lines of the Python (in static: JavaScript) files of a room."""
    ending = "*.js" if room == "static" else "*.py"
    return sum(path.read_text().count("\n") for path in (ROOT / room).rglob(ending))


@pytest.mark.parametrize(("room", "budget"), tomllib.loads(BUDGETS.read_text())["lines"].items())
def test_no_room_has_more_lines_than_its_budget(room: str, budget: int) -> None:
    """What a change adds to a room it takes out there; a lower number is written when it is reached."""
    assert lines_of(room) <= budget, f"{room}: take out what the change makes unnecessary"


MOST_CONSTANTS = 178
NUMERICS = ("shape", "flattening", "registration", "segmentation", "methods", "garments", "grasping")
SOURCE = re.compile(
    r"[Pp]aper|[Ss]ection|Eq\.|data ?sheet|D435|Measured|measured (by|on|with)|[Ll]earned|benchmarks|evaluate"
    r"|docs/|tests/|NUMERICS|\b(19|20)\d\d\b|[Cc]hosen|[Ss]et by hand|[Bb]y definition|``_?[A-Z]"
)
"""Where a number comes from; "Chosen" and "Set by hand" say that no measurement is behind it."""


def constants(source: str) -> Iterator[tuple[str, str]]:
    """Yield the numeric constants of a module, and the docstring after or the comment on their line."""
    lines, body = source.splitlines(), ast.parse(source).body
    for statement, following in zip(body, [*body[1:], ast.Pass()], strict=True):
        if not isinstance(statement, ast.Assign | ast.AnnAssign) or statement.value is None:
            continue
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        names = [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name) and n.id.isupper()]
        inside = list(ast.walk(statement.value))
        values = [node.value for node in inside if isinstance(node, ast.Constant)]
        numeric = any(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
        if not names or not numeric or any(isinstance(v, str) for v in values):
            continue
        text = getattr(following.value, "value", None) if isinstance(following, ast.Expr) else None
        comment = lines[(statement.end_lineno or statement.lineno) - 1].partition("#")[2]
        yield names[0], text if isinstance(text, str) else comment


def numbers_without_a_word(source: str) -> list[str]:
    """Return the constants of a module that nothing is said about."""
    return [name for name, text in constants(source) if not text.strip()]


def numbers_without_a_source(source: str) -> list[str]:
    """Return the constants without a source; a text that ends with "..." goes on at the next constant."""
    found, begun, told = [], "", ""
    for name, text in constants(source):
        begun, told = begun or name, " ".join([told, *text.split()])
        if not text.rstrip().endswith("..."):
            if not SOURCE.search(told):
                found.append(begun)
            begun, told = "", ""
    return found


def test_each_constant_says_what_it_is() -> None:
    """Beside each number stands what it means and its source: paper, datasheet, command, or choice."""
    found = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in PYTHON
        if path.is_relative_to(ROOT / "flatcloth")
        for name in numbers_without_a_word(path.read_text())
    ]
    assert found == []


def test_each_constant_of_the_numerics_has_a_source() -> None:
    found = [
        f"{path.relative_to(ROOT)}: {name}"
        for package in NUMERICS
        for path in sorted((ROOT / "flatcloth" / package).rglob("*.py"))
        for name in numbers_without_a_source(path.read_text())
    ]
    assert found == []


def test_the_numerics_have_no_more_constants_than_before() -> None:
    """Inline floats and defaults of fields count, too; lower the limit with their number, never raise it."""
    count = Counter(package_of(constant.file) for constant in all_constants())
    assert sum(count.values()) <= MOST_CONSTANTS, count


def test_what_constants_change_is_measured() -> None:
    """docs/numbers.md says what each changes, halved and doubled."""
    rows = json.loads((ROOT / "benchmarks" / "results" / "constants.json").read_text())["figures"]
    measured = {identity(row) for row in rows}
    unknown = [constant.identity for constant in all_constants() if constant.identity not in measured]
    assert not unknown, f"{unknown}: python -m benchmarks constants --recordings ... --keep DIR"
