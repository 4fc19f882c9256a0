"""The messages of the page: one type each, from which the page's own types can be made."""

from __future__ import annotations

import msgspec
from msgspec import inspect

from flatcloth.viewer.protocol import messages


def test_every_message_has_a_type_a_sentence_and_known_fields() -> None:
    for kind in messages.KINDS.values():
        about = inspect.type_info(kind)
        assert isinstance(about, inspect.StructType)
        assert (about.tag_field, about.forbid_unknown_fields) == ("type", True)
        assert kind.__doc__
        assert kind.__doc__.split("\n")[0].endswith((".", ";", ","))
        schema = msgspec.json.schema(kind)
        assert schema["$defs"][kind.__name__]["properties"]["type"] == {"enum": [about.tag]}
