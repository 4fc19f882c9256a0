"""The page as an operator meets it, in Chromium: how long until it shows something, how soon it answers.

The program is started on a bundled recording, its kernels compiled; a browser is open already, as an
operator's is. Times are the clock's; the processor seconds of the program beside them tell how long a
machine that does nothing else would take. ``fresh``: with none of the kernels compiled. ``scene``: until the
3D scene is drawn; from there on, a click until its mark is drawn in 3D and on the flattened view, the pointer
of either pane until its cursor is drawn in the other, and frames while the flattened view is dragged. The
scene is drawn without a graphics card, the worst case, as an ordinary Chromium does then: WebGL by
SwiftShader, all else by the processor. (``--use-angle=swiftshader`` and ``--ignore-gpu-blocklist`` would send
the page itself through an emulated card, which no browser chooses: a second of compiling its shaders falls on
some click.)
Python's byte code of the modules is kept from a start before, as usual; where the environment forbids that,
each start compiles all modules anew, for a second or two.
"""

from __future__ import annotations

import itertools
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from typing import Any

from benchmarks.browser import CHROMIUM
from benchmarks.output import Options, Row, save, say
from flatcloth.engine.warmup import is_compiled

RECORDING = "shirt-sleeve-clean"
STARTS = 5
POINTS = 100
DRAG_S = 4.0
VIEWPORT = {"width": 1280, "height": 800}
FLAGS = ["--no-sandbox", "--enable-unsafe-swiftshader"]

FIRST_PICTURE = "() => window.flatcloth && flatcloth.layerRevision > 0"
SCENE_STANDS = (
    "() => document.getElementById('viser')?.contentWindow.__viserMutable?.nodeRefFromName?.['/live/cloud']"
)

WATCH = """([event, target]) => {
    // From the input event to the animation frame that has drawn each thing that answers it.
    const input = target === "scene" ? document.getElementById("viser").contentWindow : window;
    const origin = input.performance.timeOrigin - performance.timeOrigin;
    window.answered = null;
    const told = () => window.flatcloth_drawn().map((drawn) => JSON.stringify(drawn));
    const before = told(), answers = before.map(() => null);
    input.addEventListener(event, (e) => {
        const asked = e.timeStamp + origin;
        const look = () => {
            told().forEach((drawn, i) => {
                if (drawn !== before[i]) answers[i] ??= performance.now() - asked;
            });
            if (answers.includes(null)) requestAnimationFrame(look);
            else window.answered = answers;
        };
        requestAnimationFrame(look);
    }, {once: true, capture: true});
}"""

IDLE = """() => new Promise((done) => {
    // An operator's next click comes when the one before is drawn: four frames in time, or two seconds.
    const began = performance.now();
    let before = began, inTime = 0;
    const tick = (now) => {
        inTime = now - before < 34 ? inTime + 1 : 0;
        before = now;
        if (inTime >= 4 || now - began > 2000) done();
        else requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
})"""

FRAMES = """(ms) => {
    const times = window.frame_times = [];
    window.frames_over = false;
    const tick = (now) => {
        times.push(now);
        if (now - times[0] < ms) requestAnimationFrame(tick);
        else window.frames_over = true;
    };
    requestAnimationFrame(tick);
}"""


def run(options: Options) -> None:
    """Start the program several times, work with it in Chromium, print and write the medians."""
    from playwright.sync_api import sync_playwright

    assert is_compiled(), "compile first: python -m flatcloth.engine.warmup"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        with tempfile.TemporaryDirectory() as byte_code:
            environment = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": byte_code}
            _one_start(browser, environment, answers=False)
            starts = [_one_start(browser, environment) for _ in range(1 if options.quick else STARTS)]
            fresh = _fresh_start(browser, environment)
        version = browser.version
        browser.close()
    found: Row = {key: statistics.median(start[key] for start in starts) for key in starts[0]} | fresh
    drawn_by = f"Chromium {version}, software rendering"
    found = {"browser": drawn_by, "load": os.getloadavg()[0], "starts": len(starts), **found}
    for key, value in found.items():
        say(f"{key} {value}")
    if not options.quick:
        save("page", found, [RECORDING])


def _fresh_start(browser: Any, environment: Mapping[str, str]) -> dict[str, float]:
    """Start the program as on a machine that has compiled none of the kernels yet."""
    with tempfile.TemporaryDirectory() as cache:
        found = _one_start(browser, {**environment, "NUMBA_CACHE_DIR": cache}, answers=False)
    return {"fresh_address_s": found["address_s"], "fresh_first_picture_s": found["first_picture_s"]}


