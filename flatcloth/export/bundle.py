"""Joins the page's ES modules into one script, so that a page can be a single file.

Each module becomes a function that returns what it exports; its imports become reads of what the
others returned. The modules of ``static/`` keep to the few forms of ``import`` and ``export`` that
are understood here; anything else is an error, not a broken page.
"""

from __future__ import annotations

import re
from pathlib import Path

from flatcloth.core.errors import FlatclothError

_IMPORT = re.compile(r'^import \{\s*([^}]*?)\s*\} from "/static/([\w/-]+\.js)";[ \t]*$', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?function\*?|class|const|let) ([\w$]+)", re.MULTILINE)
_LEFT_OVER = re.compile(r"^\s*(?:import|export)\b(?!\()", re.MULTILINE)


class BundleError(FlatclothError):
    """The page's own scripts cannot be joined; names the script and what is not understood."""


def bundle(folder: Path, entry: str) -> str:
    """Return one script that does what the module ``entry`` of a folder does.

    Raises
    ------
    BundleError
        If a module is missing, imports in a circle, or uses a form that is not understood.
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
            f"{folder / name}: cannot be read ({error.strerror}). Install flatcloth anew."
        ) from error
    for found in _IMPORT.finditer(source):
        _add(folder, found[2], made, (*above, name))
    body = _IMPORT.sub(lambda m: f"const {{ {_renamed(m[1])} }} = {_variable(m[2])};", source)
    exported = [found[2] for found in _EXPORT.finditer(body)]
    body = _EXPORT.sub(r"\1 \2", body)
    if left := _LEFT_OVER.search(body):
        line = body[left.start() :].lstrip().splitlines()[0]
        raise BundleError(f"{folder / name}: {line[:60]!r} is a form of import or export that is not joined.")
    # An entry may wait for something: only the module around it may, so it is no function.
    if above:
        body = f"const {_variable(name)} = (() => {{\n{body}\nreturn {{ {', '.join(exported)} }};\n}})();"
    else:
        body = f"{{\n{body}\n}}"
    made[name] = body


def _variable(name: str) -> str:
    return "module_" + re.sub(r"\W", "_", name.removesuffix(".js"))


def _renamed(names: str) -> str:
    """Return the names of an import as those of a destructuring: ``a as b`` becomes ``a: b``."""
    return ", ".join(re.sub(r"\s+as\s+", ": ", name.strip()) for name in names.split(",") if name.strip())
