"""The messages of the page: one type each, from which the page's own types can be made."""

from __future__ import annotations

import msgspec
from msgspec import inspect

from flatcloth.viewer.protocol import messages
from flatcloth.viewer.protocol.messages import Pairs, Preview, parse


def test_every_message_has_a_type_a_sentence_and_known_fields() -> None:
    for kind in messages.KINDS.values():
        about = inspect.type_info(kind)
        assert isinstance(about, inspect.StructType)
        assert (about.tag_field, about.forbid_unknown_fields) == ("type", True)
        assert kind.__doc__
        assert kind.__doc__.split("\n")[0].endswith((".", ";", ","))
        schema = msgspec.json.schema(kind)
        assert schema["$defs"][kind.__name__]["properties"]["type"] == {"enum": [about.tag]}


def test_a_message_that_adds_to_another_has_the_fields_of_both() -> None:
    said = parse('{"type": "preview", "id": 3, "view_index": 1, "u_m": 0.25}')
    assert said == Preview(id=3, view_index=1, u_m=0.25)
    pairs = parse('{"type":"pairs","view_index":1,"new_uv_m":[[0,1]],"shape_uv_m":[[2,3]],"weights":[1]}')
    assert isinstance(pairs, Pairs)
    assert pairs.shape_uv_m == ((2.0, 3.0),)
