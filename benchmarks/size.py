"""A large recording: how long it takes to open, and how much memory looking and a whole run take.

72 views of 1280x720 px (portrait) of a fluted tube of cloth that turns about the camera's vertical,
before a wall, computed; depth in millimetres with half a millimetre of noise. Each figure is of a process of
its own, as ``flatcloth run`` is. What the machine was doing besides is written with the figures: times on
a busy machine are upper bounds, the processor's own times (``cpu``) hold on any.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numba import njit

from benchmarks.output import Options, save

WIDTH, HEIGHT, FOCAL_PX = 720, 1280, 640.0
VIEWS = 72
DISTANCE_M, WALL_M = 0.85, 1.6
TOP_M, BOTTOM_M = -0.5, 0.45
RADIUS_M, FLUTE_M, FLUTES = 0.16, 0.02, 5
INTEREST_DEG = 115.0

OPEN = """
import json, sys, time
started = time.perf_counter()
from flatcloth.engine.integration import Integration
from flatcloth.recordings import open_recording
imported = time.perf_counter()
recording = open_recording(sys.argv[1])
read, cpu = time.perf_counter(), time.process_time()
made = Integration(recording)
opened = time.perf_counter()
found = {
    "import_s": imported - started, "read_s": read - imported, "open_s": opened - imported,
    "axis_s": opened - read, "axis_cpu_s": time.process_time() - cpu, "axis": made.axis.point_m.tolist(),
}
print(json.dumps(found))
"""

LOOK = """
import json, sys
from flatcloth.core.errors import FlatclothError
from flatcloth.engine.integration import Integration
from flatcloth.recordings import open_recording
made = Integration(open_recording(sys.argv[1]))
for view in range(len(made.recording)):
    made.views.cloud(view)
    try:
        made.views.flattening(view)
    except FlatclothError:
        pass
