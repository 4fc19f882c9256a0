"""Every pixel of a view is told why it is no part of the surface, or of the shape."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_sheets import shape_of_view
from scenes import AXIS, CAMERA, Cylinder, box, frame, placed_view, plane

from flatcloth.core.config import FlatteningConfig, SurfaceConfig
from flatcloth.flattening.flatten import flatten
from flatcloth.flattening.pixel_states import PixelState, component_states, states_of_view
from flatcloth.flattening.surface import observe_item
from flatcloth.shape.drawing import states_of_nodes, states_on_surface

NEAR_M, FAR_M, STEP_COL = 0.80, 0.85, 120
ROWS, COLS = slice(120, 140), slice(135, 155)  # a hole that is too large to be bridged


def two_layers(ramp_px: int) -> np.ndarray:
    """A near layer on the left, a far one on the right, joined by a ramp of some pixels, with a hole."""
    share = np.clip((np.arange(CAMERA.width) - STEP_COL) / max(ramp_px, 1), 0.0, 1.0)
    share = 0.5 - 0.5 * np.cos(np.pi * share)
    depth = plane(depth_m=NEAR_M) + (plane(depth_m=FAR_M) - plane(depth_m=NEAR_M)) * share
    depth[ROWS, COLS] = 0.0
    return depth


def states_of(depth: np.ndarray) -> np.ndarray:
    mask = box(0.1, plane())
    seen = frame(depth, mask)
    surface = observe_item(seen, AXIS, SurfaceConfig())
    return states_of_view(seen, mask, surface, None)


def test_holes_steps_and_ramps_are_told_apart() -> None:
    states = states_of(two_layers(ramp_px=0))
    assert (states[ROWS, COLS] == PixelState.UNMEASURED).all()
    inside = slice(90, 110)
    assert (states[inside, STEP_COL : STEP_COL + 2] == PixelState.EDGE).any()
    assert (states[inside, STEP_COL - 20 : STEP_COL - 5] == PixelState.NOT_USED).all()
    assert not (states == PixelState.RAMP).any()
    assert (states[box(0.1, plane()) == 0] == PixelState.OFF_ITEM).all()
    ramp = states_of(two_layers(ramp_px=6))
    assert (ramp[inside, STEP_COL + 2 : STEP_COL + 5] == PixelState.RAMP).all()


def test_steep_cloth_and_outlines_are_told() -> None:
    cylinder, strict = Cylinder(), SurfaceConfig(grazing_limit_deg=60.0)
    seen = cylinder[0]
    assert seen.mask is not None
    _, around = cylinder.surface(0)
    states = states_of_view(seen, seen.mask, observe_item(seen, AXIS, strict), None)
    rings = [states[seen.mask & (around > a) & (around < b)] for a, b in ((-5, 5), (52.5, 54.5), (70, 80))]
    found = [np.unique(ring).tolist() for ring in rings]
    assert found == [[PixelState.NOT_USED], [PixelState.STEEP], [PixelState.EDGE]]
    # A view without a surface: what was measured is too steep.
    bare = states_of_view(seen, seen.mask, None, None)
    assert (bare[seen.mask & (seen.depth_m > 0)] == PixelState.STEEP).all()


def test_every_component_that_is_placed_is_in_the_shape() -> None:
    mask = box(0.1, plane())
    surface = observe_item(frame(two_layers(ramp_px=0), mask), AXIS, SurfaceConfig())
    flattening = flatten(surface, AXIS, FlatteningConfig())
    every = range(len(flattening.components))
    assert len(every) > 1
    none, *single, together = (
        (component_states(flattening, placed)[surface.usable] == PixelState.SHAPE).mean()
        for placed in ((), *((n,) for n in every), every)
    )
    assert none == 0.0
    assert min(single) > 0.05
    assert together == pytest.approx(sum(single))
    assert together > 0.95


def test_on_the_surface_a_pixel_has_the_state_of_what_carries_it() -> None:
    cylinder = Cylinder(angles_deg=(0.0,))
    view = placed_view(cylinder[0])
    surface = view.surface
    flattening = flatten(surface, AXIS, FlatteningConfig())
    states = component_states(flattening, {0})
    assert set(np.unique(states[surface.usable])) <= {PixelState.SHAPE, PixelState.STRIP}
    assert (states[surface.usable] == PixelState.SHAPE).mean() > 0.95
    shape = shape_of_view(view, cylinder.flat_uv_m)
    state = states_of_nodes(shape, taken_off=shape.nodes.xyz_m[:, 0] < 0.0)
    found = states_on_surface(shape.observations[0], surface, state, FlatteningConfig())
    x = surface.xyz_m[..., 0]
    assert (found[surface.usable & (x < -0.02)] == PixelState.FLOATING).mean() > 0.95
    assert (found[surface.usable & (x > 0.02)] == PixelState.SHAPE).mean() > 0.95
    assert (found[~surface.usable] == PixelState.OFF_ITEM).all()
    # Nodes without a pair carry nothing: a strip of one node.
    observation = replace(shape.observations[0], edges=shape.observations[0].edges[:1])
    alone = states_on_surface(observation, surface, state, FlatteningConfig())
    assert (alone[surface.usable] == PixelState.STRIP).mean() > 0.9
