"""The page in browsers without WebGL and behind proxies that refuse it: what it says, and what works."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, sync_playwright
from reverse_proxy import Proxy, proxied

from benchmarks.browser import CHROMIUM

pytestmark = pytest.mark.browser

OTHER_HOST = "lab.example.org"
FLAGS = ["--no-sandbox", "--disable-gpu", f"--host-resolver-rules=MAP {OTHER_HOST} 127.0.0.1"]
NO_GRAPHICS = "The 3D view needs WebGL 2, which this browser does not give it."
FAKE = """(() => {
    const get = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
        if (!/webgl/.test(kind)) return get.call(this, kind, ...more);
        %s
    };
})()"""
"""Lets WebGL behave so."""
Look = Callable[[Callable[[Browser], Any]], Any]


@pytest.fixture(scope="module")
def look() -> Iterator[Look]:
    """Run steps in a browser that draws nothing in 3D: in a thread, as other tests leave a loop in theirs."""
    with ThreadPoolExecutor(1) as thread:
        playwright = thread.submit(lambda: sync_playwright().start()).result()
        browser = thread.submit(
            lambda: playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        ).result()
        yield lambda steps: thread.submit(steps, browser).result()
        thread.submit(browser.close).result()
        thread.submit(playwright.stop).result()


def words_of(page: Page, element: str, words: str = "") -> str:
    """Wait until an element is shown and has these words, and return its text."""
    found = page.locator(element, has_text=words)
    found.wait_for(state="visible", timeout=60_000)
    return found.inner_text()


WITHOUT = {
    "switched off": "return null;",
    "WebGL 1 only": "return kind === 'webgl2' ? null : get.call(this, kind, ...more);",
}


@pytest.mark.parametrize(
    ("behaviour", "width"), [*zip(WITHOUT.values(), (1280, 390), strict=True)], ids=WITHOUT
)
def test_without_webgl_a_line_says_so_and_the_flat_part_works(server, look, behaviour, width):
    def steps(browser: Browser) -> tuple[str, list[str]]:
        errors: list[str] = []
        with browser.new_page(viewport={"width": width, "height": 720}) as page:
            page.on("pageerror", lambda error: errors.append(str(error)))
            page.add_init_script(FAKE % behaviour)
            page.goto(server.url)
            page.wait_for_function("window.flatcloth?.layerRevision > 0", timeout=60_000)
            if width < 600:
                page.get_by_role("button", name="3D").first.click()
            said = words_of(page, "#scene-empty")
            page.keyboard.press("h")
            page.wait_for_function("window.flatcloth.teaching?.open")
            return said, errors

    said, errors = look(steps)
    assert said.startswith(NO_GRAPHICS)
    assert errors == []


def test_lost_graphics_are_told_until_they_are_back(server, look):
    def steps(browser: Browser) -> tuple[str, bool]:
        with browser.new_page() as page:
            page.add_init_script(FAKE % "return { getExtension: () => null };")
            scene = "<!doctype html><canvas></canvas>"
            page.route("**/viser/*", lambda route: route.fulfill(body=scene, content_type="text/html"))
            page.goto(server.url)
            page.wait_for_function(
                "document.getElementById('viser').contentDocument?.querySelector('canvas')"
            )
            page.wait_for_function("window.flatcloth?.layerRevision > 0")
            happens = "kind => viser.contentDocument.querySelector('canvas').dispatchEvent(new Event(kind))"
            page.evaluate(happens, "webglcontextlost")
            said = words_of(page, "#scene-empty")
            page.evaluate(happens, "webglcontextrestored")
            return said, page.locator("#scene-empty").is_hidden()

    said, is_back = look(steps)
    assert "WebGL context lost" in said
    assert is_back


BEHIND = {
    "scripts refused, Host set": (Proxy(keeps_host=False), OTHER_HOST, "#unloaded", "start flatcloth with"),
    "a proxy without sockets": (Proxy(knows_sockets=False), "localhost", "#banner", "headers Upgrade and"),
}


@pytest.mark.parametrize(("proxy", "host", "element", "words"), BEHIND.values(), ids=BEHIND)
def test_a_page_that_a_proxy_keeps_from_working_says_why(server, look, proxy, host, element, words):
    with proxied(proxy, server.port) as port:

        def steps(browser: Browser) -> str:
            with browser.new_page() as page:
                page.goto(f"http://{host}:{port}/?token={server.token}")
                return words_of(page, element, words)  # the reason comes after the loss itself

        assert look(steps)


def test_below_a_sub_path_nothing_is_asked_for_above_it(server, look):
    def steps(browser: Browser) -> list[str]:
        asked: list[str] = []
        with browser.new_page() as page:
            page.on("request", lambda request: asked.append(request.url))
            page.on("websocket", lambda socket: asked.append(socket.url))
            page.goto(f"http://localhost:{port}/cloth/?token={server.token}")
            page.wait_for_function("window.flatcloth?.layerRevision > 0", timeout=60_000)
        return asked

    with proxied(Proxy("/cloth"), server.port) as port:
        asked = look(steps)
    assert f"ws://localhost:{port}/cloth/ws" in asked
    assert [url for url in asked if f"//localhost:{port}/cloth/" not in url and "blob:" not in url] == []
