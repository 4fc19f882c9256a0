"""The teaching mode in a real browser: all stages by keyboard, the sliders, and nothing decided."""

from __future__ import annotations

import pytest
from conftest import Program  # type: ignore[attr-defined]  # mypy takes the conftest of tests/
from playwright.sync_api import expect
from tiny_recordings import few_views

pytestmark = pytest.mark.browser

STAGES = 14
SAMPLES, MINIMISATION, FLATTENED, ROTATION = 2, 3, 4, 6


class Lesson:
    """The teaching mode of a tab."""

    def __init__(self, tab):
        self.tab, self.page = tab, tab.page

    def parameters(self):
        return self.page.evaluate("flatcloth.teaching.shown.parameters")

    def until(self, expression):
        self.page.wait_for_function(f"() => {{ const t = flatcloth.teaching; return {expression}; }}")

    def drawn(self, stage):
        """Wait until a stage is drawn, with nothing under way."""
        self.until(f"t?.at === {stage - 1} && t.shown?.stage === {stage} && !t.running && !t.playing")

    def open(self):
        self.page.keyboard.press("h")
        self.drawn(1)
        return self

    def go(self, stage):
        self.page.locator(".teaching-stage").nth(stage - 1).click()
        self.drawn(stage)

    def fact(self, name):
        return self.page.locator(f'#teaching-facts dt[data-name="{name}"] + dd').inner_text()

    def changed(self, name, before):
        """Wait until a fact is another, and return it."""
        expect(self.page.locator(f'#teaching-facts dt[data-name="{name}"] + dd')).not_to_have_text(before)
        return self.fact(name)

    def slide(self, name, key):
        """Move a slider by a key, and wait until what it leads to is drawn."""
        slider = self.page.locator(f'[data-slider="{name}"] input')
        before = slider.input_value()
        slider.press(key)
        value = slider.input_value()
        assert value != before
        self.until(f"!t.running && t.shown.parameters['{name}'] === {value}")
        return float(value)

    def is_drawn_on(self):
        """Whether the sheet shows much: a picture of a blank one is small."""
        return len(self.page.locator("#teaching-canvas").screenshot()) > 12_000

    def cut_off(self):
        """What of this stage a learner cannot see without scrolling."""
        return self.page.evaluate(
            """() => [...document.querySelectorAll(
                   '#teaching .button, #teaching input, .teaching-stage, .teaching-math, #teaching-facts')]
                 .filter((e) => e.checkVisibility())
                 .filter((e) => { const r = e.getBoundingClientRect();
                   return r.left < 0 || r.top < 0 || r.right > innerWidth || r.bottom > innerHeight
                     || e.scrollWidth > e.clientWidth + 2 && (e.id || e.matches('.teaching-math')); })
                 .map((e) => e.id || e.textContent)"""
        )


@pytest.fixture(scope="module")
def school(tmp_path_factory):
    """The program of all lessons, which change nothing: it computes each once, from every third view."""
    place = tmp_path_factory.mktemp("school")
    recording = few_views("shirt-sleeve-clean", 3, place / "shirt")
    running = Program(f"{recording} --as-recorded", place / "session")
    yield running
    running.stop()


@pytest.fixture
def program(request, program_of, tmp_path):
    """That of all lessons, a cell's, or a session of its own."""
    own = getattr(request, "param", None)
    if own == "--cell":
        return program_of(f"--cell --sensor none --out {tmp_path / 'out'}", None)
    return request.getfixturevalue("shared_program").begin(own) if own else request.getfixturevalue("school")


@pytest.fixture
def open_lesson(open_tab):
    def open_one(width=1280, height=720, scheme="light"):
        tab = open_tab(width, height, scheme)
        tab.until("flatcloth.phase === 'ready' && flatcloth.layerRevision > 0")
        return Lesson(tab)

    return open_one


@pytest.mark.parametrize(
    ("width", "height", "scheme"),
    [(1280, 720, "light"), pytest.param(2560, 1440, "dark", marks=pytest.mark.thorough)],
    ids=["small", "large"],
)
def test_all_stages_by_keyboard(open_lesson, width, height, scheme):
    lesson = open_lesson(width, height, scheme).open()
    page = lesson.page
    for stage in range(1, STAGES + 1):
        lesson.drawn(stage)
        assert page.locator(".teaching-text h3:visible").inner_text().startswith(f"{stage}. ")
        assert page.locator(".teaching-math math:visible").count() >= 1
        assert page.locator("#teaching-facts dt").count() >= 2
        assert lesson.is_drawn_on(), f"stage {stage} is blank"
        assert lesson.cut_off() == [], f"stage {stage}"
        lesson.tab.shoot(f"teaching-{scheme}-{stage:02d}")
        page.keyboard.press("PageDown")
    lesson.drawn(STAGES)  # there is nothing after the last
    for key, stage in (("PageUp", STAGES - 1), ("ArrowLeft", STAGES - 2), ("ArrowRight", STAGES - 1)):
        page.keyboard.press(key)
        lesson.drawn(stage)


