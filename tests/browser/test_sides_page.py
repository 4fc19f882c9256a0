"""The side of interest of a recording without masks: found, painted by mouse, touch and keys, undone."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tiny_recordings import few_views

pytestmark = pytest.mark.browser

KNOWN = "flatcloth.state?.sides && flatcloth.state.sides.certainty !== null"
IDLE = "flatcloth.state.request === null"


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every third view of a bundled recording, without its masks."""
    folder = few_views("shirt-corner-d435", 3, tmp_path_factory.mktemp("bare") / "shirt")
    header = json.loads((folder / "recording.json").read_text())
    header["views"] = [{k: v for k, v in view.items() if k != "mask"} for view in header["views"]]
    (folder / "recording.json").write_text(json.dumps(header))
    return folder


@pytest.fixture
def program(bare: Path, program_of, tmp_path: Path):
    return program_of(str(bare), tmp_path / "session")


@pytest.fixture
def tab(open_tab):
    """A tab in which the sides are known and drawn, high enough for pictures in the timeline."""
    tab = open_tab(1366, 768)
    tab.until(KNOWN)
    tab.until("flatcloth.phase === 'ready'")
    tab.until("flatcloth.sources.drawn && flatcloth.sources.drawn.labels")
    return tab


def middle(tab) -> tuple[float, float]:
    box = tab.page.locator("#source-canvas").bounding_box()
    return box["x"] + 0.5 * box["width"], box["y"] + 0.35 * box["height"]


def test_cloth_is_painted_with_the_mouse_and_with_keys_alone_and_undone(tab) -> None:
    tab.page.keyboard.press("Shift+S")
    tab.until("flatcloth.sides.side === 'this'")
    x, y = middle(tab)
    tab.drag((x, y), (x, y + 12))
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
    tab.until("flatcloth.sides.side === null")
    tab.page.keyboard.press("u")
    tab.until(f"flatcloth.state.sides.n_strokes === 0 && {KNOWN} && {IDLE} && flatcloth.phase === 'ready'")
    tab.page.keyboard.press("Shift+W")
    tab.until("flatcloth.sources.aim !== null")
    the_source_image_shows_all_of_the_item(tab)
    # From place to place and back, and two fingers on it: no stroke, a closer look.
    first = json.dumps(tab.page.evaluate("flatcloth.sources.aim"))
    tab.page.keyboard.press("Shift+W")
    tab.until(f"JSON.stringify(flatcloth.sources.aim) !== {json.dumps(first.replace(' ', ''))}")
    tab.page.keyboard.press(";")
    tab.until(f"JSON.stringify(flatcloth.sources.aim) === {json.dumps(first.replace(' ', ''))}")
    tab.page.keyboard.press("Shift+S")
    tab.until("flatcloth.sides.side === 'this' && document.getElementById('source-canvas').tabIndex === 0")
    tab.until("flatcloth.sources.drawn.view === flatcloth.sources.view")
    two_fingers_zoom(tab, "#source-canvas", "flatcloth.sources.drawn.box.width")
    two_fingers_zoom(tab, "#canvas", "1 / flatcloth.canvas.transform.scale")
    tab.page.keyboard.press(">")
    tab.until("flatcloth.sides.radius_mm === 15")
    tab.page.focus("#source-canvas")
    tab.page.keyboard.press("ArrowDown")
    tab.page.keyboard.press("Enter")
    tab.until(f"flatcloth.state.sides.n_strokes === 1 && {IDLE}")
    assert tab.findings() == []


def the_source_image_shows_all_of_the_item(tab) -> None:
    """Also what is undecided."""
    view = tab.page.evaluate("flatcloth.sources.aim.view")
    tab.until(f"flatcloth.sources.drawn.view === {view}")
    item = tab.page.evaluate(f"fetch('/sides/{view}/box.json').then((answer) => answer.json())")
    tab.until(f"flatcloth.sources.drawn.box.height > {item['height']}")
    shown, (row, col) = tab.page.evaluate("[flatcloth.sources.drawn.box, flatcloth.sources.aim.rc]")
    for start, size, at in (("top", "height", row), ("left", "width", col)):
        assert shown[start] <= item[start]
        assert shown[start] + shown[size] >= item[start] + item[size]
        assert shown[start] <= at < shown[start] + shown[size]


def two_fingers_zoom(tab, canvas: str, shown: str) -> None:
    # In one go, as the window's parts may still find their sizes.
    before, after = tab.page.evaluate(
        """([selector, shown]) => {
            const canvas = document.querySelector(selector), before = eval(shown);
            canvas.setPointerCapture = () => {};
            const { left, top, width, height } = canvas.getBoundingClientRect();
            const [x, y] = [left + width / 2, top + height / 2];
            const finger = { pointerType: 'touch', button: 0, bubbles: true };
            for (const [type, pointerId, dx] of [
                ['pointerdown', 1, -20], ['pointerdown', 2, 20], ['pointermove', 2, 40],
                ['pointermove', 1, -40], ['pointerup', 1, -40], ['pointermove', 2, 60],
                ['pointerup', 2, 60]]) {
                const at = { pointerId, clientX: x + dx, clientY: y };
                canvas.dispatchEvent(new PointerEvent(type, { ...finger, ...at }));
            }
            return [before, eval(shown)];
        }""",
        [canvas, shown],
    )
    assert after == pytest.approx(before / 2, rel=0.02)
    assert tab.state()["sides"]["n_strokes"] == 0


def test_a_finger_paints_strokes_outlast_a_kill_and_may_need_another_start_view(tab, program) -> None:
    tab.page.keyboard.press("Shift+S")
    tab.until("flatcloth.sides.side === 'this'")
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
        tab.page.keyboard.press("u")
        tab.until(f"flatcloth.state.sides.n_strokes === 0 && {IDLE} && flatcloth.phase === 'ready'")
        another_start_view_is_chosen_when_strokes_leave_the_first_too_little(tab)
    finally:
        again.stop()


def another_start_view_is_chosen_when_strokes_leave_the_first_too_little(tab) -> None:
    start = tab.state()["start_view"]
    box = tab.page.evaluate(f"fetch('/sides/{start}/box.json').then((answer) => answer.json())")
    rows, cols = ((box[a], box[a] + box[n]) for a, n in (("top", "height"), ("left", "width")))
    step = max(1, round((box["height"] * box["width"] / 800) ** 0.5))
    points = [[row, col] for row in range(*rows, step) for col in range(*cols, step)][:900]
    tab.page.evaluate(
        """([view, points]) => flatcloth.send({
            type: 'stroke_image', side: 'other', view_index: view, points_rc: points, radius_m: 0.02 })""",
        [start, points],
    )
    tab.until(f"flatcloth.state.start_view !== null && flatcloth.state.start_view !== {start} && {IDLE}")
    tab.until("!flatcloth.state.drawing && flatcloth.state.layers && flatcloth.phase === 'ready'")
    assert any("Another start view is chosen" in note["text"] for note in tab.state()["log"])
    # Undo takes it back; then the page says what can be done, and computes nothing in vain.
    tab.page.keyboard.press("u")
    tab.until(f"flatcloth.state.start_view === {start} && flatcloth.state.trouble")
    assert "Undo (U)" in tab.page.inner_text("#hint")
    assert "Restart" in tab.page.inner_text("#hint")
    assert tab.page.is_hidden("#stage .busy")
    tab.page.keyboard.press("u")
    tab.until("flatcloth.state.sides.n_strokes === 0 && !flatcloth.state.trouble && flatcloth.state.layers")
