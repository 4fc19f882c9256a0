"""Compile the numerical kernels in advance, so that the first start is as fast as later ones.

``python -m flatcloth.engine.warmup`` runs the whole method on two small synthetic views; numba caches
the compiled code beside the sources. Where that was not done, the page opens all the same: a second process
compiles (:func:`compile_beside`), and progress texts say so (:func:`is_compiled`).
"""

from __future__ import annotations

import atexit
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from flatcloth.core.types import Float64, Intrinsics, RgbdFrame, RotationAxis
from flatcloth.engine.integration import Integration
from flatcloth.flattening.sampling import path_on_surface
from flatcloth.methods.robust.compositing import _composite
from flatcloth.session.machine import Accept, Propose, SessionState, Start, apply


class TurnedCylinder:
    """A recording of a checkered half cylinder with two views, as small as the method allows."""

    name = "cylinder"
    description = "checkered half cylinder, computed"
    location = "computed"
    has_masks = True
    angles_deg = (0.0, 20.0)
    intrinsics = Intrinsics(width=160, height=160, fx=250.0, fy=250.0, cx=79.5, cy=79.5)
    rotation_axis = RotationAxis(point_m=np.array([0.0, 0.0, 0.8]), direction=np.array([0.0, -1.0, 0.0]))
    held_point_m: Float64 = np.array([0.0, -0.2, 0.8])

    def __len__(self) -> int:
        """Return 2."""
        return len(self.angles_deg)

    def __getitem__(self, view_index: int) -> RgbdFrame:
        """Render one view of a cylinder of radius 0.12 m about the axis by ray casting."""
        k, radius = self.intrinsics, 0.12
        y, x = (np.mgrid[0 : k.height, 0 : k.width] - np.array([k.cy, k.cx])[:, None, None]) / k.fx
        a, b = 1.0 + x * x, 0.8
        root = np.sqrt(np.maximum(b * b - a * (b * b - radius * radius), 0.0))
        depth = np.where(root > 0, (b - root) / a, 0.0)
        around = np.degrees(np.arctan2(x * depth, 0.8 - depth)) - self.angles_deg[view_index]
        mask = (root > 0) & (np.abs(around) < 80.0) & (np.abs(y * depth) < 0.15)
        squares = np.floor(around / 12.0) + np.floor(y * depth / 0.025)
        color = np.where((squares % 2 == 0)[..., None], 220, 40) * np.ones(3)
        return RgbdFrame(
            view_index=view_index,
            angle_deg=self.angles_deg[view_index],
            color=color.astype(np.uint8),
            depth_m=np.where(mask, depth, 0.0).astype(np.float32),
            mask=mask,
            intrinsics=k,
        )


def warm_up() -> None:
    """Integrate the cylinder once."""
    integration = Integration(TurnedCylinder())
    state = apply(SessionState(2), Start())
    for command in (None, Propose(1)):
        if command is not None:
            state = apply(state, command)
        if state.request is not None:
            state = apply(state, integration.answer(state.document, state.request))
    state = apply(state, Accept(1))
    integration.canonical(state.document)


def is_compiled() -> bool:
    """Return whether an early and the last kernel of an integration are compiled and kept on disk."""
    return all(_is_kept(kernel) for kernel in (path_on_surface, _composite))


def _is_kept(kernel: Any) -> bool:
    source = Path(kernel.py_func.__code__.co_filename)
    kept = Path(kernel.stats.cache_path).glob(f"{source.stem}.{kernel.py_func.__qualname__}-*.nbi")
    changed_s = source.stat().st_mtime
    return any(index.stat().st_mtime >= changed_s for index in kept)


def compile_beside() -> subprocess.Popen[bytes] | None:
    """Compile all kernels in a process of its own, if they are not compiled yet; it ends with this one.

    What it has compiled this process reads from disk, and the other way round: the first view is flattened
    here while the other process goes on to the kernels of placing and merging.
    """
    if is_compiled():
        return None
    # In a session of its own it does not hear Ctrl-C, and is ended here.
    process = subprocess.Popen(
        [sys.executable, "-m", __name__],
        cwd=Path(__file__).parents[2],  # a checkout need not be installed
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    atexit.register(process.terminate)
    return process


if __name__ == "__main__":
    warm_up()
