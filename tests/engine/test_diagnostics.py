"""The reasons for a proposal, on a cylinder whose curves and lines have closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from cylinder_views import CylinderViews, proposed
from viewer_fakes import HEIGHT_M, PIXEL_M, RADIUS_M, CylinderRecording

from flatcloth.core.config import Config
from flatcloth.core.errors import FlatclothError
from flatcloth.engine.diagnostics import reasons
from flatcloth.session.machine import Side

RECORDING = CylinderRecording()
LIMIT_DEG = Config().planning.z_angle_limit_deg


def test_the_curves_are_those_of_the_cylinder():
    found = reasons(CylinderViews(), proposed(1))
    # The view 30 deg on: the item has turned to the right, its left side is new.
    assert (found.side, found.front_view, found.turn_deg) == (Side.LEFT, 0, pytest.approx(30.0))
    np.testing.assert_allclose(
        found.curves.column_mean_z_angle_deg, np.degrees(found.curves.u_m / RADIUS_M), atol=0.2 + 1.0
    )
    rows = HEIGHT_M / PIXEL_M
    assert np.unique(found.curves.column_count).tolist() == [rows]
    # Turned back, the new view has the Z-angles that the same cloth has in the old one.
    own = found.new_curves
    np.testing.assert_allclose(
        own.column_mean_z_angle_deg - found.turn_deg, np.degrees(own.u_m / RADIUS_M), atol=1.2
    )


def test_the_overlap_is_reached_where_the_area_says_and_leads_to_the_planned_rotation():
    found = reasons(CylinderViews(), proposed(1))
    config = CylinderViews().planning
    left = -math.radians(LIMIT_DEG) * RADIUS_M
    expected = left + config.overlap_area_m2 / HEIGHT_M
    assert found.u_b_m == pytest.approx(expected, abs=2 * PIXEL_M)
    assert found.a_0_deg == pytest.approx(math.degrees(found.u_b_m / RADIUS_M), abs=1.2)
    planned = np.clip(LIMIT_DEG - found.a_0_deg, config.rotation_min_deg, config.rotation_max_deg)
    assert found.rotation_deg == pytest.approx(planned)


def test_the_lines_are_at_the_middle_of_the_common_range():
    found = reasons(CylinderViews(), proposed(1))
    lines = found.correspondence
    assert found.trouble == ""
    # Both see from -50 deg of the old view (its limit) to 50 - 30 deg (the new one's).
    assert lines.common_range_deg == pytest.approx((-LIMIT_DEG, LIMIT_DEG - 30.0), abs=2.5)
    assert lines.a_m_deg == pytest.approx(-15.0, abs=2.5)
    u = math.radians(lines.a_m_deg) * RADIUS_M
    assert lines.current.point_uv_m[0] == pytest.approx(u, abs=0.006)
    assert lines.new.point_uv_m == pytest.approx(lines.current.point_uv_m, abs=0.008)
    assert abs(lines.current.direction[1]) == pytest.approx(1.0, abs=1e-3)


def test_turned_the_other_way_it_is_the_other_side():
    found = reasons(CylinderViews(), proposed(11))
    assert (found.side, found.turn_deg) == (Side.RIGHT, pytest.approx(-30.0))
    assert found.u_b_m > 0


def test_views_without_a_common_z_angle_say_so():
    found = reasons(CylinderViews(), proposed(4))
    assert found.correspondence is None
    assert "no Z-angle in common" in found.trouble
    assert found.curves.column_count.size > 0


def test_the_papers_method_continues_its_front_and_the_side_that_was_planned():
    found = reasons(CylinderViews("paper"), proposed(1, Side.RIGHT))
    assert found.side is Side.RIGHT
    assert found.u_b_m > 0


def test_without_a_proposal_there_are_no_reasons():
    with pytest.raises(FlatclothError, match="no proposal to explain"):
        reasons(CylinderViews(), replace(proposed(1), pending=None))
