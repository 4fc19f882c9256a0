"""Starts the real program and a real Chromium; pictures of each test are kept in tests/screenshots."""

from __future__ import annotations

import os
import re
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
from forked_program import forked
from playwright.sync_api import Browser, ConsoleMessage, Frame, Page, Response, sync_playwright

from benchmarks.browser import CHROMIUM
from flatcloth.core.config import Config
from flatcloth.recordings import SourceOptions, open_recording
from flatcloth.session.store import SessionFolder

ROOT = Path(__file__).parents[2]
SCREENSHOTS = ROOT / "tests" / "screenshots"
GRAPHICS = ["--enable-unsafe-swiftshader"]
"""Drawing in 3D without a graphics card, as a browser does on a computer that has none."""
FLAGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
FEWER_FRAMES = """
if (window !== top) {
  const draw = window.requestAnimationFrame.bind(window), waiting = new Map();
  let last = 0;
  window.requestAnimationFrame = (then) => {
    const now = ++last;
    waiting.set(now, setTimeout(() => draw((t) => waiting.delete(now) && then(t)), 400));
    return now;
  };
  window.cancelAnimationFrame = (which) => {
    clearTimeout(waiting.get(which));
    waiting.delete(which);
  };
}
"""
"""The 3D scene is drawn at most 2.5 times a second: a picture takes .2 s of CPU without a graphics card."""
VISER = re.compile(r"/viser/?(\?|$)")
WAIT_MS = 90_000
START_LIMIT_S = 60


@pytest.fixture(scope="session")
def launch() -> Iterator[Callable[[list[str]], Browser]]:
    with sync_playwright() as playwright:
        # Without one of the system's, Playwright's own serves, if it is installed.
        if CHROMIUM is None and not Path(playwright.chromium.executable_path).exists():
            pytest.fail("There is no Chromium; install it (apt-get install chromium).", pytrace=False)
        yield lambda flags: playwright.chromium.launch(executable_path=CHROMIUM, args=[*FLAGS, *flags])


@pytest.fixture(scope="session")
def chromium(launch: Callable[[list[str]], Browser]) -> Iterator[Browser]:
    """A browser that draws in 3D."""
    with launch(GRAPHICS) as browser:
        yield browser


@pytest.fixture(scope="session")
def flat_chromium(launch: Callable[[list[str]], Browser]) -> Iterator[Browser]:
    with launch(["--disable-gpu"]) as browser:
        yield browser


class Program:
    """The program, serving a recording on a free port until it is stopped by Ctrl-C.

    Without a session it has that of the recording, or the start screen.
    """

    def __init__(self, arguments: str, session: Path | None, port: int = 0) -> None:
        self._arguments, self._session = arguments, session
        own = [] if session is None else ["--session", str(session)]
        options = ["view", *arguments.split(), "--port", str(port), *own]
        self._process, self._printed = forked(options, str(ROOT))
        self.said: list[str] = []
        self._urls: list[str] = []
        self._answered = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self._answered.wait(START_LIMIT_S)
        if not self._urls:
            self.stop()
            pytest.fail("the program printed no address:\n" + "".join(self.said), pytrace=False)
        self.url = self._urls[0]

    def _read(self) -> None:
        with open(self._printed) as printed:
            for line in printed:
                self.said.append(line)
                if found := re.search(r"http://\S+", line):
                    self._urls.append(found.group())
                    self._answered.set()
        self._answered.set()

    def again(self) -> Program:
        """Start it anew, after it was stopped, with the same session at the same address."""
        return Program(self._arguments, self._session, int(urlsplit(self.url).port or 0))

    def kill(self) -> None:
        """End it as a power cut does."""
        self._process.kill()
        self.stop()

    def stop(self) -> int:
        """End it as an operator does, and return its exit status."""
        if self._process.is_alive():
            os.kill(self._process.pid, signal.SIGINT)
        self._process.join(timeout=30)
        assert self._process.exitcode is not None, "the program did not end in 30 s"
        self._reader.join(timeout=10)
        return self._process.exitcode


@pytest.fixture
def program_of() -> Iterator[Callable[[str, Path | None], Program]]:
    """Start programs, each with its arguments and its session; they end with the test."""
    running: list[Program] = []

    def start(arguments: str, session: Path | None) -> Program:
        running.append(Program(arguments, session))
        return running[-1]

    yield start
    for program in running:
        program.stop()


