"""A whole session from the start screen to the export, as an operator works: by mouse, and by keys alone."""

from __future__ import annotations

import io
import json
import re
import zipfile
from pathlib import Path

import pytest
from exported_sessions import write_cylinder
from playwright.sync_api import expect

from flatcloth.core.resources import static_folder

pytestmark = pytest.mark.browser


class ByMouse:
    """Everything by clicks and drags."""

    def __init__(self, tab):
        self.tab, self.page = tab, tab.page

    def open(self, name):
        self.page.get_by_role("button", name=name).first.click()

    def do(self, action):
        self.page.locator(f"[data-action='{action}']:visible").first.click()

    def press(self, data_id):
        sheet = "dialog[open] " if self.page.locator("dialog[open]").count() else ""
        self.page.locator(f"{sheet}[data-id='{data_id}']:visible").first.click()

    def drag_away(self):
        """Drag the proposal 100 mm across the shape, by cloth that is found under the pointer."""
        u, v = self.tab.place(0.5, 0.5, self.tab.state()["layers"]["overlay"])
        (x, y), (far, _) = self.tab.at([u, v]), self.tab.at([u + 0.1, v])
        start = self.tab.on_proposal(x, y)
        self.tab.drag((start, y), (start + far - x, y + 5))

    def reopen(self, view):
        self.press(f"view-{view}")
        self.page.get_by_role("option", name="Reopen").click()

    def close(self):
        self.page.locator("dialog[open] .button", has_text="Close").click()


GROUPS = re.search(r'GROUPS = "(.*)"', (static_folder() / "page" / "roving.js").read_text())[1]


class ByKeys(ByMouse):
    """Everything by keys: those of the actions, Tab and Enter."""

    def to(self, found):
        """Tab until something has the focus, or the group that it is in: then the arrow keys go on."""
        for _ in range(40):
            self.page.keyboard.press("Tab")
            way = self.page.evaluate(
                f"""() => {{ const at = document.activeElement, group = at.closest({GROUPS!r});
                    const all = [...(group?.querySelectorAll("button, summary") ?? [at])];
                    const controls = all.filter((e) => e.offsetParent !== null);
                    const there = controls.findIndex((e) => {found});
                    return there < 0 ? null : there - controls.indexOf(at); }}"""
            )
            for _ in range(abs(way or 0)):
                self.page.keyboard.press("ArrowRight" if way > 0 else "ArrowLeft")
            if way is not None:
                return
        raise AssertionError(f"Tab never came to {found}")

    def open(self, name):
        self.to(f"e.textContent.includes('{name}')")
        self.page.keyboard.press("Enter")

    def do(self, action):
        key = next(a["keys"][0] for a in self.tab.state()["actions"] if a["name"] == action)
        *held, last = key.replace("Ctrl", "Control").split("+")
        self.page.keyboard.press("+".join([*held, last.upper() if held and len(last) == 1 else last]))

    def press(self, data_id):
        self.to(f"e.dataset.id === '{data_id}'")
        self.page.keyboard.press("Enter")

    def drag_away(self):
        for _ in range(5):
            self.page.keyboard.press("Shift+ArrowRight")

    def reopen(self, view):
        self.press(f"view-{view}")
        expect(self.page.get_by_role("dialog", name=f"View {view}")).to_be_visible()
        self.page.keyboard.press("Control+e")

    def close(self):
        self.page.keyboard.press("Escape")


@pytest.fixture
def program(tmp_path: Path, program_of):
    """The start screen, with two recordings of a cylinder with a floating piece below its root."""
    for name in ("by-mouse", "by-keys"):
        write_cylinder(tmp_path / "root" / name, name, slice(112, 128))
    return program_of(f"--root {tmp_path / 'root'}", None)


