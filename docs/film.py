"""Makes ``docs/session.gif``, the animation of the README: the real program, driven in Chromium.

``python docs/film.py [RECORDING]`` from the repository; needs the packages of the tests. The operator's
keys are pressed one by one; each state is one frame. Fails if the file would be larger than 3 MB.
"""

from __future__ import annotations

import io
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
OUT = ROOT / "docs" / "session.gif"
MOST_BYTES = 3_000_000
SIZE = (1280, 800)
SHOWN = (960, 600)
COLORS = 256
VIEWS = 5
FLAGS = [
    *("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
    *("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"),
]
NAMES = ("chromium-headless-shell", "chromium")
WAIT_MS = 240_000
SETTLED_MS = 1500
"""The 3D scene of software drawing follows the page by about this."""


def main() -> None:
    """Film a session and write the animation."""
    recording = sys.argv[1] if len(sys.argv) > 1 else "recordings/shirt-sleeve-clean"
    with tempfile.TemporaryDirectory(prefix="flatcloth-film-") as folder:
        command = [sys.executable, "app.py", "view", recording, "--port", "0", "--session", folder]
        program = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        try:
            assert program.stdout is not None
            found = (re.search(r"http://\S+", line) for line in program.stdout)
            url = next(match.group() for match in found if match)
            frames = list(_filmed(url))
        finally:
            program.send_signal(signal.SIGINT)
            program.wait(30)
    data = _gif(frames)
    if len(data) > MOST_BYTES:
        sys.exit(f"{OUT}: it would have {len(data) / 1e6:.1f} MB; film fewer states.")
    OUT.write_bytes(data)
    sys.stdout.write(f"{OUT}: {len(frames)} frames, {len(data) / 1e6:.2f} MB\n")


def _filmed(url: str) -> Iterator[tuple[bytes, int]]:
    """Yield the pictures (PNG) of a session, each with how long it is shown (ms)."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=next(filter(None, map(shutil.which, NAMES)), None), args=FLAGS
        )
        page = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]}, color_scheme="light")
        page.set_default_timeout(WAIT_MS)
        page.goto(url)
        _until(page, "flatcloth.layerRevision > 0 && flatcloth.phase === 'ready'")
        page.wait_for_timeout(4 * SETTLED_MS)
        yield _picture(page), 1500
        page.keyboard.press("s")
        for n in range(VIEWS):
            _until(page, "flatcloth.phase === 'deciding' && flatcloth.overlayRevision > 0")
            yield _picture(page), 1300 if n == 0 else 800
            if n == 0:
                page.keyboard.press("i")
                _until(page, "flatcloth.diagnostics.known !== null")
                yield _picture(page), 2000
                page.keyboard.press("i")
            if n == VIEWS - 1:  # the result is shown after it, and not another proposal
                page.evaluate("flatcloth.send({type: 'set', values: {advance: false}})")
            step, revision = page.evaluate("[flatcloth.step, flatcloth.layerRevision]")
            page.keyboard.press("a")
            _until(page, f"flatcloth.step === {step + 1} && flatcloth.layerRevision > {revision}")
            yield _picture(page), 900
        at = page.evaluate(
            "(() => { const l = flatcloth.state.layers, d = l.pixel_size_m, [u, v] = l.origin_uv_m;"
            " return flatcloth.toScreen(u + 0.3 * d * l.cols, v + 0.45 * d * l.rows); })()"
        )
        page.mouse.click(at["x"], at["y"])
        _until(page, "flatcloth.pick !== null")
        yield _picture(page), 2200
        page.keyboard.press("Shift+E")
        _until(page, "flatcloth.result.found && flatcloth.result.found.revision === flatcloth.layerRevision")
        page.keyboard.press("Shift+R")
        yield _picture(page), 3500
        browser.close()


def _until(page: Any, expression: str) -> None:
    page.wait_for_function(f"() => window.flatcloth && ({expression})")


def _picture(page: Any) -> bytes:
    page.wait_for_timeout(SETTLED_MS)
    picture: bytes = page.screenshot()
    return picture


def _gif(frames: list[tuple[bytes, int]]) -> bytes:
    """Return the frames as a GIF, all with one palette, so that only changes are stored."""
    from PIL import Image

    images = [
        Image.open(io.BytesIO(data)).convert("RGB").resize(SHOWN, Image.Resampling.LANCZOS)
        for data, _ in frames
    ]
    mosaic = Image.new("RGB", (SHOWN[0], SHOWN[1] * len(images)))
    for n, image in enumerate(images):
        mosaic.paste(image, (0, n * SHOWN[1]))
    palette = Image.new("P", (1, 1))
    # One half for what covers most, the other for the accents.
    methods = Image.Quantize.MEDIANCUT, Image.Quantize.MAXCOVERAGE
    halves = [
        mosaic.quantize(COLORS // 2, method, dither=Image.Dither.NONE).getpalette() for method in methods
    ]
    palette.putpalette([value for half in halves for value in (half or [])[: 3 * COLORS // 2]])
    drawn = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    file = io.BytesIO()
    durations = [shown_ms for _, shown_ms in frames]
    drawn[0].save(
        file, "GIF", save_all=True, append_images=drawn[1:], duration=durations, loop=0, optimize=True
    )
    return file.getvalue()


if __name__ == "__main__":
    main()
