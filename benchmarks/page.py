"""The page as an operator meets it: how long until it answers, shows something, answers a click."""

from __future__ import annotations

import json
import re
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from typing import Any

from websockets.sync.client import ClientConnection, connect

from benchmarks.output import Options

CLICKS = 30
STARTS = 5


def run(_options: Options) -> None:
    """Start the program several times on a bundled recording and print the medians."""
    found = [_one_start("shirt-sleeve-clean") for _ in range(STARTS)]
    for key, text in (
        ("address_s", "process start to address printed, s"),
        ("served_s", "process start to page served, s"),
        ("first_view_s", "page served to first flattened layer received, s"),
        ("click_ms", f"click answered with its 3D point (median of {CLICKS}), ms"),
        ("slowest_click_ms", "slowest click, ms"),
    ):
        print(f"{text:<58}{statistics.median(one[key] for one in found):8.3f}")


def _one_start(recording: str) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, "app.py", "view", recording, "--port", "0", "--session", f"{folder}/session"],
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            assert process.stdout is not None
            said = re.search(r"(http://[^\s/]+)/\?token=(\S+)", process.stdout.readline())
            assert said is not None
            url, address_s = said[1], time.perf_counter() - started
            token = {"Authorization": f"Bearer {said[2]}"}
            with urllib.request.urlopen(urllib.request.Request(url + "/", headers=token)) as page:
                page.read()
            served_s = time.perf_counter() - started
            with connect(
                url.replace("http", "ws") + "/ws",
                origin=url,  # type: ignore[arg-type]
                max_size=None,
                additional_headers=token,
            ) as socket:
                state = _until(socket, lambda m: m["type"] == "state" and bool(m.get("layers")))
                layers = state["layers"]
                address = f"{url}/layers/{layers['revision']}/{layers['names'][0]}.png"
                with urllib.request.urlopen(urllib.request.Request(address, headers=token)) as image:
                    image.read()
                first_view_s = time.perf_counter() - started - served_s
                clicks = [_click(socket, n) for n in range(CLICKS)]
        finally:
            process.terminate()
            process.wait()
    return {
        "address_s": address_s,
        "served_s": served_s,
        "first_view_s": first_view_s,
        "click_ms": statistics.median(clicks),
        "slowest_click_ms": max(clicks),
    }


def _click(socket: ClientConnection, n: int) -> float:
    started = time.perf_counter()
    socket.send(json.dumps({"type": "pick", "u_m": 0.3 + 0.001 * n, "v_m": 0.5}))
    _until(socket, lambda m: m["type"] == "state" and len(m["picks"]) == n + 1)
    return 1e3 * (time.perf_counter() - started)


def _until(socket: ClientConnection, found: Any) -> dict[str, Any]:
    while True:
        message: dict[str, Any] = json.loads(socket.recv(timeout=60))
        if found(message):
            return message
