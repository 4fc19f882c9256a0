"""The side of interest of a recording without masks: found, painted by mouse, touch and keys, undone."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

pytestmark = pytest.mark.browser

RECORDING = Path(__file__).parents[2] / "recordings" / "shirt-sleeve-clean"
KNOWN = "flatcloth.state?.sides && flatcloth.state.sides.certainty !== null"
IDLE = "flatcloth.state.request === null"


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every third view of a bundled recording, without its masks."""
    folder = tmp_path_factory.mktemp("bare") / "shirt"
    shutil.copytree(RECORDING, folder)
    header = json.loads((folder / "recording.json").read_text())
    header["views"] = [{k: v for k, v in view.items() if k != "mask"} for view in header["views"][::3]]
    (folder / "recording.json").write_text(json.dumps(header))
    return folder


@pytest.fixture
def program(bare: Path, program_of, tmp_path: Path):
    return program_of(str(bare), tmp_path / "session")


def ready(tab) -> None:
    tab.until(KNOWN)
    tab.until("flatcloth.phase === 'ready'")
    tab.until("flatcloth.sources.drawn && flatcloth.sources.drawn.labels")


def middle(tab) -> tuple[float, float]:
    box = tab.page.locator("#source-canvas").bounding_box()
    assert box is not None
    return box["x"] + 0.5 * box["width"], box["y"] + 0.35 * box["height"]


def test_cloth_is_painted_with_the_mouse_and_undone(open_tab) -> None:
    tab = open_tab()
    ready(tab)
    tab.page.keyboard.press("Shift+S")
    tab.until("flatcloth.sides.kind === 'this'")
    x, y = middle(tab)
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(x, y + 12, steps=4)
    tab.page.mouse.up()
    tab.until(f"flatcloth.state.sides.n_strokes === 1 && {IDLE}")
    # Each view has a small picture of its labels, as they are now.
    tab.until(
        f"document.querySelectorAll('#timeline .view .labelled').length === {len(tab.state()['views'])}"
    )
    revision = tab.state()["sides"]["revision"]
    shown = "[...document.querySelectorAll('#timeline .labelled img')].slice(0, 2)"
    present = f"document.querySelector('#timeline img[src$=\"revision={revision}\"]')"
    tab.until(f"{shown}.every((i) => i.naturalWidth > 1) && {present}")
    assert tab.state()["undo"].startswith("stroke: this side on view")
    tab.page.keyboard.press("Escape")
    tab.until("flatcloth.sides.kind === null")
    tab.page.keyboard.press("u")
    tab.until("flatcloth.state.sides.n_strokes === 0")


def test_cloth_is_painted_with_keys_alone_and_the_next_place_is_found(open_tab) -> None:
    tab = open_tab()
    ready(tab)
    tab.page.keyboard.press("Shift+W")
    tab.until("flatcloth.sources.drawn && document.querySelector('.toast, #toasts *')")
    tab.page.keyboard.press("Shift+S")
    tab.until("flatcloth.sides.kind === 'this' && document.getElementById('source-canvas').tabIndex === 0")
    tab.page.keyboard.press(">")
    tab.until("flatcloth.sides.radius_mm === 15")
    tab.page.focus("#source-canvas")
    tab.page.keyboard.press("ArrowDown")
    tab.page.keyboard.press("Enter")
    tab.until(f"flatcloth.state.sides.n_strokes === 1 && {IDLE}")


def test_a_finger_paints_and_strokes_outlast_a_kill(open_tab, program) -> None:
    tab = open_tab()
    ready(tab)
    tab.page.keyboard.press("Shift+S")
    tab.until("flatcloth.sides.kind === 'this'")
    x, y = middle(tab)
    finger = {"pointerType": "touch", "pointerId": 1, "button": 0, "bubbles": True, "isPrimary": True}
    tab.page.evaluate(
        """([x, y, finger]) => {
            const canvas = document.getElementById('source-canvas');
            canvas.setPointerCapture = () => {};
            for (const [type, dy] of [['pointerdown', 0], ['pointermove', 8], ['pointerup', 8]])
                canvas.dispatchEvent(new PointerEvent(type, { ...finger, clientX: x, clientY: y + dy }));
        }""",
        [x, y, finger],
    )
    tab.until(f"flatcloth.state.sides.n_strokes === 1 && {IDLE}")
    program.kill()
    again = program.again()
    try:
        tab.page.goto(again.url)
        tab.until(f"{KNOWN} && flatcloth.state.sides.n_strokes === 1")
    finally:
        again.stop()
