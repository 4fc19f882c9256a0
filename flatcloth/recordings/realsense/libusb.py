"""The USB library that RealSense's and Open3D's modules link to, and that minimal systems lack."""

from __future__ import annotations

import ctypes


def load_libusb() -> None:
    """Load ``libusb-1.0.so.0``: the system's, or that of the package libusb-package.

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
