"""What an integration has come to: areas by view, cloth left out, what another view would add."""

from dataclasses import replace

import numpy as np
import pytest
from exported_sessions import cylinder_session

from flatcloth.engine.result import Areas, left_out, missing_pixels, pixel_counts, states_of
from flatcloth.export.session import OpenedSession
from flatcloth.flattening.pixel_states import PixelState
from flatcloth.rendering.sides import state_legend, state_rgba
from flatcloth.session.document import Rejected


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> OpenedSession:
    return cylinder_session(tmp_path_factory.mktemp("result"))


def test_areas_are_found_one_by_one_and_add_up_to_the_shape(session: OpenedSession) -> None:
    document, areas = session.history.document, Areas(session.integration)
    assert areas.added_m2(document) == [None, None, None]
    assert areas.missing(document) == [2, 1, 0]
    areas.compute(document, 2)
    assert areas.added_m2(document) == [None, None, None]  # what it was before is not known
    for order in areas.missing(document):
        areas.compute(document, order)
    added = [area for area in areas.added_m2(document) if area is not None]
    assert len(added) == 3
    assert sum(added) == pytest.approx(session.view.area_m2)
    assert all(area > 0 for area in added)


def test_cloth_of_a_rejected_view_is_left_out_with_its_reason_and_counted_once(
    session: OpenedSession,
) -> None:
    document, integration = session.history.document, session.integration
    areas = Areas(integration)
    last = document.accepted[-1].view_index
    refused = replace(
        document, accepted=document.accepted[:-1], rejected=(Rejected(last, "bad depth", 1),), skipped=()
    )
    found = left_out(integration, refused, integration.canonical(refused))
    assert {(left.view_index, left.reason) for left in found} == {(last, "rejected: bad depth")}
    lost = areas.total_m2(document, 2) - areas.total_m2(document, 1)
    assert sum(left.area_m2 for left in found) == pytest.approx(lost, rel=0.25)
    # The cloth of the cylinder that its views show is all in the shape.
    assert left_out(integration, document, integration.canonical(document)) == []


def test_every_pixel_of_the_item_is_counted_with_what_became_of_it(session: OpenedSession) -> None:
    document, integration = session.history.document, session.integration
    found = pixel_counts(integration, document)
    masks = [integration.views.frame(view).mask for view in document.used_views]
    assert sum(found.values()) == sum(int(mask.sum()) for mask in masks if mask is not None)
    assert found["shape"] > 0.8 * sum(found.values())
    assert found["unmeasured"] == found["ramp"] == found["floating"] == 0
    # A view that is not part of the shape tells why its pixels are no part of a surface, not more.
    last = document.accepted[-1].view_index
    before = replace(document, accepted=document.accepted[:-1])
    now, then = (states_of(integration, each, last) for each in (document, before))
    missing_now, missing_then = (missing_pixels(integration, each, last) for each in (document, before))
    assert set(np.unique(now[then == PixelState.NOT_USED])) <= {
        PixelState.SHAPE,
        PixelState.STRIP,
        PixelState.NO_CHAIN,
    }
    assert not (missing_now & (now == PixelState.SHAPE)).any()
    assert missing_now.sum() < missing_then.sum()
    legend = {row["state"]: row for row in state_legend(then, missing_then)}
    assert legend["not_used"]["missing"] > 0.05
    assert sum(row["share"] for row in legend.values()) == pytest.approx(1.0, abs=1e-3)
    image = state_rgba(then, missing_then)
    assert image[missing_then & (then == PixelState.NOT_USED), 3].min() > 200
    assert (state_rgba(now, missing_now)[now == PixelState.SHAPE, 3] == 0).all()
