"""RealSense recordings written without a camera: pyrealsense2's software device and a computed scene."""

import contextlib
import math
import sqlite3
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scenes import CAMERA, Cylinder

from flatcloth.core.types import Uint8
from flatcloth.recordings.files.libraries import load_realsense

WIDTH, HEIGHT = CAMERA.width, CAMERA.height
WALL_M = 1.5


@dataclass(frozen=True)
class Shot:
    """What both sensors see at a time; None where a sensor has no frame."""

    time_s: float
    color: Uint8 | None
    depth_mm: np.ndarray | None


@lru_cache(maxsize=64)
def _seen(angle_deg: float) -> tuple[np.ndarray, np.ndarray]:
    frame = Cylinder(angles_deg=(angle_deg,))[0]
    cloth = frame.depth_m > 0
    rows, cols = np.mgrid[0:HEIGHT, 0:WIDTH]
    wall = (90 + 30 * np.sin(rows / 9.0) * np.cos(cols / 11.0)).astype(np.uint8)
    color = np.where(cloth[..., None], frame.color, wall[..., None])
    depth = np.where(cloth, np.round(frame.depth_m * 1000), WALL_M * 1000)
    return color, depth


def shot(time_s: float, angle_deg: float, noise: np.random.Generator | None = None) -> Shot:
    """The cylinder of ``scenes`` before a wall, turned, with the noise of a sensor."""
    color, depth = _seen(round(angle_deg, 3))
    if noise is not None:
        depth = depth + noise.normal(0, 2.0, depth.shape) * (depth / 1000.0) ** 2
        depth[noise.random(depth.shape) < 0.01] = 0
        color = color + noise.normal(0, 2.0, (HEIGHT, WIDTH, 1))
    return Shot(
        time_s,
        np.clip(np.round(color), 0, 255).astype(np.uint8),
        np.clip(np.round(depth), 0, 65535).astype(np.uint16),
    )


def stop_and_go(stops: int, step_deg: float, still_s: float, turn_s: float) -> Callable[[float], float]:
    """The angle over time of an item that is turned, swings a little, hangs still, and is turned again."""
    period = still_s + turn_s

    def angle_deg(time_s: float) -> float:
        k = min(int(time_s / period), stops - 1)
        into = time_s - k * period - still_s
        if into < 0 or k == stops - 1:
            return k * step_deg
        share = min(into / (0.6 * turn_s), 1.0)
        swing = 0.0
        if share == 1.0:
            late = into - 0.6 * turn_s
            swing = 2.0 * math.exp(-late / (0.12 * turn_s)) * math.sin(late * 40)
        return k * step_deg + step_deg * (0.5 - 0.5 * math.cos(math.pi * share)) + swing

    return angle_deg


def turning(
    angle_deg: Callable[[float], float], seconds: float, fps: float = 15.0, seed: int | None = 1
) -> list[Shot]:
    noise = None if seed is None else np.random.default_rng(seed)
    return [shot(k / fps, angle_deg(k / fps), noise) for k in range(round(seconds * fps))]


def write_realsense(path: Path, shots: Iterable[Shot], **options: Any) -> Path:
    """Write a .db3 file of all shots through librealsense's own recorder; options as in ``_record``.

    On a busy machine the recorder drops frames: such a film is recorded again.
    """
    shots = list(shots)
    for _ in range(6):
        path.unlink(missing_ok=True)
        sent = _record(path, shots, **options)
        if _frames_in(path) == sent:
            return path
    raise AssertionError(f"{path}: librealsense drops frames every time")


def _frames_in(path: Path) -> int:
    with contextlib.closing(sqlite3.connect(path)) as base:
        counted = base.execute(
            "SELECT count(*) FROM messages JOIN topics ON topics.id = topic_id"
            " WHERE name LIKE '%/image/data/%'"
        )
        return int(counted.fetchone()[0])


def _send(sensor: Any, profile: Any, pixels: np.ndarray, bpp: int, at_s: float, number: int) -> None:
    """Give a sensor one frame."""
    rs = load_realsense()
    frame = rs.software_video_frame()
    frame.pixels = np.ascontiguousarray(pixels)
    frame.stride, frame.bpp = WIDTH * bpp, bpp
    frame.timestamp, frame.domain = 1000.0 * at_s, rs.timestamp_domain.hardware_clock
    frame.frame_number, frame.profile = number, profile.as_video_stream_profile()
    if bpp == 2:
        frame.depth_units = 0.001
    sensor.on_video_frame(frame)


def _record(
    path: Path,
    shots: Iterable[Shot],
    *,
    fps: float = 15.0,
    color_late_s: float = 0.005,
    with_color: bool = True,
    with_depth: bool = True,
    stereo: bool = True,
    color_right_m: float = 0.0,
    on_frame: Callable[[int], None] = lambda _n: None,
) -> int:
    """Record once; return how many frames were sent."""
    rs = load_realsense()
    device = rs.software_device()

    def stream(kind: object, uid: int, form: object, bpp: int) -> object:
        intrinsics = rs.intrinsics()
        intrinsics.width, intrinsics.height = WIDTH, HEIGHT
        intrinsics.fx, intrinsics.fy, intrinsics.ppx, intrinsics.ppy = (
            CAMERA.fx,
            CAMERA.fy,
            CAMERA.cx,
            CAMERA.cy,
        )
        intrinsics.model, intrinsics.coeffs = rs.distortion.none, [0.0] * 5
        made = rs.video_stream()
        made.type, made.index, made.uid, made.fmt, made.bpp = kind, 0, uid, form, bpp
        made.width, made.height, made.fps, made.intrinsics = WIDTH, HEIGHT, int(fps), intrinsics
        return made

    sensors = []
    if with_depth:
        depth_sensor = device.add_sensor("Stereo Module")
        depth_profile = depth_sensor.add_video_stream(stream(rs.stream.depth, 0, rs.format.z16, 2), True)
        depth_sensor.add_read_only_option(rs.option.depth_units, 0.001)
        if stereo:
            depth_sensor.add_read_only_option(rs.option.stereo_baseline, 50.0)  # mm, as in a D435
        sensors.append((depth_sensor, depth_profile))
    if with_color:
        color_sensor = device.add_sensor("RGB Camera")
        color_profile = color_sensor.add_video_stream(stream(rs.stream.color, 1, rs.format.rgb8, 3), True)
        sensors.append((color_sensor, color_profile))
    if with_depth and with_color:
        apart = rs.extrinsics()
        apart.rotation, apart.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [-color_right_m, 0.0, 0.0]
        depth_profile.register_extrinsics_to(color_profile, apart)
    device.create_matcher(rs.matchers.dlr_c)
    recorder = rs.recorder(str(path), device)
    queues = [rs.frame_queue(50) for _ in sensors]
    for (sensor, profile), queue in zip(sensors, queues, strict=True):
        sensor.open(profile)
        sensor.start(queue)
    time.sleep(0.05)  # what comes before the recorder's thread is up is lost

    sent = 0
    for number, seen in enumerate(shots):
        if with_depth and seen.depth_mm is not None:
            sent += 1
            _send(depth_sensor, depth_profile, seen.depth_mm, 2, 1.0 + seen.time_s, number)
        if with_color and seen.color is not None:
            sent += 1
            _send(color_sensor, color_profile, seen.color, 3, 1.0 + seen.time_s + color_late_s, number)
        time.sleep(0.003)  # the recorder drops what it cannot write in time
        on_frame(number)
    time.sleep(0.1)
    for sensor, _ in sensors:
        sensor.stop()
        sensor.close()
    recorder.pause()
    del recorder
    return sent
