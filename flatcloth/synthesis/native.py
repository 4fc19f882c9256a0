"""Loads Open3D on first use, with libusb if the system lacks it."""

from __future__ import annotations

from typing import Any

from flatcloth.core.libusb import load_libusb
from flatcloth.synthesis.errors import SynthesisError


def load_open3d() -> Any:
    """Return the module ``open3d``.

    Raises
    ------
    SynthesisError
        If it is not installed, or a library it needs is missing.
    """
    try:
        load_libusb()  # Open3D links to it by name
        import open3d
    except (ImportError, OSError) as error:
        raise SynthesisError(
            f"Rendering needs Open3D, which cannot be loaded ({error}). "
            "Run: pip install open3d libusb-package, and install the system library named here."
        ) from error
    return open3d
