"""The messages of the page as TypeScript, to check the page's modules against them.

``python -m flatcloth.viewer.protocol.typescript`` writes ``static/page/messages.d.ts``; a test compares the
two. The page itself needs no TypeScript: only ``make lint`` reads the file.
"""

from __future__ import annotations

import json

from msgspec import NODEFAULT, inspect

from flatcloth.core.resources import static_folder
from flatcloth.viewer.protocol.messages import KINDS

_SCALARS: dict[type, str] = {
    inspect.IntType: "number",
    inspect.FloatType: "number",
    inspect.StrType: "string",
    inspect.BoolType: "boolean",
    inspect.NoneType: "null",
}


def declarations() -> str:
    """Return one interface per message, and the union of all, as the text of a ``.d.ts`` file."""
    kinds = [_interface(kind) for kind in KINDS.values()]
    names = " | ".join(kind.__name__ for kind in KINDS.values())
    return "\n".join(
        [
            "// Made by flatcloth/viewer/protocol/typescript.py from messages.py; not to be edited.",
            "",
            *kinds,
            "/** All that the page may say to the server. */",
            f"export type ClientMessage = {names};".replace(" | ", "\n  | "),
            "",
        ]
    )


def _interface(kind: type) -> str:
    about = inspect.type_info(kind)
    assert isinstance(about, inspect.StructType)
    summary = (kind.__doc__ or "").strip().splitlines()[0]
    rows = [f"/** {summary} */", f"export interface {kind.__name__} {{", f"  type: {json.dumps(about.tag)};"]
    for field in about.fields:
        optional = "" if field.default is NODEFAULT and field.default_factory is NODEFAULT else "?"
        rows.append(f"  {field.encode_name}{optional}: {_type(field.type)};")
    return "\n".join([*rows, "}", ""])


def _type(about: inspect.Type) -> str:
    if isinstance(about, inspect.Metadata):
        return _type(about.type)
    if isinstance(about, inspect.UnionType):
        return " | ".join(_type(t) for t in about.types)
    if isinstance(about, inspect.LiteralType):
        return " | ".join(json.dumps(v) for v in about.values)
    if isinstance(about, inspect.TupleType):
        return f"[{', '.join(_type(t) for t in about.item_types)}]"
    if isinstance(about, inspect.VarTupleType | inspect.ListType):
        return f"{_grouped(_type(about.item_type))}[]"
    if type(about) in _SCALARS:
        return _SCALARS[type(about)]
    raise TypeError(f"A message has a field of a type that has no TypeScript here: {about!r}.")


def _grouped(text: str) -> str:
    return f"({text})" if "|" in text else text


if __name__ == "__main__":
    (static_folder() / "page" / "messages.d.ts").write_text(declarations(), encoding="utf-8")