def _one_start(browser: Any, environment: Mapping[str, str], *, answers: bool = True) -> dict[str, float]:
    page = browser.new_page(viewport=VIEWPORT)
    page.set_default_timeout(120_000)
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, "app.py", "view", RECORDING, "--port", "0", "--session", f"{folder}/session"],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **environment},
        )
        try:
            assert process.stdout is not None
            said = re.search(r"http://\S+", process.stdout.readline())
            assert said is not None
            found = {"address_s": time.perf_counter() - started, "address_cpu_s": _cpu_s(process.pid)}
            page.goto(said.group(), wait_until="commit")
            page.wait_for_function(FIRST_PICTURE)
            found["first_picture_s"] = time.perf_counter() - started
            found["first_picture_cpu_s"] = _cpu_s(process.pid)
            page.wait_for_function(SCENE_STANDS)
            found["scene_s"] = time.perf_counter() - started
            return found | _answers(page) if answers else found
        finally:
            page.close()
            process.terminate()
            process.wait()


def _cpu_s(pid: int) -> float:
    """Return the processor seconds that a process has used (Linux)."""
    with open(f"/proc/{pid}/stat") as stat:
        fields = stat.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _answers(page: Any) -> dict[str, float]:
    """Click and point at the same places, on the flattened view and in the scene."""
    on_plane = page.evaluate(
        # In the middle of the cloth, each far from the one before.
        "(n) => { const l = flatcloth.state.layers, d = l.pixel_size_m, [u, v] = l.origin_uv_m;"
        " const at = (size, by) => d * size * (0.4 + 0.2 * (by % n) / n);"
        " return Array.from({length: n}, (_, i) =>"
        " flatcloth.toScreen(u + at(l.cols, 37 * i), v + at(l.rows, 61 * i))); }",
        POINTS,
    )
    page.evaluate("window.flatcloth_drawn = () => [flatcloth.sceneMarks.drawn, flatcloth.canvas.marksDrawn]")
    frame = page.locator("#viser").bounding_box()
    clicks, in_scene = [], []
    for at in on_plane:
        clicks.append(_timed(page, "pointerup", "plane", lambda at=at: page.mouse.click(at["x"], at["y"])))
        (mark,) = page.evaluate("flatcloth.sceneMarks.drawn")  # the next click takes this one's place
        if mark is not None and mark["inside"]:
            in_scene.append({"x": frame["x"] + mark["x"], "y": frame["y"] + mark["y"]})
    in_scene_ms, on_plane_ms = zip(*clicks, strict=True)
    page.evaluate("window.flatcloth_drawn = () => [flatcloth.sceneMarks.cursorAt]")
    hovers = [
        _timed(page, "pointermove", "plane", lambda at=at: page.mouse.move(at["x"] + 1, at["y"]))[0]
        for at in on_plane
    ]
    page.evaluate("window.flatcloth_drawn = () => [flatcloth.sceneMarks.plane]")
    back = [
        _timed(page, "pointermove", "scene", lambda at=at: page.mouse.move(at["x"], at["y"]))[0]
        for at in in_scene
    ]
    shown = page.locator("#canvas").bounding_box()
    x, y = shown["x"] + shown["width"] / 2, shown["y"] + shown["height"] / 2
    gaps_ms = _dragged_ms(page, x, y)
    return {
        "click_ms": statistics.median(in_scene_ms),
        "slowest_click_ms": max(in_scene_ms),
        "click_plane_ms": statistics.median(on_plane_ms),
        "slowest_click_plane_ms": max(on_plane_ms),
        "hover_ms": statistics.median(hovers),
        "hover_p95_ms": statistics.quantiles(hovers, n=20)[-1],
        "hover_scene_ms": statistics.median(back),
        "hover_scene_p95_ms": statistics.quantiles(back, n=20)[-1],
        "drag_fps": 1000.0 / statistics.mean(gaps_ms),
        "drag_p95_ms": statistics.quantiles(gaps_ms, n=20)[-1],
    }


def _dragged_ms(page: Any, x: float, y: float) -> list[float]:
    """Drag the flattened view about for some seconds; return the times from frame to frame."""
    page.mouse.move(x, y)
    page.mouse.down(button="right")
    page.evaluate(FRAMES, 1000 * DRAG_S)
    for n in itertools.count():
        if page.evaluate("window.frames_over"):
            break
        page.mouse.move(x + 3 * (n % 60), y + 2 * (n % 40))
    page.mouse.up(button="right")
    return [b - a for a, b in itertools.pairwise(page.evaluate("window.frame_times"))]


def _timed(page: Any, event: str, target: str, act: Any) -> list[float]:
    """Return how many milliseconds after an event each thing that ``flatcloth_drawn`` tells was drawn."""
    page.evaluate(IDLE)
    page.evaluate(WATCH, [event, target])
    act()
    page.wait_for_function("window.answered !== null")
    answered: list[float] = page.evaluate("window.answered")
    return answered
