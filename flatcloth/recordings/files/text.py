"""Opens and reads the files of a recording within limits, quotes them in errors, checks names in them."""

from __future__ import annotations

import contextlib
import csv
import json
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO, NoReturn
from xml.etree import ElementTree

from flatcloth.core.decoding import parse_json
from flatcloth.core.errors import RecordingError, os_errors_as
from flatcloth.core.plain_files import MOST_TEXT_BYTES, open_plain, read_plain

MOST_TABLE_BYTES = 1_000_000
"""Largest file of YAML or XML that is read. Chosen: a description of a camera is a hundredth of it."""
_MOST_NAMED = 8
"""Things that a note names. Chosen: a line."""
Fail = Callable[[str, str], NoReturn]
"""Raises ``RecordingError`` with the given cause and remedy, and the name of the file."""


def failing(where: object) -> Fail:
    """Return the function that raises ``RecordingError("<where>: <cause>. <remedy>")``."""

    def fail(cause: str, remedy: str) -> NoReturn:
        raise RecordingError(f"{where}: {cause}. {remedy}")

    return fail


@contextlib.contextmanager
def opened(path: Path, remedy: str = "Restore it, and check its permissions.") -> Iterator[BinaryIO]:
    """Open a file of a recording; raises ``RecordingError`` if it is missing, unreadable, or none."""
    with os_errors_as(RecordingError, f"{path}: cannot be read", remedy), open_plain(path) as file:
        yield file


@contextlib.contextmanager
def library_errors_as(what: str, remedy: str) -> Iterator[None]:
    """Raise what a library raises on a damaged file as ``RecordingError``: ``what`` (cause). ``remedy``."""
    try:
        yield
    except (RecordingError, MemoryError):
        raise
    except Exception as error:  # a library may raise anything
        cause = shortened(" ".join(str(error).split()), 160) or type(error).__name__
        raise RecordingError(f"{what} ({cause}). {remedy}") from error


def read_bytes(path: Path, most_bytes: int) -> bytes:
    """Return the content of a file of a recording; raises as :func:`opened`, and if it is larger."""
    remedy = "Restore it, check its permissions, or make it smaller."
    with os_errors_as(RecordingError, f"{path}: cannot be read", remedy):
        return read_plain(path, most_bytes)


