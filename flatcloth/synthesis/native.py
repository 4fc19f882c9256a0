"""Loads Open3D on first use, with libusb if the system lacks it."""

from __future__ import annotations

import ctypes
from typing import Any

from flatcloth.synthesis.errors import SynthesisError


def load_open3d() -> Any:
    """Return the module ``open3d``.

    Raises
    ------
    SynthesisError
        If it is not installed, or a library it needs is missing.
    """
    try:
        try:
            ctypes.CDLL("libusb-1.0.so.0")
        except OSError:
            import libusb_package

            # Open3D links to it by name, so it must be loaded before Open3D.
            ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
        import open3d
    except (ImportError, OSError) as error:
        raise SynthesisError(
            f"Rendering needs Open3D, which cannot be loaded ({error}). "
            "Run: pip install open3d libusb-package, and install the system library named here."
        ) from error
    return open3d
