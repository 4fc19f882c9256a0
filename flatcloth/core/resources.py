"""Locations of the files that come with the code: the operator page and the sample recordings.

An installed package contains them; in a checkout they are next to the package.
"""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]
"""The package's own folder."""


def static_folder() -> Path:
    """Return the folder with the operator page (HTML, CSS, ES modules)."""
    return _first_existing(_PACKAGE / "static", _PACKAGE.parent / "static")


def sample_recordings() -> dict[str, Path]:
    """Return the bundled recordings: name to folder, in alphabetical order."""
    root = _first_existing(_PACKAGE / "samples", _PACKAGE.parent / "recordings")
    return {header.parent.name: header.parent for header in sorted(root.glob("*/recording.json"))}


def sample_mesh() -> Path:
    """Return the bundled mesh of a hanging T-shirt, for the simulated cell."""
    return _first_existing(_PACKAGE / "samples", _PACKAGE.parent / "recordings") / "tshirt-corner.obj.gz"


def _first_existing(installed: Path, checkout: Path) -> Path:
    # The installed place is checked first, because an installed package lies next to other packages.
    return installed if installed.is_dir() else checkout
