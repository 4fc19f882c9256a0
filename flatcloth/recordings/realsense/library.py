"""Loads pyrealsense2 on first use, with libusb if the system lacks it."""

from __future__ import annotations

from typing import Any

from flatcloth.core.errors import RecordingError
from flatcloth.recordings.realsense.libusb import load_libusb


def load_realsense() -> Any:
    """Return the module ``pyrealsense2``.

    Raises
    ------
    RecordingError
        If it is not installed, or its libraries are missing.

    Notes
    -----
    pyrealsense2 links to ``libusb-1.0.so.0``, which a minimal Debian lacks; the library of the
    package libusb-package is then loaded first.
    """
    try:
        try:
            import pyrealsense2
        except ImportError:
            load_libusb()
            import pyrealsense2
    except (ImportError, OSError) as error:
        raise RecordingError(
            f"RealSense files and cameras need pyrealsense2, which cannot be loaded ({error}). "
            "Run: pip install pyrealsense2 libusb-package"
        ) from error
    return pyrealsense2
