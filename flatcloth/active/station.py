"""A simulated cell that turns and looks for an active loop."""

from __future__ import annotations

import numpy as np

from flatcloth.active.choosing import Next
from flatcloth.active.incoming import SeenView, Taken
from flatcloth.active.loop import ActiveLoop
from flatcloth.synthesis.cell import Cell


def view_of_cell(cell: Cell, angle_deg: float, number: int, *, masks: bool = True) -> SeenView:
    """Return what a cell shows at an angle, as a view for a loop.

    Without ``masks`` the side of interest is found from the views, as those of a real camera.
    """
    seen = cell.look(angle_deg, number)
    return SeenView(
        angle_deg=angle_deg,
        color=seen.color,
        depth_m=seen.depth_units.astype(np.float32) * np.float32(cell.depth_scale_m),
        intrinsics=cell.intrinsics,
        mask=seen.mask if masks else None,
        axis=cell.axis,
        held_point_m=cell.held_point_m,
        source=f"a simulated {cell.name}",
    )


def step(loop: ActiveLoop, cell: Cell, *, masks: bool = True) -> Taken | None:
    """Turn a cell to where a loop asks, and let the loop take the view, and learn; None at the end."""
    asked = loop.asked
    if not isinstance(asked, Next):
        return None
    taken = loop.take(view_of_cell(cell, asked.angle_deg, loop.views, masks=masks), loop.views)
    loop.wait()
    return taken
