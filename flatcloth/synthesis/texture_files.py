"""Files that a mesh names: found in its folder only, and read as textures."""

from __future__ import annotations

import re
import struct
import unicodedata
import warnings
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from flatcloth.core.errors import SynthesisError, os_errors_as
from flatcloth.core.plain_files import open_plain
from flatcloth.core.types import Uint8
from flatcloth.recordings.files.text import shortened

MOST_TEXTURE_PIXELS = 8192**2
"""Largest texture. Chosen: 200 MB of memory."""


def file_beside(folder: Path, name: str) -> Path | None:
    """Return the file in a folder that a name in a mesh means; None if there is none.

    The case of letters does not matter. Of a path that is not there, as one of another computer, the last
    part is looked for. A file outside the folder is never returned.
    """
    for spelled in (name, unquote(name)):
        parts = [part for part in re.split(r"[/\\]+", spelled.strip().strip('"')) if part not in ("", ".")]
        for tail in (parts, parts[-1:]):
            found: Path | None = folder
            for part in tail:
                found = None if found is None or part == ".." else _entry(found, part)
            if found is not None and found.is_file() and found.resolve().is_relative_to(folder.resolve()):
                return found
    return None


def _entry(folder: Path, name: str) -> Path | None:
    wanted = unicodedata.normalize("NFC", name).casefold()
    try:
        every = sorted(folder.iterdir(), key=lambda path: (path.name != name, path.name))
    except OSError:  # not a folder
        return None
    return next((p for p in every if unicodedata.normalize("NFC", p.name).casefold() == wanted), None)


def read_texture(mesh: Path, name: str, library: Path | None = None) -> Uint8:
    """Return the pixels (H, W, 3) RGB of a texture that a mesh, or a library of it, names.

    Raises
    ------
    SynthesisError
        If it is missing, not readable, or larger than ``MOST_TEXTURE_PIXELS``.
    """
    path = file_beside((library or mesh).parent, name) or file_beside(mesh.parent, name)
    if path is None:
        stem = re.split(r"[/\\]+", name)[-1].rpartition(".")[0].casefold()
        others = sorted(p.name for p in mesh.parent.iterdir() if p.stem.casefold() == stem and p != mesh)
        there = f" (there is {shortened(others[0])})" if others else ""
        raise SynthesisError(
            f"{mesh}: its texture {shortened(name)} is not a file inside its folder{there}. "
            "Copy it there under this name, or choose a generated pattern with --texture."
        )
    with (
        os_errors_as(SynthesisError, f"{path}: cannot be read", "Check its permissions."),
        open_plain(path) as file,
    ):
        return rgb_of(file, path)


def rgb_of(source: Any, named: object) -> Uint8:
    """Return the pixels (H, W, 3) RGB of an open image file, or of an image of Pillow; ``named`` in messages.

    Raises
    ------
    SynthesisError
        If it is not readable, or larger than ``MOST_TEXTURE_PIXELS``.
    """
    from PIL import Image

    remedy = "Correct this texture, or choose a generated pattern with --texture."
    try:
        with warnings.catch_warnings(action="ignore"):
            image = source if isinstance(source, Image.Image) else Image.open(source)
        if image.width * image.height > MOST_TEXTURE_PIXELS:
            raise SynthesisError(f"{named}: {image.width}x{image.height} px are too many. {remedy}")
        return np.asarray(image.convert("RGB"))
    except (OSError, ValueError, SyntaxError, struct.error, Image.DecompressionBombError) as error:
        raise SynthesisError(f"{named}: not a readable image. {remedy}") from error
