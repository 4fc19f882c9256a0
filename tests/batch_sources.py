"""Recordings for batches, as small as a real integration allows, and a format that misbehaves."""

from pathlib import Path

from exported_sessions import write_cylinder

MISBEHAVING = """
import ctypes, os, time
from pathlib import Path
from flatcloth.recordings.base import Format


def opened(path, options):
    what = path.stem
    if what == "crash":
        ctypes.string_at(0)
    if what == "kill":
        os.kill(os.getpid(), 9)
    if what == "hang":
        time.sleep(600)
    if what == "memory":
        kept = [bytearray(10**8) for _ in range(100)]
    raise ZeroDivisionError("a bug")


FORMAT = Format(
    name="misbehaving", what="a misbehaving file", recognises=lambda path: path.suffix == ".bad", open=opened
)
"""


def write_cylinders(folder: Path, names: str) -> Path:
    """Write a recording of four views for each letter."""
    for name in names:
        write_cylinder(folder / name, name)
    return folder


def add_misbehaving_format(folder: Path) -> Path:
    """Write a package with the format to a folder, which is then to be put on the path."""
    (folder / "misbehaving.py").write_text(MISBEHAVING)
    about = folder / "misbehaving-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: misbehaving\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[flatcloth.recordings]\nmisbehaving = misbehaving:FORMAT\n")
    return folder
