"""Libraries that are loaded on first use, or run in a worker process because files may harm them."""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import importlib.util
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flatcloth.core.errors import RecordingError
from flatcloth.core.subprocess_worker import Message, Worker, WorkerLostError, reader_errors_as


def load_with_libusb(name: str) -> Any:
    """Return the module ``pyrealsense2`` or ``open3d``.

    Raises
    ------
    ImportError, OSError
        If it is not installed, or its libraries are missing.

    Notes
    -----
    Both link to ``libusb-1.0.so.0``, which a minimal Debian lacks. The system's, or that of the package
    libusb-package, is loaded first, with symbols that they see.
    """
    try:
        ctypes.CDLL("libusb-1.0.so.0", mode=ctypes.RTLD_GLOBAL)
    except OSError:
        with contextlib.suppress(ImportError):
            import libusb_package

            ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    return importlib.import_module(name)


def load_realsense() -> Any:
    """Return the module ``pyrealsense2``.

    Raises
    ------
    RecordingError
        If it is not installed, or its libraries are missing.
    """
    try:
        return load_with_libusb("pyrealsense2")
    except (ImportError, OSError) as error:
        raise RecordingError(
            f"RealSense files and cameras need pyrealsense2, which cannot be loaded ({error}). "
            "Run: pip install pyrealsense2 libusb-package"
        ) from error


class KeptWorker:
    """A worker process that reads image files, started for the first one and kept for the next ones.

    Parameters
    ----------
    module : str
        The module whose ``main`` it runs.
    library : str
        The library that it needs.
    packages : str
        What pip installs it as.
    """

    def __init__(self, module: str, library: str, packages: str) -> None:
        self._module, self._library, self._packages = module, library, packages
        self._lock = threading.Lock()
        self._worker: Worker | None = None

    def ask(self, question: Mapping[str, Any], path: Path) -> Message:
        """Return the answer to a question about a file."""
        try:
            known = importlib.util.find_spec(self._library) is not None
        except ValueError:
            known = False
        if not known:
            raise RecordingError(
                f"{path}: the library {self._library}, which reads it, is missing. "
                f"Run: pip install {self._packages}"
            )
        remedy = "Copy or export the image again."
        with self._lock, reader_errors_as(RecordingError, path, "truncated or damaged", remedy):
            self._worker = self._worker or Worker(self._module, path)
            try:
                return self._worker.ask({"path": str(path), **question})
            except WorkerLostError:
                self._worker = None
                raise
