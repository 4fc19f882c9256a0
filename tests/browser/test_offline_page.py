"""The exported page in a real browser: opened from a file, with no network, clicked and driven by keys."""

from __future__ import annotations

import contextlib
import json
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from conftest import SCREENSHOTS, WAIT_MS, Tab  # type: ignore[attr-defined]  # mypy takes the conftest of tests/
from exported_sessions import cylinder_session
from playwright.sync_api import Browser, Page, expect

from flatcloth.export.page import page as page_of
from flatcloth.export.report import report as report_of
from flatcloth.export.session import OpenedSession

pytestmark = pytest.mark.browser
expect.set_options(timeout=WAIT_MS)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> OpenedSession:
    return cylinder_session(tmp_path_factory.mktemp("offline"))


@pytest.fixture(scope="module")
def file(session: OpenedSession) -> Path:
    path = session.history.folder / "page.html"
    path.write_text(page_of(session), encoding="utf-8")
    return path


class Offline:
    """A tab with the exported page; its policy forbids evaluated text, so nothing can be waited on by it."""

    def __init__(self, page: Page, file: Path) -> None:
        self.page = page
        self.errors: list[str] = []
        self.requests: list[str] = []
        page.set_default_timeout(WAIT_MS)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda said: self.errors.append(said.text) if said.type == "error" else None)
        page.on("request", lambda request: self.requests.append(request.url))
        page.goto(file.as_uri())
        self.hint = page.locator("#hint")
        expect(self.hint).to_contain_text("Step 3 of 3")

    def step(self, number: int) -> None:
        expect(self.hint).to_contain_text(f"Step {number} of 3")

    def values(self) -> dict[str, str]:
        return dict(
            self.page.locator("#pick dl.values").evaluate(
                "list => [...list.querySelectorAll('dt')]"
                ".map((t) => [t.textContent, t.nextSibling.textContent])"
            )
        )

    def held_m(self) -> list[float]:
        return [
            float(x.replace("\u2212", "-")) / 1000 for x in self.values()["Place"].removesuffix(" mm").split()
        ]

    def on_flat(self, u_m: float, v_m: float) -> tuple[float, float]:
        at = self.page.evaluate("([u, v]) => flatcloth.canvas.toScreen(u, v)", [u_m, v_m])
        return at["x"], at["y"]

    def on_cloud(self, point_m: list[float]) -> tuple[float, float]:
        box = self.page.locator("#cloud").bounding_box()
        at = self.page.evaluate("(p) => flatcloth.cloud.toScreen(p)", point_m)
        return box["x"] + at["x"], box["y"] + at["y"]

    def marked(self, selector: str, x: float, y: float, least: int) -> None:
        """Wait until a canvas has at least so many pixels of the color of picks about a place of the page."""
        end = time.monotonic() + WAIT_MS / 1000
        while self._pink_near(selector, x, y) < least:  # what is marked is drawn with the next frame
            assert time.monotonic() < end, f"{selector} shows no pick there"

    def _pink_near(self, selector: str, x: float, y: float) -> int:
        return self.page.locator(selector).evaluate(
            """(canvas, [x, y]) => {
              const box = canvas.getBoundingClientRect(), r = devicePixelRatio;
              const part = [(x - box.left - 8) * r, (y - box.top - 8) * r, 16 * r, 16 * r].map(Math.round);
              const data = canvas.getContext("2d").getImageData(...part).data;
              let count = 0;
              for (let i = 0; i < data.length; i += 4)
                if (data[i] > 180 && data[i + 1] < 120 && data[i + 2] > 80 && data[i + 3] > 200) count += 1;
              return count;
            }""",
            [x, y],
        )

    shoot = Tab.shoot


@pytest.fixture
def open_page(chromium: Browser, file: Path) -> Iterator[Callable[..., Offline]]:
    with contextlib.ExitStack() as stack:
        tabs: list[Offline] = []

        def open_one(width: int = 1280, height: int = 720, scheme: str = "light") -> Offline:
            context = chromium.new_context(
                viewport={"width": width, "height": height}, color_scheme=scheme, offline=True,
                reduced_motion="reduce",
            )  # fmt: skip
            stack.callback(context.close)
            tabs.append(Offline(context.new_page(), file))
            return tabs[-1]

        yield open_one
        assert [error for tab in tabs for error in tab.errors] == []
        # Nothing but the file itself was ever asked for.
        assert {url for tab in tabs for url in tab.requests} == {file.as_uri()}


