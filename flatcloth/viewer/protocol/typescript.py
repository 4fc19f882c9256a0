"""The messages of the page and of the server as TypeScript, to check the page's modules against them.

``python -m flatcloth.viewer.protocol.typescript`` writes ``static/page/messages.d.ts``; a test compares the
two. The page itself needs no TypeScript: only ``make lint`` reads the file.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import numpy as np
from msgspec import NODEFAULT, inspect

from flatcloth.core.resources import static_folder
from flatcloth.viewer.protocol.messages import KINDS
from flatcloth.viewer.protocol.sent import (
    DiagnosticsInfo,
    DoubtsInfo,
    ItemBox,
    ResultInfo,
    SeenViews,
    ServerMessage,
)

_ANSWERS = (ResultInfo, DiagnosticsInfo, SeenViews, ItemBox, DoubtsInfo)
"""Sent as the answers of routes."""
_SCALARS: dict[type, str] = {
    inspect.IntType: "number",
    inspect.FloatType: "number",
    inspect.StrType: "string",
    inspect.BoolType: "boolean",
    inspect.NoneType: "null",
    inspect.AnyType: "any",
}


def declarations() -> str:
    """Return the text of a ``.d.ts`` file: one interface a struct, and the unions of all messages."""
    sent, taken = list(KINDS.values()), ServerMessage.__subclasses__()
    lines = ["// Made by flatcloth/viewer/protocol/typescript.py; not to be edited.", ""]
    lines += [_interface(kind, optional=True) for kind in sent]
    lines += ["/** Every message that the page sends. */", _union("ClientMessage", sent), ""]
    lines += [_interface(kind, optional=False) for kind in _with_parts([*taken, *_ANSWERS])]
    lines += ["/** Every message that the server sends as text. */", _union("ServerMessage", taken), ""]
    return "\n".join(lines)


def _union(name: str, kinds: Iterable[type]) -> str:
    return f"export type {name} =" + "".join(f"\n  | {kind.__name__}" for kind in kinds) + ";"


def _with_parts(kinds: Iterable[type]) -> list[type]:
    """Return structs and the structs in their fields, each once."""
    found: dict[type, None] = {}

    def visit(about: Any) -> None:
        if isinstance(about, inspect.StructType | inspect.DataclassType):
            if about.cls in found:
                return
            found[about.cls] = None
            for field in about.fields:
                visit(field.type)
            return
        for name in ("type", "types", "item_type", "item_types", "value_type"):
            inner = getattr(about, name, ())
            for each in inner if isinstance(inner, tuple) else (inner,):
                visit(each)

    for kind in kinds:
        visit(inspect.type_info(kind))
    return list(found)


def _interface(kind: type, *, optional: bool) -> str:
    """Return a struct as an interface; ``optional``: fields with a default may be left out."""
    about = inspect.type_info(kind)
    assert isinstance(about, inspect.StructType | inspect.DataclassType)
    summary = (kind.__doc__ or "").strip().splitlines()[0]
    rows = [f"/** {summary} */", f"export interface {kind.__name__} {{"]
    if isinstance(about, inspect.StructType) and about.tag is not None:
        rows.append(f"  type: {json.dumps(about.tag)};")
    for field in about.fields:
        required = field.default is NODEFAULT and field.default_factory is NODEFAULT
        rows.append(f"  {field.encode_name}{'?' if optional and not required else ''}: {_type(field.type)};")
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
        item = _type(about.item_type)
        return f"({item})[]" if "|" in item else f"{item}[]"
    if isinstance(about, inspect.DictType):
        return f"Record<{_type(about.key_type)}, {_type(about.value_type)}>"
    if isinstance(about, inspect.StructType | inspect.DataclassType):
        return about.cls.__name__
    if isinstance(about, inspect.EnumType):
        return " | ".join(json.dumps(each.value) for each in about.cls)
    if isinstance(about, inspect.CustomType) and about.cls is np.ndarray:
        return "any[]"  # rows of numbers, as deep as its shape; NaN is null
    if type(about) in _SCALARS:
        return _SCALARS[type(about)]
    raise TypeError(f"A message has a field of a type that has no TypeScript here: {about!r}.")


if __name__ == "__main__":
    (static_folder() / "page" / "messages.d.ts").write_text(declarations(), encoding="utf-8")
