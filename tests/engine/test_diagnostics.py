"""The reasons for a proposal, on a cylinder whose lines have closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from cylinder_views import CylinderViews, proposed
from viewer_fakes import RADIUS_M

from flatcloth.core.config import Config
from flatcloth.core.errors import FlatclothError
from flatcloth.engine.diagnostics import reasons
from flatcloth.session.document import Side

LIMIT_DEG = Config().planning.z_angle_limit_deg


def test_the_view_that_the_paper_would_continue_is_named():
    found = reasons(CylinderViews(), proposed(1))
    # The view 30 deg on: the item has turned to the right, its left side is new.
    assert (found.side, found.front_view, found.turn_deg) == (Side.LEFT, 0, pytest.approx(30.0))
    assert reasons(CylinderViews(), proposed(1, Side.RIGHT)).side is Side.RIGHT  # as it was planned
    back = reasons(CylinderViews(), proposed(11))
    assert (back.side, back.turn_deg) == (Side.RIGHT, pytest.approx(-30.0))


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


def test_views_without_a_common_z_angle_say_so():
    found = reasons(CylinderViews(), proposed(4))
    assert found.correspondence is None
    assert "no Z-angle in common" in found.trouble


def test_without_a_proposal_there_are_no_reasons():
    with pytest.raises(FlatclothError, match="no proposal to explain"):
        reasons(CylinderViews(), replace(proposed(1), pending=None))
