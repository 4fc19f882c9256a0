"""Joins the page's ES modules into one script, so that a page can be a single file.

Each module becomes a function that returns its exports; its imports are read from the results of other
functions. The modules of ``static/`` use only the few forms of ``import`` and ``export`` that are
supported here; any other form is an error, not a broken page.
"""

from __future__ import annotations

import re
from pathlib import Path

from flatcloth.core.errors import FlatclothError

_IMPORT = re.compile(r'^import \{\s*([^}]*?)\s*\} from "/static/([\w/-]+\.js)";[ \t]*$', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?function\*?|class|const|let) ([\w$]+)", re.MULTILINE)
_LEFT_OVER = re.compile(r"^\s*(?:import|export)\b(?!\()", re.MULTILINE)


class BundleError(FlatclothError):
    """The page's scripts cannot be joined; the message names the script and the unsupported form."""


def bundle(folder: Path, entry: str) -> str:
    """Return one script equivalent to the module ``entry`` of a folder.

    Raises
    ------
    BundleError
        If a module is missing, is part of an import cycle, or uses an unsupported form.
    """
    made: dict[str, str] = {}
    _add(folder, entry, made, ())
    return "\n".join(made.values())


def _add(folder: Path, name: str, made: dict[str, str], above: tuple[str, ...]) -> None:
    if name in made:
        return
    if name in above:
        raise BundleError(f"{folder / name}: imports itself by way of {' and '.join(above)}.")
    try:
        source = (folder / name).read_text(encoding="utf-8")
    except OSError as error:
        raise BundleError(
            f"{folder / name}: cannot be read ({error.strerror}). Reinstall flatcloth."
        ) from error
    for found in _IMPORT.finditer(source):
        _add(folder, found[2], made, (*above, name))
    body = _IMPORT.sub(lambda m: f"const {{ {_renamed(m[1])} }} = {_variable(m[2])};", source)
    exported = [found[2] for found in _EXPORT.finditer(body)]
    body = _EXPORT.sub(r"\1 \2", body)
    if left := _LEFT_OVER.search(body):
        line = body[left.start() :].lstrip().splitlines()[0]
        raise BundleError(f"{folder / name}: {line[:60]!r} is an unsupported form of import or export.")
    # Only the entry may use await at top level, so it is not wrapped in a function.
    if above:
        body = f"const {_variable(name)} = (() => {{\n{body}\nreturn {{ {', '.join(exported)} }};\n}})();"
    else:
        body = f"{{\n{body}\n}}"
    made[name] = body


def _variable(name: str) -> str:
    return "module_" + re.sub(r"\W", "_", name.removesuffix(".js"))


def _renamed(names: str) -> str:
    """Convert the names of an import to those of a destructuring: ``a as b`` becomes ``a: b``."""
    return ", ".join(re.sub(r"\s+as\s+", ": ", name.strip()) for name in names.split(",") if name.strip())
