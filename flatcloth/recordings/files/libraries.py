"""Libraries that are loaded on first use, and what they say of damaged files."""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from flatcloth.core.errors import FlatclothError, RecordingError
from flatcloth.recordings.files.text import library_errors_as


def load_with_libusb(name: str, kind: type[FlatclothError], need: str, packages: str) -> Any:
    """Return the module ``pyrealsense2`` or ``open3d``.

    Raises
    ------
    kind
        If it is not installed, or its libraries are missing: what ``need`` says, and the ``packages``.

    Notes
    -----
    Both link to ``libusb-1.0.so.0``, which a minimal Debian lacks. The system's, or that of the package
    libusb-package, is loaded first, with symbols that they see.
    """
    try:
        try:
            ctypes.CDLL("libusb-1.0.so.0", mode=ctypes.RTLD_GLOBAL)
        except OSError:
            with contextlib.suppress(ImportError):
                import libusb_package

                ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        raise kind(f"{need}, which is not installed. Run: pip install {packages}") from error
    except (ImportError, OSError) as error:  # the text names what a library of the system is missing
        raise kind(f"{need}, which cannot be loaded ({error}). Install what it misses.") from error


def load_realsense() -> Any:
    """Return the module ``pyrealsense2``; raises ``RecordingError`` if it cannot be loaded."""
    need = "RealSense files and cameras need pyrealsense2"
    return load_with_libusb("pyrealsense2", RecordingError, need, "pyrealsense2 libusb-package")


_silencing = threading.RLock()
"""Two threads would keep each other's silence for the standard error."""


@contextlib.contextmanager
def damage_told(path: Path) -> Iterator[None]:
    """Raise what a library raises on a damaged file as ``RecordingError``; what it prints is lost.

    Nothing else is on standard error then, also of other threads.
    """
    with _silencing:
        kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, 2)
            with library_errors_as(f"{path}: truncated or damaged", "Copy or export the image again."):
                yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            os.close(nowhere)
