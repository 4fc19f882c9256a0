"""The README and the key table say what the program does."""

import re
from pathlib import Path

import pytest

from benchmarks.tables import PAGES, filled
from flatcloth.viewer.protocol.actions import ACTIONS

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
KEYS = (ROOT / "docs" / "keys.md").read_text()

KEY_CAPS = {
    "ArrowLeft": "←",
    "ArrowRight": "→",
    "ArrowUp": "↑",
    "ArrowDown": "↓",
    "Escape": "Esc",
}


def key_cap(key: str) -> str:
    *held, last = key.split("+") if len(key) > 1 else [key]
    return "+".join([*held, last.upper() if held and len(last) == 1 else KEY_CAPS.get(last, last)])


def key_table() -> str:
    rows = ["| key | button | what it does |", "|---|---|---|"]
    for action in ACTIONS:
        keys = " ".join(f"`{key_cap(key)}`" for key in action.keys)
        rows.append(f"| {keys} | {action.title} | {action.description} |")
    return "\n".join(rows)


def test_the_key_table_is_that_of_the_page() -> None:
    found = re.search(r"<!-- keys.*?-->\n(.*?)\n<!-- end of keys -->", KEYS, re.DOTALL)
    assert found[1] == key_table(), f"paste this into docs/keys.md:\n{key_table()}"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_tables_of_figures_are_those_of_the_results(path: Path) -> None:
    text = path.read_text()
    assert filled(text) == text, "write them: python -m benchmarks tables"


LINKED = ["README.md", "CONTRIBUTING.md", "recordings/README.md", *(f"docs/{p.name}" for p in PAGES[1:])]


@pytest.mark.parametrize("page", LINKED)
def test_links_to_files_lead_somewhere(page: str) -> None:
    text = (ROOT / page).read_text()
    targets = [t for t in re.findall(r"\]\(([^)#]+)\)", text) if "://" not in t]
    missing = [t for t in targets if not (ROOT / page).parent.joinpath(t).exists()]
    assert missing == []


def test_the_recording_in_the_readme_is_a_valid_one(tmp_path: Path) -> None:
    import cv2
    import numpy as np

    from flatcloth.recordings import open_recording

    found = re.search(r"```json\n(.*?)```", README, re.DOTALL)
    (tmp_path / "recording.json").write_text(found[1])
    for kind, pixels in (
        ("color", np.zeros((848, 480, 3), np.uint8)),
        ("depth", np.ones((848, 480), np.uint16)),
        ("mask", np.full((848, 480), 255, np.uint8)),
    ):
        (tmp_path / kind).mkdir()
        for file in re.findall(rf'"{kind}": "([^"]+)"', found[1]):
            assert cv2.imwrite(str(tmp_path / file), pixels)
    assert len(open_recording(tmp_path)) == 2
