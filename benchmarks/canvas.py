"""The flattened view in a browser, as many pixels as 1500 x 1500: its frames, and how soon a nudge is seen.

Without the 3D scene, and with the browser's software rendering: a machine without a graphics card is the
worst case. The pixels are those of a bundled recording, flattened finer than usual.
"""

from __future__ import annotations

import itertools
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from typing import Any

from benchmarks.browser import CHROMIUM
from benchmarks.output import Options, save

RECORDING = "shirt-sleeve-clean"
LEAST_PIXELS = 1500 * 1500
PIXEL_SIZE_M = 0.00045
SECONDS = 4.0
NUDGES = 30
FLAGS = ["--no-sandbox", "--disable-gpu"]

SERVE = """
import sys
from dataclasses import replace
from pathlib import Path
from flatcloth.core.config import Config, FlatteningConfig
from flatcloth.engine.integration import Integration
from flatcloth.session.store import SessionFolder
from flatcloth.recordings import open_recording
from flatcloth.core.resources import sample_recordings
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened
made = Integration(
    open_recording(str(sample_recordings()[sys.argv[1]])),
    Config(flattening=FlatteningConfig(pixel_size_m=float(sys.argv[2]))),
)
folder = SessionFolder.open(Path(sys.argv[3]), made.recording, made.config, made.method)
with PageServer(Opened(made, folder), port=0) as server:
    print(server.url, flush=True)
    sys.stdin.read()
"""

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

DRAWS = """async () => {
    const { FlatCanvas } = await import("./static/canvas/canvas.js");
    const draw = FlatCanvas.prototype.draw, times = [];
    FlatCanvas.prototype.draw = function () {
        const before = performance.now();
        draw.call(this);
        this.context.getImageData(0, 0, 1, 1);  // waits for the pixels
        times.push(performance.now() - before);
    };
    for (let n = 0; n < 40; n++) {
        document.dispatchEvent(new KeyboardEvent("keydown", {key: n % 2 ? "+" : "-", bubbles: true}));
        await new Promise(requestAnimationFrame);
    }
    FlatCanvas.prototype.draw = draw;
    return times.slice(4);
}"""

KEY = """() => new Promise((done) => {
    const before = performance.now();
    document.dispatchEvent(new KeyboardEvent("keydown", {key: "ArrowRight", bubbles: true}));
    // The frame that draws it, and the next one, which begins when that has been drawn.
    requestAnimationFrame(() => requestAnimationFrame(() => done(performance.now() - before)));
})"""

MOVE = """(by) => new Promise((done) => {
    const revision = flatcloth.overlayRevision, before = performance.now();
    flatcloth.send({type: "move", view_index: flatcloth.state.pending.view_index, u_m: by});
    const look = () => (flatcloth.overlayRevision > revision
        ? requestAnimationFrame(() => done(performance.now() - before)) : requestAnimationFrame(look));
    look();
})"""


def run(options: Options) -> None:
    """Serve a recording at a fine pixel size, move it about in Chromium, print and write the figures."""
    found = _measure(PIXEL_SIZE_M)
    assert found["rows"] * found["cols"] >= LEAST_PIXELS, "choose a smaller pixel"
    for key, text in (
        ("pan_fps", "frames a second, panning"),
        ("pan_p95_ms", "longest frame of 95 %, panning, ms"),
        ("zoom_fps", "frames a second, zooming"),
        ("zoom_p95_ms", "longest frame of 95 %, zooming, ms"),
        ("draw_ms", "one drawing of shape, proposal and outline, pixels included, ms"),
        ("nudge_ms", f"arrow key to the frame after it is drawn (median of {NUDGES}), ms"),
        ("nudge_worst_ms", "slowest arrow key, ms"),
        ("moved_ms", "move told to the server until its picture is drawn (median), ms"),
    ):
        print(f"{text:<72}{found[key]:10.1f}")
    if not options.quick:
        save("canvas", found, ["shirt-sleeve-clean"])


def _measure(size_m: float) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", SERVE, RECORDING, str(size_m), f"{folder}/session"]
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            return {"pixel_size_mm": 1e3 * size_m, **_in_browser(process.stdout.readline().strip())}
        finally:
            process.terminate()
            process.wait()


def _in_browser(url: str) -> dict[str, Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = browser.new_page(viewport={"width": 1920, "height": 1080})
        page.set_default_timeout(120_000)
        page.goto(url)
        page.wait_for_function("window.flatcloth && flatcloth.layerRevision > 0")
        page.evaluate("document.getElementById('viser').remove()")
        page.keyboard.press("s")
        page.wait_for_function("flatcloth.phase === 'deciding' && flatcloth.overlayRevision > 0")
        layers = page.evaluate("flatcloth.state.layers")
        shown = page.evaluate(
            "(() => { const b = document.getElementById('canvas').getBoundingClientRect();"
            " return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )
        pan = frames(page, lambda n: page.mouse.move(shown[0] + 3 * (n % 60), shown[1] + 2 * (n % 40)), shown)
        zoom = frames(page, lambda n: page.mouse.wheel(0, 24 if n // 40 % 2 else -24), None)
        draws = page.evaluate(DRAWS)
        nudges = [page.evaluate(KEY) for _ in range(NUDGES)]
        page.wait_for_timeout(1500)
        moves = [page.evaluate(MOVE, 0.002 * (-1) ** n) for n in range(10)]
        version = browser.version
        browser.close()
    return {
        "browser": f"Chromium {version}, software rendering",
        "rows": layers["rows"],
        "cols": layers["cols"],
        "overlay_rows": layers["overlay"]["rows"],
        "overlay_cols": layers["overlay"]["cols"],
        **{f"pan_{k}": v for k, v in pan.items()},
        **{f"zoom_{k}": v for k, v in zoom.items()},
        "draw_ms": statistics.median(draws),
        "nudge_ms": statistics.median(nudges),
        "nudge_worst_ms": max(nudges),
        "moved_ms": statistics.median(moves),
        "moved_worst_ms": max(moves),
    }


def frames(page: Any, act: Any, drag_from: Sequence[float] | None) -> dict[str, float]:
    """Act as often as the page takes it for some seconds, right button held; return their rate."""
    if drag_from is not None:
        page.mouse.move(*drag_from)
        page.mouse.down(button="right")
    page.evaluate(FRAMES, 1000 * SECONDS)
    n = 0
    while not page.evaluate("window.frames_over"):
        act(n)
        n += 1
    times = page.evaluate("window.frame_times")
    if drag_from is not None:
        page.mouse.up(button="right")
    gaps = [b - a for a, b in itertools.pairwise(times)]
    return {
        "fps": 1000.0 * len(gaps) / (times[-1] - times[0]),
        "p95_ms": statistics.quantiles(gaps, n=20)[-1],
        "events_s": 1000.0 * n / (times[-1] - times[0]),
    }
