"""Every dependency has bounds, and a version that was run with all tests."""

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]


def requirements() -> list[Requirement]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = [text for listed in project["optional-dependencies"].values() for text in listed]
    return [Requirement(text) for text in (*project["dependencies"], *extras)]


def pinned() -> dict[str, str]:
    lines = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if not line.startswith("#")]
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.+!]+", line) for line in lines)  # no addresses
    return {canonicalize_name(name): version for name, version in (line.split("==") for line in lines)}


def test_every_dependency_has_bounds_on_both_sides() -> None:
    for one in requirements():
        operators = {specifier.operator for specifier in one.specifier}
        assert operators >= {">=", "<"}, str(one)


def test_the_constraints_name_a_version_within_the_bounds_for_each() -> None:
    versions = pinned()
    for one in requirements():
        version = versions[canonicalize_name(one.name)]
        assert one.specifier.contains(version), f"{one} and {version}"
