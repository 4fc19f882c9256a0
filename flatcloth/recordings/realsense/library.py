"""Loads pyrealsense2 on first use, with libusb if the system lacks it."""

from __future__ import annotations

import ctypes
from typing import Any

from flatcloth.core.errors import RecordingError


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


def load_libusb() -> None:
    """Load ``libusb-1.0.so.0``, to which RealSense's and Open3D's modules link: the system's, or a package's.

    The symbols are visible to the extension modules that are loaded next.

    Raises
    ------
    ImportError, OSError
        If there is neither.
    """
    try:
        ctypes.CDLL("libusb-1.0.so.0", mode=ctypes.RTLD_GLOBAL)
    except OSError:
        import libusb_package

        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