class SharedProgram(Program):
    """The program of all tests of a worker: each opens a session of its own, as from the start screen."""

    def __init__(self, root: Path) -> None:
        super().__init__(f"--root {root}", None)
        self._root = root
        self.session: Path | None = None

    def begin(self, recording: str) -> SharedProgram:
        """Open a new session of a bundled recording."""
        name = f"session-{len(list(self._root.iterdir()))}"
        self.session = self._root / name
        # The check of the recording has tests of its own: elsewhere it would be a second of CPU a test.
        source = open_recording(ROOT / recording, SourceOptions(as_recorded=True))
        SessionFolder.open(self.session, source, Config(), "robust").close()
        page, token = self.url.split("?token=")
        answer = httpx.post(
            f"{page}start/open",
            json={"kind": "folder", "name": name},
            headers={"Authorization": f"Bearer {token}"},
            timeout=START_LIMIT_S,
        )
        assert answer.status_code == 200, answer.text
        return self


@pytest.fixture(scope="session")
def shared_program(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SharedProgram]:
    running = SharedProgram(tmp_path_factory.mktemp("root"))
    yield running
    assert running.stop() in (0, 130)


@pytest.fixture
def program(
    request: pytest.FixtureRequest, program_of: Callable[[str, Path], Program], tmp_path: Path
) -> Program:
    """A new session of a bundled recording; a program of its own, if it is to have options."""
    source = getattr(request, "param", "recordings/shirt-sleeve-clean")
    if "--" in source:
        return program_of(f"{source} --as-recorded", tmp_path / "session")
    shared: SharedProgram = request.getfixturevalue("shared_program")
    return shared.begin(source)


