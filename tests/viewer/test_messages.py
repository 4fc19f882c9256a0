"""The messages of the page: one type each, from which the page's own types can be made."""

from __future__ import annotations

import msgspec
import pytest
from msgspec import inspect

from flatcloth.viewer.protocol import messages
from flatcloth.viewer.protocol.messages import Hover, MessageError, Pairs, Preview, parse


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


def test_the_pointer_may_be_far_off_the_garment_but_a_motion_may_not() -> None:
    assert parse('{"type": "hover", "id": 1, "u_m": -400, "v_m": 900}') == Hover(id=1, u_m=-400.0, v_m=900.0)
    for absurd in ("1e9", "1e308", "-1e308"):
        with pytest.raises(MessageError, match=r"u_m is -?1.*expected a number"):
            parse('{"type": "move", "view_index": 1, "u_m": ' + absurd + "}")
        with pytest.raises(MessageError, match=r"u_m is -?1.*expected a number"):
            parse('{"type": "hover", "id": 1, "v_m": 0, "u_m": ' + absurd + "}")