def work_through(tab, hands, name, tmp_path, *, still_floats=True):
    """Open, accept a bad place knowingly, find and repair it in review, finish, export.

    A piece floats at the start, and at the end if it ``still_floats``.
    """
    page = tab.page
    hands.open(name)
    tab.ready()
    expect(page.locator("#recording")).to_contain_text(name)
    assert tab.state()["layers"]["pieces"], "a piece floats"
    hands.press("part-doubts")
    tab.until("flatcloth.doubts.list.some(({ title }) => title === 'B')")
    hands.press(f"doubt-{page.evaluate('flatcloth.doubts.list.findIndex((one) => one.title === `B`)')}")
    expect(page.locator("#doubts")).to_contain_text("Nothing seen connects it")

    hands.do("step")
    tab.proposed()
    hands.drag_away()
    tab.until("Math.abs(flatcloth.state.pending.nudge.u_mm) > 95 && !flatcloth.state.drawing")
    tab.until("flatcloth.state.pending.score !== null && flatcloth.state.pending.score < 0.75")
    bad = tab.state()["pending"]["view_index"]
    hands.do("accept")  # the verdict is "Look here": it takes a second press, also where it joins the shape
    page.locator(".toast.warning", has_text="Look here: score").wait_for()
    page.wait_for_timeout(1000)  # a press that comes sooner is half of a double click
    hands.do("accept")
    tab.until("flatcloth.state.pending === null && !flatcloth.state.drawing")
    assert tab.state()["views"][bad]["flagged"]

    hands.reopen(bad)
    tab.until(f"flatcloth.state.pending?.view_index === {bad} && !flatcloth.state.drawing")
    assert tab.state()["pending"]["score"] < 0.75
    hands.do("refine")
    tab.until("flatcloth.state.pending.score >= 0.75")
    hands.do("accept")
    tab.until("flatcloth.state.pending === null && !flatcloth.state.drawing")
    tab.until(f"!flatcloth.state.views[{bad}].flagged")  # its history is read once nothing else is computed

    hands.do("auto")  # of 36 noisy views it takes minutes
    page.wait_for_function("flatcloth.phase === 'finished' && !flatcloth.state.drawing", timeout=600_000)
    expect(page.locator("#hint")).to_contain_text("of the cloth floats" if still_floats else "Finished")
    tab.shoot(f"operator-{name}")
    with page.expect_download() as download:
        hands.do("export")
        hands.press("data.zip")
    download.value.save_as(tmp_path / f"{name}.zip")
    with zipfile.ZipFile(io.BytesIO((tmp_path / f"{name}.zip").read_bytes())) as archive:
        outcome = json.loads(archive.read("outcome.json"))
        names = set(archive.namelist())
    assert {"flattened.npz", "cloud.ply"} <= names
    floating = {piece["file"] for piece in tab.state()["layers"]["pieces"]}
    assert {name for name in names if name.startswith("floating-") and "-other-" not in name} == floating
    assert floating or not still_floats
    assert bad in {v["view_index"] for v in outcome["accepted"]}
    hands.close()


def test_a_session_is_worked_through_from_the_start_screen_by_mouse_and_by_keys(open_tab, tmp_path):
    tab = open_tab(1280, 900)
    work_through(tab, ByMouse(tab), "by-mouse", tmp_path)
    tab.page.locator("[data-action=home]").click()
    tab.page.locator("#back", has_text="by-mouse").wait_for()
    # What is open changes without another start of the program, and each session is kept.
    work_through(tab, ByKeys(tab), "by-keys", tmp_path)
    tab.page.keyboard.press("Shift+H")
    expect(tab.page.locator("#recent .card")).to_have_count(2)
    assert tab.findings() == []
    # Without a camera the page says what to do.
    tab.page.locator("#open-camera").click()
    expect(tab.page.locator("#camera-help .steps")).to_be_visible()
    assert tab.findings() == []


@pytest.mark.thorough
@pytest.mark.parametrize("hands", [ByMouse, ByKeys])
def test_trousers_are_worked_through(open_tab, tmp_path, hands):
    tab = open_tab(1280, 900)
    work_through(tab, hands(tab), "trousers-waist-d435", tmp_path, still_floats=False)
