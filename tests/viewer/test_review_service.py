"""What the page is told of decided views."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
from route_client import RouteClient
from scenes import AXIS

from flatcloth.core.types import Rigid2
from flatcloth.engine.result import More, Result
from flatcloth.session.document import Accepted, Document
from flatcloth.session.garment import ClothPlaces, DoubtedPart, GarmentDecisions
from flatcloth.viewer.modes import review
from flatcloth.viewer.modes.review import ReviewService


def test_the_result_is_that_of_the_present_shape(monkeypatch: pytest.MonkeyPatch) -> None:
    cloth = ClothPlaces(((0.0, 0.0, 0.0),) * 3, ((0.0, 0.0),) * 3)
    first = Document(start_view=0, accepted=(Accepted(1, Rigid2()),))
    parts = (DoubtedPart(taken_off=True, part=cloth, rest=cloth, probability=0.1),)
    documents = [
        first,
        replace(first, accepted=()),
        replace(first, garment=GarmentDecisions(parts=parts)),
        first,
    ]
    computed: list[Document] = []

    def result_of(_areas: object, document: Document) -> Result:
        computed.append(document)
        return Result(uncertainty={}, left_out=(), more=More(reason="", expected=(), share=None))

    monkeypatch.setattr(review, "result_of", result_of)
    integration = SimpleNamespace(accept_score=0.5, axis=AXIS)
    page = SimpleNamespace(integration=integration)
    client = RouteClient(ReviewService(cast("Any", page)).routes())
    for revision, document in enumerate(documents):
        page.picture = SimpleNamespace(revision=revision, document=document)
        assert client.get("/review/result.json").json()["revision"] == revision
    assert computed == documents[:3]