def test_a_click_on_either_side_is_shown_on_the_other_and_kept_picks_with_their_gripper(
    open_page, session: OpenedSession
) -> None:
    tab = open_page()
    a_click_in_3d_is_shown_on_the_flat(tab, session)
    a_kept_pick_shows_its_gripper_on_both_sides(tab, session)
    a_click_on_the_flat_is_shown_in_3d_and_the_pointer_tells_its_values(tab, session)


def a_click_in_3d_is_shown_on_the_flat(tab: Offline, session: OpenedSession) -> None:
    # What the camera of the last view saw squarely is in front of everything else.
    view = session.growth.view
    rows, cols = ((view.view_index == 2) & (abs(view.z_angle_deg) < 20)).nonzero()
    rc = (int(rows[len(rows) // 2]), int(cols[len(cols) // 2]))
    point = view.xyz_m[rc].astype(float).tolist()
    tab.page.mouse.click(*tab.on_cloud(point))
    expect(tab.page.locator("#pick h2")).to_have_text("Here")
    found = tab.held_m()
    assert math.dist(found, point) < 0.008
    uv = tab.page.evaluate("flatcloth.current.uv_m")
    tab.marked("#canvas", *tab.on_flat(*uv), 20)
    # A click beside the item changes nothing.
    box = tab.page.locator("#cloud").bounding_box()
    tab.page.mouse.click(box["x"] + 5, box["y"] + box["height"] - 5)
    assert tab.held_m() == found


def a_kept_pick_shows_its_gripper_on_both_sides(tab: Offline, session: OpenedSession) -> None:
    tab.page.get_by_role("button", name="Show edge <b>").click()
    expect(tab.page.locator("#pick h2")).to_have_text("edge <b>")
    assert tab.values()["Opening"] == "40 mm"
    assert math.dist(tab.held_m(), session.history.picks[1].position_held_m) < 1e-4
    (gripper,) = [
        p["grip"]["gripper_m"]
        for p in tab.page.evaluate("flatcloth.history.picks")
        if p["name"] == "edge <b>"
    ]
    bar = [(a + b) / 2 for a, b in zip(*gripper[2], strict=True)]
    tab.marked("#cloud", *tab.on_cloud(bar), 10)
    tab.page.get_by_role("button", name="Show gone").click()
    expect(tab.page.locator("#pick")).to_contain_text("Its view is not part of the shape.")
    tab.shoot("offline-gripper")


def a_click_on_the_flat_is_shown_in_3d_and_the_pointer_tells_its_values(
    tab: Offline, session: OpenedSession
) -> None:
    view = session.growth.view
    rc = tuple(int(x) for x in (view.shape[0] // 2, view.shape[1] // 2))
    assert view.valid[rc]
    u_m, v_m = view.uv_from_rc(rc)
    tab.page.mouse.click(*tab.on_flat(float(u_m), float(v_m)))
    expect(tab.page.locator("#pick h2")).to_have_text("Here")
    point = view.xyz_m[rc].astype(float).tolist()
    assert math.dist(tab.held_m(), point) < 0.002
    assert tab.values()["Source"].startswith(f"view {view.view_index[rc]} @")
    tab.marked("#cloud", *tab.on_cloud(point), 40)
    tab.marked("#canvas", *tab.on_flat(float(u_m), float(v_m)), 20)
    tab.shoot("offline-picked")
    tab.page.mouse.move(0, 0)
    tab.page.mouse.move(*tab.on_flat(float(u_m), float(v_m)))
    expect(tab.page.locator("#readout")).to_contain_text(f"view {view.view_index[rc]}")
    expect(tab.page.locator("#readout")).to_contain_text("mm")


def test_steps_layers_theme_and_the_view_in_3d_are_reached_by_keys_and_buttons(
    open_page, session: OpenedSession
) -> None:
    tab = open_page()
    everything_has_a_name_for_those_who_do_not_see_it(tab)
    the_timeline_is_stepped_through(tab, session)
    layers_theme_and_3d_follow_the_keys(tab)


def everything_has_a_name_for_those_who_do_not_see_it(tab: Offline) -> None:
    nameless = tab.page.evaluate(
        """() => [...document.querySelectorAll(
               "button, canvas:not([aria-hidden]), [role=group], section, aside, dialog, img")]
             .filter((e) => !(e.ariaLabel || e.getAttribute("aria-labelledby") || e.textContent.trim()
               || e.hasAttribute("alt") || (e.tagName === "SECTION" && e.closest("aside"))))
             .map((e) => e.outerHTML.slice(0, 80))"""
    )
    assert nameless == []
    tree = tab.page.locator("body").aria_snapshot()
    for name in ("Hanging item in 3D", "Flattened view", "Layer", "Picks and decisions"):
        assert name in tree
    assert tab.page.locator("#hint").get_attribute("role") == "status"  # each step is read aloud


def the_timeline_is_stepped_through(tab: Offline, session: OpenedSession) -> None:
    keyboard = tab.page.keyboard

    def cloth() -> int:
        """Pixels of cloth that the flattened side shows."""
        return tab.page.evaluate(
            """() => { const image = flatcloth.canvas.layer.shown.image;
                 const data = image.getContext("2d").getImageData(0, 0, image.width, image.height).data;
                 return data.filter((x, i) => i % 4 === 3 && x > 0).length; }"""
        )

    shown = [int(session.growth.shown_after(step).sum()) for step in range(3)]
    assert cloth() == shown[2]
    keyboard.press("Home")
    tab.step(1)
    assert cloth() == shown[0]
    expect(tab.hint).to_contain_text("view 0 at 0°, the start view")
    keyboard.press("ArrowRight")
    tab.step(2)
    assert cloth() == shown[1]
    expect(tab.hint).to_contain_text("accepted, score 0.")
    tab.shoot("offline-step")
    keyboard.press(",")
    tab.step(1)
    tab.page.get_by_role("button", name="Step 3: view 2").click()
    tab.step(3)
    expect(tab.page.locator("#timeline [aria-current=true]")).to_have_attribute("data-step", "2")
    keyboard.press("Home")
    tab.page.locator("#canvas").focus()
    keyboard.press("Space")
    expect(tab.page.get_by_role("button", name="Pause")).to_be_visible()
    tab.step(3)  # by itself
    expect(tab.page.get_by_role("button", name="Play")).to_be_visible()
    assert tab.page.evaluate("flatcloth.tint") is False


def layers_theme_and_3d_follow_the_keys(tab: Offline) -> None:
    keyboard = tab.page.keyboard
    keyboard.press("4")
    expect(tab.page.get_by_role("button", name="Source", exact=False).first).to_have_attribute(
        "aria-pressed", "true"
    )
    expect(tab.page.locator("#legend")).to_contain_text("2 (60°)")
    keyboard.press("t")
    expect(tab.page.locator("html")).to_have_attribute("data-theme", "dark")
    keyboard.press("?")
    expect(tab.page.get_by_role("dialog", name="Commands")).to_be_visible()
    keyboard.press("Escape")
    expect(tab.page.locator("#palette")).to_be_hidden()
    tab.page.locator("#cloud").focus()
    before = tab.page.evaluate("flatcloth.cloud.eye.yaw")
    keyboard.press("ArrowLeft")  # turns the item; it is no step back while 3D has the focus
    assert tab.page.evaluate("flatcloth.cloud.eye.yaw") != before
    tab.step(3)
    zoom = tab.page.evaluate("flatcloth.cloud.eye.zoom")
    keyboard.press("+")
    assert tab.page.evaluate("flatcloth.cloud.eye.zoom") > zoom
    keyboard.press("r")
    assert tab.page.evaluate("flatcloth.cloud.eye.zoom") == 1
    box = tab.page.locator("#cloud").bounding_box()
    tab.page.mouse.move(box["x"] + 200, box["y"] + 200)
    tab.page.mouse.down()
    tab.page.mouse.move(box["x"] + 260, box["y"] + 220, steps=3)
    tab.page.mouse.up()
    assert tab.page.evaluate("flatcloth.current") is None  # a drag is no click


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_fits_its_window(open_page, scheme: str) -> None:
    tab = open_page(scheme=scheme)
    expect(tab.page.locator("html")).to_have_attribute("data-theme", scheme)
    tab.page.keyboard.press("3")
    tab.page.get_by_role("button", name="Show middle").click()
    for width, height in ((1280, 720), (1920, 1080), (820, 1100)):
        tab.page.set_viewport_size({"width": width, "height": height})
        tab.shoot(f"offline-{width}-{scheme}")
        across = tab.page.evaluate("document.documentElement.scrollWidth - innerWidth")
        assert across <= 0
        cut = tab.page.evaluate(
            "[...document.querySelectorAll('.values dd, .readout dd, .button')]"
            ".filter(e => e.offsetParent && e.scrollWidth > e.clientWidth + 1).map(e => e.textContent)"
        )
        assert cut == []
        painted = tab.page.evaluate(
            """() => { const c = document.querySelector("#cloud");
                 const p = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
                 const ground = p.slice(0, 3).join();
                 let count = 0;
                 for (let i = 0; i < p.length; i += 4) if (p.slice(i, i + 3).join() !== ground) count += 1;
                 return [count / (c.width * c.height), p[0]]; }"""
        )
        assert painted[0] > 0.03  # the item fills a part of its pane
        assert painted[1] < 60 if scheme == "dark" else painted[1] > 200


def test_a_browser_that_cannot_unpack_it_says_so(chromium: Browser, file: Path) -> None:
    with contextlib.closing(chromium.new_context(offline=True)) as context:
        context.add_init_script("delete window.DecompressionStream")
        page = context.new_page()
        page.goto(file.as_uri())
        expect(page.locator("#broken")).to_be_visible()
        expect(page.locator("#broken")).to_contain_text("a browser of 2023 or newer")


def test_the_report_prints_on_a4_pages(chromium: Browser, session: OpenedSession, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text(report_of(session), encoding="utf-8")
    with contextlib.closing(chromium.new_context(offline=True)) as context:
        page = context.new_page()
        page.goto(path.as_uri())
        pdf = page.pdf(prefer_css_page_size=True)
        assert b"/MediaBox [0 0 594.95996 841.91998]" in pdf or b"/MediaBox [0 0 595" in pdf
        page.emulate_media(media="print")
        SCREENSHOTS.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=SCREENSHOTS / "report.png", full_page=True)
        overflow = page.evaluate("document.documentElement.scrollWidth - innerWidth")
        assert overflow <= 0
    assert json.dumps(pdf[:5].decode()) == '"%PDF-"'


@pytest.mark.parametrize(
    "program", ["recordings/shirt-sleeve-clean --method paper"], indirect=True, ids=["paper"]
)
def test_the_operator_page_turns_the_grip_and_hands_out_the_offline_page(
    open_tab: Callable[..., Tab], chromium: Browser, tmp_path: Path
) -> None:
    tab = open_tab(1600, 900).ready()
    tab.click_shape()
    tab.page.get_by_text("Set the grip").click()
    for label, text, so in (("Axis °", "25", "axis_from === 'hand'"), ("Open mm", "65", "opening_m > .06")):
        box = tab.page.get_by_label(label)
        box.fill(text)
        box.press("Enter")
        tab.until(f"flatcloth.pick.grip.{so}")
    assert tab.pick()["grip"]["axis_deg"] == pytest.approx(25, abs=1)
    tab.shoot("grip")
    tab.page.get_by_role("button", name="Outline").click()
    tab.until("flatcloth.pick.grip.axis_from === 'outline'")
    tab.page.locator("#canvas").focus()
    tab.page.keyboard.press("x")
    tab.shoot("exports")
    with tab.page.expect_download() as download:
        tab.page.get_by_role("button", name="Offline page").click()
    assert download.value.suggested_filename == "shirt-sleeve-clean-page.html"
    saved = tmp_path / "page.html"
    download.value.save_as(saved)
    tab.page.get_by_role("button", name="Close").click()
    with contextlib.closing(chromium.new_context(offline=True)) as context:
        page = context.new_page()
        page.goto(saved.as_uri())
        page.get_by_role("button", name="Show Pick 1").click()
        expect(page.locator("#pick")).to_contain_text("65 mm")
        expect(page.locator("#hint")).to_contain_text("Step 1 of 1")