def read_text(path: Path, most_bytes: int = MOST_TEXT_BYTES) -> str:
    """Return the text of a list or description in a recording.

    Raises
    ------
    RecordingError
        If it is missing, unreadable, not UTF-8, or too large.
    """
    try:
        return read_bytes(path, most_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: not UTF-8 text. Save it as UTF-8.") from error


def read_rows(path: Path) -> list[tuple[int, list[str]]]:
    """Return the cells of a table's lines, and their numbers from 1, without empty lines and comments (#).

    Cells are separated by commas, tabs or blanks; or, if all lines have one, by semicolons or tabs only. A
    comma that does not separate is a decimal comma.

    Raises
    ------
    RecordingError
        As :func:`read_text`, and if a line is not one of a table.
    """
    every = enumerate(map(str.strip, read_text(path).splitlines()), start=1)
    aside = re.compile("#|sep=.$", re.IGNORECASE)  # comments, and Excel's first line
    lines = [(n, line) for n, line in every if line and not aside.match(line)]
    shared = next((mark for mark in ";\t" if all(mark in line for _, line in lines)), "")
    marks = shared or (",\t;" if lines and "," in lines[0][1] else "\t;")
    rows = []
    for n, line in lines:
        mark = next((mark for mark in marks if mark in line), "")
        try:
            cells = next(csv.reader([line], delimiter=mark, skipinitialspace=True)) if mark else line.split()
        except csv.Error as error:
            raise RecordingError(f"{path}: line {n} is not of a table ({error}). Correct it.") from error
        cells = [cell.strip().strip('"') for cell in cells]
        rows.append((n, [re.sub(r"^([+-]?[0-9]*),([0-9]+)$", r"\1.\2", cell) for cell in cells]))
    return rows


def load_table(path: Path) -> Any:
    """Return the content of a file in JSON, or in YAML or XML as ROS and OpenCV write them, as plain objects.

    Numbers may be text: YAML 1.1 takes ``1e-05`` for it, and XML has nothing else.
    """
    kind = path.suffix.lower().removeprefix(".")

    def of_xml(text: str) -> Any:
        def plain(element: ElementTree.Element) -> Any:
            return {child.tag: plain(child) for child in element} or (element.text or "").split()

        return plain(ElementTree.fromstring(text))

    parsers = {"json": parse_json, "yaml": _of_yaml, "yml": _of_yaml, "xml": of_xml}
    if kind not in parsers:
        failing(path)(f".{kind} is not a table's file name ending", "Give .json, .yaml or .xml.")
    text = read_text(path, MOST_TEXT_BYTES if kind == "json" else MOST_TABLE_BYTES)
    with library_errors_as(f"{path}: not valid {kind.upper()}", "Correct it at this place."):
        return parsers[kind](text)


def _of_yaml(text: str) -> Any:
    import yaml

    text = re.sub(r"\A%YAML:.*", "", text)  # OpenCV's own first line, which YAML does not know
    if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, yaml.CSafeLoader)):
        raise ValueError("it refers to itself by *")  # a few lines can stand for gigabytes

    loader: Any = type("Loader", (yaml.CSafeLoader,), {})

    def untagged(loading: Any, _tag: str, node: Any) -> Any:
        return getattr(loading, f"construct_{node.id}")(node)

    loader.add_multi_constructor("", untagged)  # tags that YAML does not know, as of OpenCV's matrices
    return next(yaml.load_all(text, loader), None)  # messages of ROS's echo follow each other


def inside(folder: Path, name: Any, listed_in: Path, where: str) -> Path:
    """Return the path of a named file in a folder.

    Parameters
    ----------
    folder : Path
        The folder, resolved.
    name : object
        The name as it stands in the file ``listed_in`` at the place ``where``.

    Raises
    ------
    RecordingError
        If it is not a file name, or leads outside the folder, also through links.
    """
    text = shortened(name)
    fail = failing(listed_in)
    if not isinstance(name, str) or not name:
        fail(f"{where} is {text}", "Give the name of an image file in the folder.")
    if len(name) > 1024 or re.search("[\x00-\x1f\x7f-\x9f\ud800-\udfff]", name):
        fail(f"{where} is {text}", "Use printable characters only.")
    relative = PurePosixPath(name)
    outside = relative.is_absolute() or ".." in relative.parts or re.match(r"[A-Za-z]:", name)
    if outside or "\\" in name:
        fail(f"{where} is {text}", "Use a relative path with forward slashes, inside the folder.")
    path = folder / relative
    try:
        resolved = path.resolve()
    except (OSError, RuntimeError):  # a loop of links
        fail(f"{where} {text} cannot be followed", "Replace the link by the file.")
    if not resolved.is_relative_to(folder):
        fail(f"{where} {text} leads outside the folder", "Copy the file into the folder.")
    return path


def shortened(value: Any, limit: int = 60) -> str:
    """Return a value as one printable line of at most ``limit`` characters."""
    text = value if isinstance(value, str) else json.dumps(value, default=str)
    text = json.dumps(text)[1:-1] if not text.isprintable() else text
    return text if len(text) <= limit else text[: limit - 3] + "..."


def unused(path: object, places: Sequence[str]) -> list[str]:
    """Return a note that names what a file says and nothing understands; an empty list if that is nothing."""
    more = f" and {len(places) - _MOST_NAMED} more" if len(places) > _MOST_NAMED else ""
    named = ", ".join(shortened(place) for place in places[:_MOST_NAMED])
    return [f"{path}: not understood, and not used: {named}{more}."] if places else []


def one_line(text: str) -> str:
    """Return a title as one line, without control characters."""
    return "".join(c for c in " ".join(text.split()) if c.isprintable())[:500]
