"""Writes views of a capture without end and says how many are on disk, until it is killed."""

import sys
from pathlib import Path

import numpy as np

from flatcloth.core.types import Intrinsics
from flatcloth.recordings.writer import RecordingWriter

CAMERA = Intrinsics(width=64, height=48, fx=60.0, fy=60.0, cx=31.5, cy=23.5)
STEP_DEG = 0.05


def pixels(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return color (48, 64, 3) and depth (48, 64) of a view; the same for the same number."""
    rng = np.random.default_rng(n)
    color = rng.integers(0, 256, (48, 64, 3), dtype=np.uint8)
    return color, rng.integers(500, 900, (48, 64), dtype=np.uint16)


def main(folder: Path) -> None:
    """Go on with a capture until killed; each line on standard output is a number of views on disk."""
    with RecordingWriter(
        folder, name="killed", intrinsics=CAMERA, depth_scale_m=0.001, resume=True
    ) as writer:
        for n in range(len(writer), 7000):
            writer.add(STEP_DEG * n, *pixels(n))
            sys.stdout.write(f"{len(writer)}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