def test_sliders_and_panes_show_what_they_change(open_lesson):
    lesson = open_lesson()
    # Keys of the teaching mode say where they belong.
    lesson.page.keyboard.press("PageDown")
    toast = lesson.page.locator(".toast")
    toast.wait_for()
    assert "Open the teaching mode first (H)." in toast.inner_text()
    toast.get_by_role("button", name="Dismiss").click()
    lesson.open().go(SAMPLES)
    samples = int(lesson.fact("Samples"))
    assert lesson.slide("sampling_interval_px", "ArrowRight") == 14
    assert int(lesson.fact("Samples")) < samples
    lesson.page.get_by_role("button", name="Reset", exact=True).click()
    lesson.until("!t.running && t.shown.parameters.sampling_interval_px === 12")
    assert int(lesson.fact("Samples")) == samples

    # A slider reaches the session's own value, also where that is beyond its range.
    limit = lesson.page.locator('[data-slider="z_angle_limit_deg"] input')
    limit.evaluate("(input) => { input.max = 40; }")
    lesson.go(ROTATION)
    assert limit.input_value() == "50"
    turn, place = lesson.fact("A, held to 10–50°"), lesson.fact("u_b, A_0")
    assert lesson.slide("z_angle_limit_deg", "ArrowLeft") == 45
    assert lesson.fact("A, held to 10–50°") != turn
    overlap_cm2 = lesson.parameters()["overlap_cm2"]
    assert lesson.slide("overlap_cm2", "End") > overlap_cm2
    assert lesson.fact("u_b, A_0") != place
    # From a flattened pixel to the image.
    lesson.go(FLATTENED)
    place = lesson.fact("x, y, z")
    assert place != "–"
    lesson.page.locator("#teaching-canvas").focus()
    lesson.page.keyboard.press("ArrowDown")
    lesson.changed("x, y, z", place)
    assert lesson.tab.findings() == []


@pytest.mark.parametrize("program", ["recordings/shirt-sleeve-clean"], indirect=True, ids=["own"])
def test_nothing_is_decided_and_leaving_returns_to_where_one_was(open_lesson, program):
    lesson = open_lesson()
    page = lesson.page
    lesson.tab.areas_known()
    before = lesson.tab.state()
    journal = (program.session / "journal.jsonl").read_text()
    page.locator('[data-action="teach"]').focus()
    page.keyboard.press("Enter")
    lesson.drawn(1)
    for key in "saruyegnob1":
        page.keyboard.press(key)
    page.keyboard.press("ArrowRight")
    lesson.drawn(2)
    page.keyboard.press("Escape")
    lesson.until("!t.open")
    assert page.evaluate("document.activeElement.dataset.action") == "teach"
    assert page.evaluate("document.querySelectorAll('[inert]').length") == 0
    assert {**lesson.tab.state(), "revision": before["revision"], "lesson": None} == before
    assert (program.session / "journal.jsonl").read_text() == journal
    lesson.page.keyboard.press("h")
    lesson.drawn(2)  # where it was left
    page.keyboard.press("h")
    lesson.until("!t.open")
    lesson.tab.step()  # and the session goes on


@pytest.mark.parametrize("program", ["--cell"], indirect=True, ids=["cell"])
def test_lessons_follow_a_cell_that_turns(open_tab):
    tab = open_tab(1280, 720, "light")
    tab.until("flatcloth.layerRevision > 0")
    lesson, page = Lesson(tab), tab.page
    lesson.open()
    lesson.go(ROTATION)
    before = lesson.parameters()
    page.keyboard.press("Escape")
    for view in (1, 2):
        tab.until("flatcloth.state.active.angle_deg !== null && !flatcloth.state.active.turning")
        expect(page.locator("#hint")).to_contain_text("Press Turn and look (S): the cell turns the item by")
        if view == 1:
            page.get_by_role("button", name="Turn and look").click()
        else:
            page.keyboard.press("s")
        tab.until(f"flatcloth.state.pending?.view_index === {view} && flatcloth.overlayRevision > 0")
        tab.accept()
    tab.until("flatcloth.state.active.views === 3 && flatcloth.state.active.angle_deg !== null")
    tab.shoot("active-cell")
    page.keyboard.press("h")  # where one was
    lesson.drawn(ROTATION)
    tab.shoot("teaching-cell-rotation")
    now = lesson.parameters()
    assert now["overlap_cm2"] != before["overlap_cm2"], "S_0 follows from the size of the item in all views"
    assert lesson.is_drawn_on()