print(json.dumps({}))
"""

RUN = """
import json, sys
from flatcloth.cli import main
assert main(["run", sys.argv[1], "--out", sys.argv[2]]) == 0
"""


def run(options: Options) -> None:
    """Write the recording to a temporary folder, measure, print a table and write ``results/size.json``."""
    quick = options.quick
    found: dict[str, Any] = {"load": _load()}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "large"
        started = time.perf_counter()
        write_recording(folder, 6 if quick else VIEWS)
        size = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
        _say("views written", f"{6 if quick else VIEWS} in {time.perf_counter() - started:.0f} s")
        _say("size on disk, MB", f"{size / 1e6:.0f}")
        opened = _fastest(OPEN, str(folder))
        _say("imports, s", f"{opened['import_s']:.2f}")
        _say("opened, axis recorded, s", f"{opened['open_s']:.2f}")
        found |= {"views": 6 if quick else VIEWS, "import_s": opened["import_s"], "open_s": opened["open_s"]}
        _without_axis(folder)
        opened = _fastest(OPEN, str(folder))
        error_mm = 1000 * math.hypot(opened["axis"][0], opened["axis"][2] - DISTANCE_M)
        _say("opened, axis estimated, s", f"{opened['open_s']:.2f} (axis off by {error_mm:.1f} mm)")
        _say("    of that the axis, s", f"{opened['axis_s']:.2f} (cpu {opened['axis_cpu_s']:.2f})")
        found |= {"open_without_axis_s": opened["open_s"], "axis_error_mm": error_mm}
        found |= {name: opened[name] for name in ("axis_s", "axis_cpu_s")}
        looked = _child(LOOK, str(folder))
        _say("every view looked at and flattened, s", f"{looked['seconds']:.1f}")
        _say("    its peak memory, MiB", f"{looked['peak_mib']:.0f}")
        ran = _child(RUN, str(folder), str(Path(place) / "result"))
        _say("whole run, s", f"{ran['seconds']:.1f}")
        _say("    its peak memory, MiB", f"{ran['peak_mib']:.0f}")
        found |= {"look_s": looked["seconds"], "look_peak_mib": looked["peak_mib"]}
        found |= {"run_s": ran["seconds"], "run_peak_mib": ran["peak_mib"], "load_after": _load()}
    if not quick:
        save("size", found)


def _load() -> list[float]:
    """Return how many processes wanted to run, over the last 1, 5 and 15 minutes."""
    return [round(x, 2) for x in os.getloadavg()]


def _fastest(code: str, *arguments: str) -> dict[str, Any]:
    """Return the fastest of five runs: what else the machine does only makes one slower."""
    return min((_child(code, *arguments) for _ in range(5)), key=lambda found: found["open_s"])


def _say(text: str, figure: str) -> None:
    print(f"{text:<44}{figure:>12}", flush=True)


def _child(code: str, *arguments: str) -> dict[str, Any]:
    """Run Python code in a new process; return what it printed, its time and its peak memory."""
    started = time.perf_counter()
    wrapped = (
        f"{code}\nimport resource\n"
        "print(json.dumps({'peak_mib': resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", wrapped, *arguments], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(done.stderr)
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    found: dict[str, Any] = {"seconds": time.perf_counter() - started}
    for line in lines:
        found |= line
    return found


# --- the recording ---------------------------------------------------------------------------


def write_recording(folder: Path, views: int, width: int = WIDTH, height: int = HEIGHT) -> Path:
    """Write a recording folder with so many views, evenly around the item."""
    for kind in ("color", "depth", "mask"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    focal = FOCAL_PX * width / WIDTH
    rng = np.random.default_rng(0)
    listed = []
    for n in range(views):
        angle = 360.0 * n / views
        depth, around, down = _render(width, height, focal, math.radians(angle))
        seen = depth > 0
        # The wall behind is measured too: its noise is most of what there is to decode.
        noise_mm = rng.normal(0.0, np.where(seen, 0.5, 3.0))
        units = np.round(1000.0 * np.where(seen, depth, WALL_M) + noise_mm).astype(np.uint16)
        mask = np.where(seen & (np.abs(np.degrees(around)) < INTEREST_DEG), 255, 0).astype(np.uint8)
        files = {"color": f"color/{n:03d}.jpg", "depth": f"depth/{n:03d}.png", "mask": f"mask/{n:03d}.png"}
        for kind, pixels in (("color", _painted(seen, around, down, rng)), ("depth", units), ("mask", mask)):
            assert cv2.imwrite(str(folder / files[kind]), pixels)
        listed.append({"angle_deg": angle, **files})
    header = {
        "format": "flatcloth-recording/1",
        "name": "large",
        "description": "a fluted tube, computed",
        "intrinsics": {
            "width": width, "height": height, "fx": focal, "fy": focal,
            "cx": (width - 1) / 2, "cy": (height - 1) / 2, "distortion_model": "none", "distortion": [],
        },
        "depth_scale_m": 0.001,
        "rotation_axis": {"point_m": [0.0, TOP_M, DISTANCE_M], "direction": [0.0, -1.0, 0.0]},
        "held_point_m": [0.0, TOP_M, DISTANCE_M],
        "views": listed,
    }  # fmt: skip
    (folder / "recording.json").write_text(json.dumps(header))
    return folder


def _without_axis(folder: Path) -> None:
    header = json.loads((folder / "recording.json").read_text())
    del header["rotation_axis"], header["held_point_m"]
    (folder / "recording.json").write_text(json.dumps(header))


def _painted(seen: Any, around: Any, down: Any, rng: np.random.Generator) -> Any:
    """Color (H, W, 3) B G R: every patch of 25 mm has its own."""
    cell = np.floor(around * RADIUS_M / 0.025) * 7 + np.floor(down / 0.025) * 13
    channels = [40 + 190 * np.mod(np.sin(cell * k) * 43758.5453, 1.0) for k in (12.9898, 78.233, 37.719)]
    wall = rng.normal(90.0, 4.0, (*seen.shape, 1))
    return np.clip(np.where(seen[..., None], np.stack(channels, axis=-1), wall), 0, 255).astype(np.uint8)


@njit(cache=True)
def _radius(around: float, down: float) -> float:
    """Radius of the tube; the flutes deepen downwards, and the top is drawn together."""
    share = (down - TOP_M) / (BOTTOM_M - TOP_M)
    opening = min(1.0, 0.15 + 2.5 * share)
    return opening * (RADIUS_M + FLUTE_M * share * math.cos(FLUTES * around) + 0.02 * math.cos(around))


@njit(cache=True)
def _beyond(x: float, y: float, t: float, turn: float) -> tuple[float, float]:
    """How far outside the tube the point at depth ``t`` of a ray is, and its angle about the axis."""
    side, front = x * t, DISTANCE_M - t
    around = math.atan2(side, front) - turn
    return math.hypot(side, front) - _radius(around, y * t), around


@njit(cache=True)
def _render(width: int, height: int, focal: float, turn: float) -> tuple[Any, Any, Any]:
    """Depth, angle about the axis (object frame, -pi to pi) and height of each pixel; depth 0 beside."""
    depth, around, down = np.zeros((height, width)), np.zeros((height, width)), np.zeros((height, width))
    near, far, steps = DISTANCE_M - 0.22, DISTANCE_M + 0.22, 24
    for row in range(height):
        y = (row - (height - 1) / 2) / focal
        for col in range(width):
            x = (col - (width - 1) / 2) / focal
            if abs(x) * near > 0.22:
                continue
            low = near
            for n in range(1, steps + 1):
                high = near + (far - near) * n / steps
                if TOP_M < y * high < BOTTOM_M and _beyond(x, y, high, turn)[0] < 0.0:
                    for _ in range(24):
                        middle = (low + high) / 2
                        if _beyond(x, y, middle, turn)[0] < 0.0:
                            high = middle
                        else:
                            low = middle
                    if TOP_M < y * high < BOTTOM_M:
                        depth[row, col], down[row, col] = high, y * high
                        angle = _beyond(x, y, high, turn)[1]
                        around[row, col] = (angle + math.pi) % (2 * math.pi) - math.pi
                    break
                low = high
    return depth, around, down
