"""The site has every page, and its hooks lead links to where files are; make docs builds it strictly."""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from types import SimpleNamespace

import pytest

import flatcloth

ROOT = Path(__file__).parents[2]


def test_every_page_is_in_the_navigation() -> None:
    navigation = (ROOT / "mkdocs.yml").read_text().partition("\nnav:\n")[2]
    listed = set(re.findall(r"[\w/]+\.(?:md|ipynb)", navigation))
    assert {page.name for page in (ROOT / "docs").glob("*.md")} <= listed
    for name in listed:
        assert (ROOT / "docs" / name).exists() or (ROOT / name).exists(), name


def test_the_reference_has_every_public_name() -> None:
    reference = (ROOT / "docs" / "reference.md").read_text()
    shown = {name.rpartition(".")[2] for name in re.findall(r"^::: (\S+)$", reference, re.MULTILINE)}
    assert shown == set(flatcloth.__all__) - {"__version__"}


@pytest.mark.parametrize(
    ("page", "link", "led"),
    [
        ("looking.md", "../benchmarks/results/page.json", "benchmarks/results/page.json"),
        ("api.md", "grasps.md", "grasps.md"),
        ("CONTRIBUTING.md", "docs/garments.md", "garments.md"),
        ("recordings/README.md", "../docs/active.md", "../active.md"),
        ("index.md", "../examples/flatcloth.ipynb", "examples/flatcloth.ipynb"),
        ("api.md", "https://example.org/a.md", "https://example.org/a.md"),
    ],
)
def test_links_lead_to_where_files_are_in_the_site(page: str, link: str, led: str) -> None:
    pytest.importorskip("mkdocs")
    hooks = runpy.run_path(str(ROOT / "docs" / "site.py"))
    shown = SimpleNamespace(file=SimpleNamespace(src_uri=page))
    assert hooks["on_page_markdown"](f"[a]({link})", page=shown) == f"[a]({led})"
