"""Two tasks of an operator, scripted in Chromium: how many actions each takes from the opened page on.

The recordings are given: of each that has a false link, told by the garment, the decision of the unattended
run about it is taken back, and the operator finds the link, is told why it holds, and cuts it. Of each, its
masks left out, the operator strokes two undecided places, on the side that its masks tell, and finishes it.
An action is a key, a click or a stroke.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.browser import CHROMIUM
from benchmarks.output import Options, recordings_of, save, say
from benchmarks.page import FIRST_PICTURE, FLAGS
from flatcloth.cli import main
from flatcloth.core.resources import sample_recordings
from flatcloth.engine.evaluation import compare
from flatcloth.export.session import open_session
from flatcloth.recordings import open_recording
from flatcloth.recordings.base import Recording
from flatcloth.recordings.truth import Truth

VIEWPORT = {"width": 1366, "height": 768}
WAIT_MS = 600_000
STROKES = 2
_FIGURES = ("coverage", "wrong_side_share", "absolute_median_mm", "absolute_p95_mm")
"""What is told of a shape's accuracy; see ``flatcloth evaluate``."""
QUIET = "flatcloth.state.request === null && !flatcloth.state.drawing"


class Operator:
    """Works with a page, and counts what it does."""

    def __init__(self, page: Any) -> None:
        self.page, self.actions = page, 0

    def key(self, key: str) -> None:
        self.actions += 1
        self.page.keyboard.press(key)

    def click(self, name: str) -> None:
        self.actions += 1
        self.page.get_by_role("button", name=name).first.click()

    def stroke(self, row: float, col: float) -> None:
        """Draw a short line in the source image, down from a pixel of the recorded image."""
        self.actions += 1
        box = self.page.locator("#source-canvas").bounding_box()
        drawn = self.state("flatcloth.sources.drawn")
        x = box["x"] + (col + 0.5 - drawn["box"]["left"]) * drawn["scale"]
        y = box["y"] + (row + 0.5 - drawn["box"]["top"]) * drawn["scale"]
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(x, y + 2, steps=2)
        self.page.mouse.up()

    def until(self, expression: str) -> None:
        self.page.wait_for_function(f"() => window.flatcloth && ({expression})")

    def state(self, expression: str = "flatcloth.state") -> Any:
        return self.page.evaluate(expression)


def run(options: Options) -> None:
    """Do both tasks on each recording, print the actions, and write ``results/operating.json``."""
    rows = []
    for source in options.recordings or [str(sample_recordings()["shirt-corner-d435"])]:
        row: dict[str, Any] = {"recording": Path(source).name}
        with tempfile.TemporaryDirectory() as folder:
            row |= _false_link(source, Path(folder) / "session")
            row |= _without_masks(source, Path(folder) / "bare")
        rows.append(row)
        say("   ".join(f"{key} {value}" for key, value in row.items()))
    if not options.quick:
        save("operating", rows, recordings_of(rows))


@contextlib.contextmanager
def _opened(*arguments: str) -> Iterator[Operator]:
    from playwright.sync_api import sync_playwright

    command = [sys.executable, "app.py", "view", *arguments, "--port", "0"]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process,
        sync_playwright() as started,
    ):
        try:
            assert process.stdout is not None
            said = re.search(r"http://\S+", process.stdout.readline())
            assert said is not None
            page = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS).new_page(viewport=VIEWPORT)
            page.set_default_timeout(WAIT_MS)
            page.goto(said.group(), wait_until="commit")
            page.wait_for_function(FIRST_PICTURE)
            yield Operator(page)
            page.context.close()
        finally:
            process.terminate()


def _false_link(source: str, folder: Path) -> dict[str, Any]:
    """Cut the link that the garment told of; None if it told of none."""
    with contextlib.redirect_stdout(io.StringIO()):
        if code := main(["run", source, "--out", str(folder)]):
            raise SystemExit(code)
    told = json.loads((folder / "outcome.json").read_text())["garment"].get("taken_off_by_the_garment")
    if not told:
        return {"false_link_actions": None}
    with _opened(source, "--session", str(folder)) as operator:  # what the run decided is taken back
        while "take a part off by the garment" in operator.state("flatcloth.state.done"):
            done = len(operator.state("flatcloth.state.done"))
            operator.key("u")
            operator.until(f"flatcloth.state.done.length < {done} && {QUIET}")
    with _opened(source, "--session", str(folder)) as operator:
        operator.until(QUIET)
        before = operator.state("flatcloth.state.layers.area_cm2")
        operator.key("Shift+Y")
        operator.until("flatcloth.joints.found?.joints.length > 0 && flatcloth.joints.chosen === 0")
        weakest = operator.state("flatcloth.joints.found.joints[0]")
        operator.click("Cut here")
        operator.until(f"flatcloth.state.done.at(-1).startsWith('take a part off') && {QUIET}")
        operator.until(f"flatcloth.state.layers.area_cm2 < {before}")
        return {
            "false_link_actions": operator.actions,
            "cut_cm2": round(weakest["area_cm2"], 1),
            "evidence": round(weakest["evidence"], 2),
            "views": len(weakest["views"]),
        }


def _without_masks(source: str, folder: Path) -> dict[str, Any]:
    """Finish the recording without its masks, with strokes where the page says."""
    recording = open_recording(source)
    with _opened(source, "--without-masks", "--session", str(folder)) as operator:
        operator.until(f"flatcloth.state.sides?.certainty && {QUIET} && flatcloth.sources.drawn")
        for number in range(1, STROKES + 1):
            operator.key("Shift+W")
            operator.until("flatcloth.sources.drawn.view === flatcloth.sources.aim?.view")
            aim = operator.state("flatcloth.sources.aim")
            row, col = aim["rc"]
            mask = recording[aim["view"]].mask
            side = "this" if mask is None or mask[round(row), round(col)] else "other"
            if operator.state("flatcloth.sides.kind") != side:
                operator.key("Shift+S" if side == "this" else "Shift+N")
                operator.until(f"flatcloth.sides.kind === '{side}'")
            operator.stroke(row, col)
            operator.until(f"flatcloth.state.sides.n_strokes === {number} && {QUIET}")
        operator.key("g")
        while True:
            operator.until(f"(flatcloth.state.auto.waits_for || flatcloth.state.finished) && {QUIET}")
            if operator.state("flatcloth.state.finished"):
                break
            done = len(operator.state("flatcloth.state.done"))
            operator.key("k")  # unsure: left out for now
            operator.until(f"flatcloth.state.done.length > {done}")
        state = operator.state()
        found = {
            "without_masks_actions": operator.actions,
            "certainty": round(state["sides"]["certainty"], 3),
            "area_cm2": round(state["layers"]["area_cm2"]),
            "finished": state["finished"],
        }
    return found | _accuracy(folder, recording)


def _accuracy(folder: Path, recording: Recording) -> dict[str, float]:
    """Compare a session's shape with the truth of its recording."""
    found = compare(open_session(folder).view, Truth(recording.location), recording).evaluation
    return {f"without_masks_{name}": round(getattr(found, name), 4) for name in _FIGURES}