def findings(page: Page) -> list[str]:
    """Return what axe-core finds: rule, why it matters, and the elements; minor ones are left out."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="pip install '.[test]'")
    viser = {"exclude": [["#viser"]]}  # the page in the frame is viser's own
    rules = {"label-content-name-mismatch": {"enabled": True}}
    options = {"rules": rules, "resultTypes": ["violations"]}  # the nodes of all others are many
    found = axe.Axe().run(page, context=viser, options=options).response["violations"]
    return [
        f"{f['impact']}: {f['id']}: {f['help']}: {[n['html'][:120] for n in f['nodes'][:4]]}"
        for f in found
        if f["impact"] != "minor"
    ]


class Tab:
    """The operator page in a tab, with what tests want to know of it."""

    def __init__(self, page: Page, url: str, *, has_scene: bool) -> None:
        self.page, self.has_scene = page, has_scene
        if has_scene:
            page.add_init_script(FEWER_FRAMES)
        else:
            page.route(VISER, lambda route: route.fulfill(body="<!doctype html><title>no scene</title>"))
        self.errors: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", self._hear)
        page.on("response", self._see)
        page.set_default_timeout(WAIT_MS)
        page.goto(url)

    def _hear(self, said: ConsoleMessage) -> None:
        # What the browser says of a refused request or a lost connection is no error of the page.
        if (
            said.type == "error"
            and "Failed to load resource" not in said.text
            and "WebSocket" not in said.text
        ):
            self.errors.append(f"console: {said.text}")

    def _see(self, response: Response) -> None:
        if response.status == 404:
            self.errors.append(f"404: {response.url}")

    @property
    def scene(self) -> Frame:
        return next(f for f in self.page.frames if VISER.search(f.url))

    def until(self, expression: str) -> None:
        self.page.wait_for_function(f"() => window.flatcloth && ({expression})")

    def state(self) -> dict:
        return self.page.evaluate("flatcloth.state")

    def pick(self) -> dict:
        return self.page.evaluate("flatcloth.pick")

    def ready(self) -> Tab:
        """Wait until the start view is drawn, also in the scene; then no step is made unasked."""
        self.until("flatcloth.layerRevision > 0 && flatcloth.phase === 'ready'")
        self.page.evaluate("flatcloth.send({type: 'set', values: {advance: false}})")
        self.until("!flatcloth.state.settings.advance")
        if self.has_scene:
            self.scene_shows("/live/cloud")
        return self

    def scene_shows(self, node: str) -> None:
        of_scene = "document.getElementById('viser').contentWindow.__viserMutable?.nodeRefFromName"
        self.page.wait_for_function(f"() => {of_scene}?.[{node!r}]")

    def areas_known(self) -> None:
        """Wait until what each view really added to the shape is known, which is computed afterwards."""
        self.until("flatcloth.state.views.every((v) => v.order === null || v.added_cm2 !== null)")

    def step(self) -> None:
        """Step, and wait until the proposal is drawn."""
        self.page.keyboard.press("s")
        self.proposed()

    def proposed(self) -> None:
        """Wait until a proposal is drawn."""
        self.until("flatcloth.phase === 'deciding' && flatcloth.overlayRevision > 0")

    def accept(self) -> None:
        """Accept, and wait until the new shape is drawn."""
        step, revision = self.page.evaluate("[flatcloth.step, flatcloth.layerRevision]")
        self.page.keyboard.press("a")
        self.until(f"flatcloth.step === {step + 1} && flatcloth.layerRevision > {revision}")

    def click_shape(self, along: float = 0.5, down: float = 0.5) -> dict:
        """Click the flattened view at shares of its width and height, and keep the pick; return it."""
        count = len(self.state()["picks"])
        self.page.mouse.click(*self.at(self.place(along, down)))
        self.until(f"flatcloth.state.picks.length === {count + 1}")
        self.page.keyboard.press("Enter")
        return self.pick()

    def place(self, along: float, down: float, grid: dict | None = None) -> list[float]:
        """Return the place of the plane at shares of the width and height of a grid, that of the shape."""
        grid = grid or self.state()["layers"]
        size = grid["pixel_size_m"]
        u, v = grid["origin_uv_m"]
        return [u + size * along * grid["cols"], v + size * down * grid["rows"]]

    def at(self, uv: Sequence[float]) -> tuple[float, float]:
        """Return where a place of the plane is on the page."""
        x, y = self.page.evaluate(
            "([u, v]) => { const at = flatcloth.toScreen(u, v); return [at.x, at.y]; }", list(map(float, uv))
        )
        return x, y

    def drawn(self, uv: Sequence[float], reach: int = 0) -> list[list[int]]:
        """Return the colours (4,) that the canvas shows at a place of the plane and around it."""
        data = self.page.evaluate(
            """async ([u, v, reach]) => {
                await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
                const c = document.getElementById("canvas"), box = c.getBoundingClientRect();
                const at = flatcloth.toScreen(u, v), size = 2 * reach + 1;
                const [x, y] = [at.x - box.left, at.y - box.top].map(Math.round);
                return [...c.getContext("2d").getImageData(x - reach, y - reach, size, size).data]; }""",
            [*map(float, uv), reach],
        )
        return [data[n : n + 4] for n in range(0, len(data), 4)]

    def on_proposal(self, x: float, y: float) -> float:
        """Return the x of the nearest place left of (x, y) on the page where the proposal can be taken."""
        return self.page.evaluate(
            """([x, y]) => {
                const canvas = document.getElementById("canvas");
                for (let left = x; left > x - 160; left -= 2) {
                    const at = { clientX: left, clientY: y };
                    canvas.dispatchEvent(new PointerEvent("pointermove", at));
                    if (canvas.style.cursor === "move") return left;
                }
                throw new Error("there is no cloth of the proposal");
            }""",
            [x, y],
        )

    def drag(self, start: tuple[float, float], *through: tuple[float, float]) -> None:
        """Press at a place of the page, move through others, and let go at the last."""
        mouse = self.page.mouse
        mouse.move(*start)
        mouse.down()
        for x, y in through:
            mouse.move(x, y, steps=5)
        mouse.up()

    def mark(self) -> tuple[float, float]:
        """Return where the current pick is marked over the scene, in pixels of the page, once it is."""
        mark = self.page.wait_for_function(
            """() => {
                const { drawn } = flatcloth.sceneMarks;
                const mark = drawn.find((mark) => mark && mark.id === flatcloth.pick?.id);
                const { x, y } = document.getElementById('viser').getBoundingClientRect();
                return mark && [x + mark.x, y + mark.y];
            }"""
        )
        x, y = mark.json_value()
        return x, y

    def overflow(self) -> list[int]:
        """Return by how many pixels the page is wider and higher than its window."""
        return self.page.evaluate(
            "(e => [e.scrollWidth - innerWidth, e.scrollHeight - innerHeight])(document.documentElement)"
        )

    def findings(self) -> list[str]:
        return findings(self.page)

    def shoot(self, name: str) -> None:
        SCREENSHOTS.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=SCREENSHOTS / f"{name}.png")


@pytest.fixture
def open_tab(program: Program, request: pytest.FixtureRequest):
    """Open tabs; they have the 3D scene only where a test is marked ``scene``."""
    tabs: list[Tab] = []
    has_scene = request.node.get_closest_marker("scene") is not None
    browser = request.getfixturevalue("chromium" if has_scene else "flat_chromium")

    def open_one(
        width: int = 1280, height: int = 720, scheme: str = "light", *, has_scene=has_scene, has_touch=False
    ) -> Tab:
        size = {"width": width, "height": height}
        page = browser.new_page(viewport=size, color_scheme=scheme, has_touch=has_touch)
        tabs.append(Tab(page, program.url, has_scene=has_scene))
        return tabs[-1]

    yield open_one
    for number, tab in enumerate(tabs):
        tab.shoot(f"last-{request.node.name}-{number}")
        tab.page.close()
    assert [e for tab in tabs for e in tab.errors] == []
