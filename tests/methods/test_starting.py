from dataclasses import replace

import numpy as np
import pytest

from flatcloth.core.config import Config
from flatcloth.methods.starting import overlap_area_m2, start_by_component, start_by_view


class Shown:
    """Views of which the observed area and that of the largest unfolded component are given."""

    def __init__(self, *views, config=None):
        self.config, self.views, self.flattened = config or Config(), views, []

    def observed_areas_m2(self, _progress=None):
        return np.array([observed for observed, *_ in self.views])

    def unfolded_area_m2(self, view):
        self.flattened.append(view)
        return self.views[view][1]


def test_the_start_view_shows_the_largest_surface_not_the_largest_sum_of_parts():
    views = Shown((0.20, 0.11), (0.15, 0.16), (0.14, 0.15))
    assert start_by_view(views) == 0
    assert start_by_component(views) == 1


def test_a_steep_surface_is_larger_than_what_is_observed_of_it():
    views = Shown((0.130, 0.090), (0.100, 0.095), (0.093, 0.098), (0.07, 0.07))
    assert start_by_component(views) == 2
    assert 3 not in views.flattened


def test_a_view_that_is_folded_or_cannot_be_flattened_is_no_start_view():
    assert start_by_component(Shown((0.2, 0.0), (0.1, 0.1))) == 1
    assert start_by_view(Shown((0.2, 0.0), (0.1, 0.1))) == 1
    assert start_by_component(Shown((0.2, 0.0))) is None
    assert start_by_view(Shown((0.2, 0.0))) is None


def test_the_overlap_follows_the_size_of_the_item_unless_it_is_set():
    views = (0.1, 0.1), (0.05, 0.05)
    assert overlap_area_m2(Shown(*views)) == pytest.approx(0.02)
    base = Config()
    given = replace(base, planning=replace(base.planning, overlap_area_m2=0.03))
    assert overlap_area_m2(Shown(*views, config=given)) == 0.03
