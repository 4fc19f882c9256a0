"""The site has every page; make docs builds it strictly, so that each link leads somewhere."""

import re
from pathlib import Path

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
