"""A shape is grown from what is kept, however little that is; nothing is computed twice on the way."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scenes import Cylinder

from flatcloth.core.cache import Cache, size_in_bytes
from flatcloth.core.config import Config
from flatcloth.core.types import RgbdFrame
from flatcloth.engine import views
from flatcloth.engine.integration import Integration
from flatcloth.methods.robust import method, shapes
from flatcloth.methods.robust.joint_shape import JointShape
from flatcloth.methods.robust.method import RobustMethod
from flatcloth.session.machine import Accept, Document, Propose, SessionState, Start, apply

STEPS = tuple(float(a) for a in range(0, 360, 20))


def grown(made: Integration, *views: int) -> list[Document]:
    """Accept views on view 0, and draw each shape on the way."""
    state, documents = SessionState(len(STEPS)), []
    for command in (Start(0), *map(Propose, views)):
        state = apply(state, command)
        assert state.request is not None
        state = apply(state, made.answer(state.document, state.request))
        if state.document.pending is not None:
            state = apply(state, Accept(state.document.pending.view_index))
        made.canonical(state.document)
        documents.append(state.document)
    return documents


def integration() -> tuple[Integration, shapes.JointShapes]:
    made = Integration(Cylinder(angles_deg=STEPS, span_deg=(-100.0, 100.0)))
    assert isinstance(made.algorithm, RobustMethod)
    return made, made.algorithm.shapes


def counted(monkeypatch: pytest.MonkeyPatch, module: Any, name: str) -> list[int]:
    calls, function = [], getattr(module, name)

    def counting(*args: Any, **options: Any) -> Any:
        calls.append(1)
        return function(*args, **options)

    monkeypatch.setattr(module, name, counting)
    return calls


class Split(Cylinder):
    """The cylinder without a strip down its middle, so that a view shows two components."""

    def __getitem__(self, view_index: int) -> RgbdFrame:
        whole = super().__getitem__(view_index)
        depth = whole.depth_m.copy()
        depth[:, depth.shape[1] // 2 - 8 : depth.shape[1] // 2 + 8] = 0.0
        return replace(whole, depth_m=depth, mask=whole.mask & (depth > 0.0))


def test_each_pixel_of_a_view_has_the_number_of_its_component() -> None:
    levels = replace(Config().flattening, sampling_intervals_px=(20, 10, 5))
    made = Integration(Split(angles_deg=(0.0,)), replace(Config(), flattening=levels))
    assert isinstance(made.algorithm, RobustMethod)
    flattening, number = made.views.flattening(0), made.algorithm.seen.component_of_pixel(0)
    assert len(flattening.components) == 2
    assert set(np.unique(number)) == {-1, 0, 1}
    for n, component in enumerate(flattening.components):
        shown = np.rint(component.view.source_rc[component.view.valid]).astype(int)
        shown -= np.array(flattening.surface.frame.offset_rc)
        assert (number[shown[:, 0], shown[:, 1]] == n).mean() > 0.99


def test_small_caches_cost_no_work_as_a_shape_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    extended, flattened = counted(monkeypatch, method, "extend_joint"), counted(monkeypatch, views, "flatten")
    made, own = integration()
    own._shapes, own._prefixes, made.views._flattenings = Cache(1), Cache(1), Cache(1)
    vars(made.algorithm)["_drawn"] = Cache(1)
    documents = grown(made, 1, 2, 3)
    assert (len(extended), len(flattened)) == (3, 4)
    # Back to a shape that is not kept: only the views after the longest kept prefix are added.
    other, own = integration()
    own._shapes = Cache(1)
    grown(other, 1, 2)
    del extended[:]
    np.testing.assert_array_equal(
        other.canonical(documents[-1]).view.xyz_m, made.canonical(documents[-1]).view.xyz_m
    )
    assert len(extended) == 1


def test_the_largest_piece_is_the_shape_from_where_the_integration_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    taken: list[tuple[int, ...]] = []

    def taking(shape: JointShape) -> JointShape:
        taken.append(shape.views)
        return replace(shape, all_uv_m=shape.all_uv_m + 1.0, anchor_uv_m=shape.anchor_uv_m + 1.0)

    monkeypatch.setattr(shapes, "with_largest_piece", taking)
    made, own = integration()
    document = grown(made, 1, 2, 3)[-1]
    ended = replace(document, largest_after=(2,))
    canonical, before = made.canonical(ended), made.canonical(document)
    assert taken == [(0, 1, 2)]
    np.testing.assert_allclose(canonical.view.xyz_m, before.view.xyz_m, rtol=0, atol=1e-7)  # float32
    moved = np.subtract(canonical.view.origin_uv_m, before.view.origin_uv_m)
    np.testing.assert_allclose(moved, 1.0, atol=1e-3)
    assert set(canonical.current_from_view) == {0, 1, 2, 3}
    # What was before is as it was.
    assert own.shape(replace(ended, accepted=ended.accepted[:1])).views == (0, 1)
    assert len(taken) == 1


def test_prefixes_are_counted_without_what_they_share() -> None:
    made, own = integration()
    document = grown(made, 1, 2, 3)[-1]
    assert own.shape(document).links.edges.size
    own._shapes = Cache(3)
    assert own.shape(document).links.edges.size  # of a shape whose prefix is the longest kept one
    kept = [value for _, value in own._prefixes.items()]
    assert not any(value.links.edges.size for value in kept)
    assert kept[-1].observations[0] is kept[0].observations[0]
    assert shapes._own_bytes(kept[-1]) < 0.6 * size_in_bytes(kept[-1])
