"""Small simulated cells: a bent sheet before a small camera."""

from dataclasses import replace
from pathlib import Path

from garment_meshes import RADIUS_M, arc, write_obj

from flatcloth.active.choosing import End
from flatcloth.active.eye import step, view_of_cell
from flatcloth.active.goal import Budget, Goal
from flatcloth.active.incoming import SeenView
from flatcloth.active.loop import ActiveLoop
from flatcloth.synthesis.recording import Cell
from flatcloth.synthesis.request import Request

SHAPE = Goal(about="shape")


def sheet_cell(folder: Path, span_deg: float = 300.0, **more: object) -> Cell:
    """A cell with a sheet that is bent nearly round, which no single view shows as a whole."""
    folder.mkdir(exist_ok=True)
    mesh = write_obj(folder / "sheet.obj", *arc(span_deg, columns=48))
    request = Request(mesh=mesh, out=folder, size_px=(128, 176), focal_px=250.0, held=(RADIUS_M, 0.0, 0.0))
    return Cell(replace(request, **more))  # type: ignore[arg-type]


def loop_in(folder: Path, goal: Goal = SHAPE, views: float = 12) -> ActiveLoop:
    return ActiveLoop(folder, goal, Budget(views=views))


def led(loop: ActiveLoop, cell: Cell, most: int = 12) -> ActiveLoop:
    """Let a cell answer a loop, up to so many times."""
    for _ in range(most):
        if isinstance(loop.asked, End):
            break
        step(loop, cell)
    return loop


def seen(cell: Cell, angle_deg: float, number: int = 0) -> SeenView:
    return view_of_cell(cell, angle_deg, number)
