"""What becomes of each pixel of the item in one view: part of the shape, or left out, and why.

A pixel leaves at the first step that it does not pass: it was not measured, a sensor's ramp hid its depth,
it touches a depth jump, or it is seen too steeply. What is left is the surface. There a method goes on: no
sample reaches a strip that is too narrow, and no chain of pairs may lead from a sample to the shape.
"""

from __future__ import annotations

from collections.abc import Collection
from enum import IntEnum

import numpy as np

from flatcloth.core.types import Bool, RgbdFrame, Uint8
from flatcloth.flattening.flatten import Flattening
from flatcloth.flattening.surface import Surface, off_edges


class PixelState(IntEnum):
    """What became of a pixel, in the order of the steps."""

    OFF_ITEM = 0
    UNMEASURED = 1
    RAMP = 2
    EDGE = 3
    STEEP = 4
    STRIP = 5
    NO_CHAIN = 6
    NOT_USED = 7
    FLOATING = 8
    SHAPE = 9


TEXTS = {
    PixelState.UNMEASURED: "not measured",
    PixelState.RAMP: "between two layers, whose depths the sensor mixed",
    PixelState.EDGE: "next to a jump in depth or to the outline",
    PixelState.STEEP: "seen too steeply",
    PixelState.STRIP: "in a strip too narrow to be flattened",
    PixelState.NO_CHAIN: "nothing that was seen joins it to the shape",
    PixelState.NOT_USED: "the view is not part of the shape",
    PixelState.FLOATING: "on a floating piece",
    PixelState.SHAPE: "in the shape",
}
"""The name of each state on the page."""


def states_of_view(frame: RgbdFrame, item: Bool, surface: Surface | None, on_surface: Uint8 | None) -> Uint8:
    """Return what became of each pixel of a view.

    Parameters
    ----------
    frame : RgbdFrame
        The view as recorded, (H, W).
    item : (H, W) bool
        The pixels of the side of interest, measured or not.
    surface : Surface, optional
        The surface of the view, cropped; None if it has none.
    on_surface : (h, w) uint8, optional
        The states of the surface's pixels, cropped as it is; without them ``NOT_USED``.
    """
    states = np.where(item, np.uint8(PixelState.UNMEASURED), np.uint8(PixelState.OFF_ITEM))
    states[item & (frame.depth_m > 0)] = PixelState.STEEP
    if surface is None:
        return states
    (row, col), (rows, cols) = surface.frame.offset_rc, surface.usable.shape
    own, item = states[row : row + rows, col : col + cols], item[row : row + rows, col : col + cols]
    known = surface.inverse_depth > 0
    own[item & (surface.frame.depth_m > 0) & ~known] = PixelState.RAMP
    own[item & known] = PixelState.STEEP
    own[item & known & ~off_edges(known, surface.steps)] = PixelState.EDGE
    used = np.uint8(PixelState.NOT_USED) if on_surface is None else on_surface
    own[:] = np.where(surface.usable, used, own)
    return states


def component_states(flattening: Flattening, components: Collection[int]) -> Uint8:
    """Return the states (H, W) on the surface of a view of which some components are placed; 0 elsewhere."""
    nearest = flattening.carrier.nearest
    placed = np.zeros(len(flattening.levels[-1].component) + 1, dtype=np.bool_)
    for component in components:
        placed[flattening.components[component].members] = True
    states = np.where(placed[nearest], np.uint8(PixelState.SHAPE), np.uint8(PixelState.NO_CHAIN))
    states[nearest < 0] = PixelState.STRIP
    states[~flattening.surface.usable] = PixelState.OFF_ITEM
    return states
