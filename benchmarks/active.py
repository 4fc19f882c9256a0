"""How many views an active loop needs on simulated cells, and whether what it says is true.

``--meshes`` are OBJ files; ``--recordings`` recordings of them with true points, found by the mesh's name at
their beginning. Each panel is looked at from ``--starts`` start angles, by ``--sensor`` with 2 mm of sway:
for two named points that are visible by truth, for two that are not, for its kind, and for its shape.
From the first start, ``fixed`` turns by 10 degrees. ``all`` is what both sides of 36 views give, integrated
as a recording: what they do not know cannot be known. A view at an angle is the same in all loops of a mesh.
``--keep`` keeps views and loops, so that many can be measured in pieces; with ``--starts 0`` nothing more is
measured.

The time of a view is that from the frame to the next angle: what is learnt of the view before takes the time
of the turn, and counts as far as it takes longer.
"""

from __future__ import annotations

import gc
import json
import tempfile
import time
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.cells import Views, true_points
from benchmarks.inputs import Remembered
from benchmarks.markdown import percent
from benchmarks.output import Options, Row, kept, save, say
from benchmarks.speed import unit_s
from benchmarks.unattended import integrated_sides
from flatcloth.active.choosing import End, Next, seconds_of
from flatcloth.active.goal import Budget, Goal, knowledge_of
from flatcloth.active.loop import ActiveLoop
from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import object_from_camera
from flatcloth.core.types import finite
from flatcloth.engine.garment import KnownGarment
from flatcloth.export.garment import named_points
from flatcloth.recordings import open_recording
from flatcloth.recordings.writer import DEPTH_SCALE_M, RecordingWriter, depth_units
from flatcloth.synthesis.recording import Cell

WITHIN_M, TRULY_M = 0.020, 0.040
"""What is asked of a point: its deviation, and its true error."""
VIEWS = 12
"""Budget; twice for points that no view shows, which is said after views from all round."""
Bounds = dict[tuple[str, int], Row]
"""What 36 views give, by mesh and panel."""
PAIRS = ("shoulder", "waist", "hem", "sleeve_top", "armpit", "neck", "pipe_outer", "cuff")
"""Pairs of named points, the first that fits is asked for."""


class _Fixed(ActiveLoop):
    """Turns by ten degrees."""

    def _decided(self) -> Next | End:
        asked = super()._decided()
        if isinstance(asked, End) and (asked.reached or "budget" in asked.reason):
            return asked
        return Next(angle_deg=(self.stands_deg + 10.0) % 360.0 if self.views else 0.0, turn_deg=10.0, why="")


LOOPS = {"active": ActiveLoop, "fixed": _Fixed}
CHOICES = {"active": "chosen for the goal", "fixed": "turned by 10 degrees"}


def run(options: Options) -> None:
    """Measure and print; write ``results/active.json`` unless ``quick``."""
    rows: list[Row] = []
    if options.keep and options.starts == 0:  # nothing more is measured
        rows = [
            row for file in sorted(Path(options.keep).glob("*.json")) for row in json.loads(file.read_text())
        ]
    for mesh in map(Path, options.meshes if options.starts else ()):
        found = [name for name in options.recordings if Path(name).name.startswith(mesh.stem)]
        if found:
            rows += _rows_of(mesh, found[0], options)
        else:
            say(f"{mesh.stem}: no recording with true points")
    found_figures = figures(rows)
    say(json.dumps(found_figures, indent=1))
    if rows and not options.quick:
        save("active", {"summary": found_figures, "loops": rows}, [row["mesh"] for row in rows])


def _rows_of(mesh: Path, recorded: str, options: Options) -> list[Row]:
    """Measure all loops of a mesh, and its 36 views."""
    rows: list[Row] = []
    views = Views(mesh, Path(options.keep or tempfile.mkdtemp()) / "views" / mesh.stem, options.sensor)
    for panel in (1, 2):
        truth = kept(options, f"truth/{mesh.stem}-{panel}", partial(true_points, views, recorded, panel))[0]
        rows += kept(options, f"{mesh.stem}-{panel}-all", partial(_all_views, views, panel, truth))
        for number, start_deg in enumerate(np.arange(options.starts) * (360.0 / options.starts)):
            asked = [(about, "active") for about in ("points", "hidden", "kind", "shape")]
            asked += [("points", "fixed")] * (number == 0)
            for about, choice in asked:
                key = f"{mesh.stem}-{panel}-{start_deg:.0f}-{about}-{choice}"
                loop = partial(measured, views, panel, float(start_deg), choice, truth, about)
                rows += kept(options, key, loop)
                gc.collect()  # an integration and its caches refer to one another
                if rows[-1]["about"] == about:
                    say(f"{key}: {rows[-1]['known_after']} {rows[-1]['errors_mm']} {rows[-1]['reason'][:90]}")
    return rows


def _all_views(views: Views, panel: int, truth: Row) -> list[Row]:
    """Return what 36 views give that are integrated as a recording."""
    with tempfile.TemporaryDirectory() as folder:
        cell = views.cell
        with RecordingWriter(
            folder, name="all", intrinsics=cell.intrinsics, depth_scale_m=DEPTH_SCALE_M,
            rotation_axis=cell.axis, held_point_m=cell.held_point_m,
        ) as writer:  # fmt: skip
            for angle in np.arange(0.0, 360.0, 10.0).tolist():
                view = views.at(panel, 0.0, angle)
                writer.add(angle, view.color, depth_units(view.depth_m), view.mask)
        try:
            service, document = integrated_sides(Remembered(open_recording(folder)))
            known = service.known(document)
            area_m2 = service.integration.canonical(document).view.area_m2
        except FlatclothError as error:
            known, area_m2 = str(error), 0.0
    knowledge = knowledge_of(area_m2, known)
    return [
        {
            "mesh": views.mesh.stem,
            "panel": panel,
            "about": "all",
            "true_kind": truth["kind"],
            "kind": knowledge.kind,
            "probability": knowledge.probability,
            "area_cm2": 1e4 * area_m2,
            "known": [name for name, point in knowledge.points.items() if point.is_within(WITHIN_M)],
            "std_mm": {name: round(1e3 * point.std_m, 1) for name, point in knowledge.points.items()},
            "errors_mm": _errors_mm(known, truth, views.cell, 0.0),
            "seen": truth["seen"],
        }
    ]


def _errors_mm(known: KnownGarment | str, truth: Row, cell: Cell, start_deg: float) -> dict[str, float]:
    """Return how far each named point that was seen is off; the corners of a towel have no order."""
    back = object_from_camera(cell.axis, start_deg).inverse()  # the object frame begins where the cell starts
    places = {name: back.apply(np.array(place)[None])[0] for name, place in truth["places"].items()}
    errors = {}
    for pick in named_points(known, None if isinstance(known, str) else known.sides):
        true = (
            list(places.values())
            if truth["kind"] == "towel"
            else [places[n] for n in (pick.name,) if n in places]
        )
        if true:
            off_m = np.linalg.norm(np.array(true) - pick.position_held_m, axis=1)
            errors[pick.name] = round(1e3 * float(off_m.min()), 1)
    return errors


def asked_points(truth: Row, *, hidden: bool) -> tuple[str, ...]:
    """Return two named points that are visible by truth, or one or two that are not; a pair if there is one.

    The corners of a towel have no order, so that two are asked for if all are visible.
    """
    fits = {name for name, seen in truth["seen"].items() if seen != hidden}
    if truth["kind"] == "towel":
        return tuple(sorted(fits)[:2]) if len(fits) == len(truth["seen"]) and not hidden else ()
    for pair in PAIRS:
        both = (f"{pair}_left", f"{pair}_right")
        if set(both) <= fits:
            return both
    some = sorted(fits)[:2]
    return tuple(some) if len(some) == 2 or hidden else ()


def measured(views: Views, panel: int, start_deg: float, choice: str, truth: Row, about: str) -> list[Row]:
    """Return what one loop found, view by view; nothing if there are no such points."""
    names = () if about in ("kind", "shape") else asked_points(truth, hidden=about == "hidden")
    if not names and about in ("points", "hidden"):
        return []
    goal = Goal(about="points", points=names, within_m=WITHIN_M) if names else Goal(about=about)
    with tempfile.TemporaryDirectory() as folder:
        most = 2 * VIEWS if about == "hidden" else VIEWS
        loop = LOOPS[choice](Path(folder) / "out", goal, Budget(views=most))
        steps, learning_s = list[Row](), 0.0
        while isinstance(loop.asked, Next):
            angle, turn_s = loop.asked.angle_deg, seconds_of(loop.asked.turn_deg)
            view = views.at(panel, start_deg, angle)
            began_s = time.process_time()
            loop.take(view, loop.views)
            chosen_s = time.process_time()
            loop.wait()
            learnt_s = time.process_time() - chosen_s
            seconds = chosen_s - began_s + max(0.0, learning_s - turn_s)
            learning_s = learnt_s
            errors = _errors_mm(loop.known, truth, views.cell, start_deg)
            knowledge = loop.knowledge
            steps.append(
                {
                    "angle_deg": angle,
                    "seconds": seconds,
                    "learning_s": learning_s,
                    "area_cm2": 1e4 * knowledge.area_m2,
                    "kind": knowledge.kind,
                    "probability": knowledge.probability,
                    "known": knowledge.is_reached(goal),
                    "std_mm": {name: finite(1e3 * knowledge.point(name).std_m) for name in names},
                    "errors_mm": {name: errors[name] for name in names if name in errors},
                }
            )
        end = loop.asked
        loop.close()
    known = next((n for n, step in enumerate(steps, start=1) if step["known"]), None)
    assert isinstance(end, End)
    return [
        {
            "mesh": views.mesh.stem,
            "panel": panel,
            "start_deg": start_deg,
            "choice": choice,
            "about": about,
            "points": list(names),
            "true_kind": truth["kind"],
            "known_after": known,
            "errors_mm": steps[known - 1]["errors_mm"] if known else {},
            "reached": end.reached,
            "reason": end.reason,
            "said_hidden": list(end.hidden),
            "u_s": unit_s(clock=time.process_time),
            "views": steps,
        }
    ]


def figures(rows: Sequence[Row]) -> Row:
    """Return the figures of all loops, named as their tables name them, beside what 36 views give."""
    bounds = {(row["mesh"], row["panel"]): row for row in rows if row["about"] == "all"}
    points, hidden, shapes, kinds = (
        [row for row in rows if row["about"] == about] for about in ("points", "hidden", "shape", "kind")
    )
    said = [row for row in rows if row.get("said_hidden")]
    areas = [(row["views"][-1]["area_cm2"], _bound_of(row, bounds).get("area_cm2", 0.0)) for row in shapes]
    kind_after = [_kind_after(row) for row in kinds]
    visible = [(name, bound) for bound in bounds.values() for name, seen in bound["seen"].items() if seen]
    other = {
        "visible points of all panels that 36 views know": _share(
            name in bound["known"] for name, bound in visible
        ),
        "panels whose kind 36 views find, surer than 0.9": _share(
            bound["kind"] is not None and bound["probability"] >= 0.9 for bound in bounds.values()
        ),
        '"cannot be known" said, times': len(said),
        "of these, 36 views do not know them either": _share(
            not set(row["said_hidden"]) & _knowable(row, bounds) for row in said
        ),
        "loops for points that no view shows": len(hidden),
        "of these, said to be unknowable": _share("cannot be known" in row["reason"] for row in hidden),
        "of these, said to be known": _share(row["known_after"] is not None for row in hidden),
        "loops for the shape": sum(bound > 0.0 for _, bound in areas),
        "of these, at least 0.95 of the area of 36 views after at most 12": _share(
            area >= 0.95 * bound for area, bound in areas if bound > 0.0
        ),
        "loops for the kind": len(kinds),
        "views until it is surer than 0.9, median": _median(kind_after),
        "of these, after at most 4": _share(after <= 4 for after in kind_after),
        "and after at most 12": _share(after <= 12 for after in kind_after),
        "wrong kinds above 0.9": sum(map(_is_wrong, kinds)),
    }
    pairs = [
        {"angles": words, **_of_pairs([row for row in points if row["choice"] == choice], bounds)}
        for choice, words in CHOICES.items()
    ]
    return {"pairs": pairs, "other": other}


def _of_pairs(loops: Sequence[Row], bounds: Bounds) -> Row:
    """Return after how many views loops know two points."""
    after = [row["known_after"] or np.inf for row in loops]
    knowable = [set(row["points"]) <= _knowable(row, bounds) for row in loops]
    of_knowable = [views for views, can in zip(after, knowable, strict=True) if can]
    wrongly = ["cannot be known" in row["reason"] and can for row, can in zip(loops, knowable, strict=True)]
    in_u = [view["seconds"] / row["u_s"] for row in loops for view in row["views"][2:]]
    return {
        "loops": len(loops),
        "36 views know both": _share(knowable),
        "views until known, median": _median(after),
        "within 6": _share(views <= 6 for views in after),
        "within 12": _share(views <= 12 for views in after),
        "truly within 40 mm": _share(
            max(row["errors_mm"].values()) <= 1e3 * TRULY_M for row in loops if row["known_after"]
        ),
        "of those that 36 views know: median": _median(of_knowable),
        "of those within 12": _share(views <= 12 for views in of_knowable),
        "wrongly said unknowable": _share(wrongly),
        "wrong kinds above 0.9": sum(map(_is_wrong, loops)),
        "U a view": _median(in_u),
    }


def _bound_of(row: Row, bounds: Bounds) -> Row:
    return bounds.get((row["mesh"], row["panel"]), {})


def _knowable(row: Row, bounds: Bounds) -> set[str]:
    """Return the points that are visible by truth and that 36 views know."""
    bound = _bound_of(row, bounds)
    return {name for name in bound.get("known", ()) if bound["seen"].get(name)}


def _share(are: Iterable[bool]) -> str:
    every = list(are)
    return percent(float(np.mean(every))) if every else "-"


def _median(values: Sequence[float]) -> str:
    middle = float(np.median(values)) if len(values) else np.nan
    return "-" if np.isnan(middle) else f"{middle:.3g}" if np.isfinite(middle) else f"more than {VIEWS}"


def _sure_kinds(row: Row) -> list[tuple[int, str]]:
    """Return after which views a kind was surer than 0.9, and which."""
    numbered = enumerate(row["views"], start=1)
    return [(n, view["kind"]) for n, view in numbered if view.get("kind") and view["probability"] >= 0.9]


def _kind_after(row: Row) -> float:
    return next((n for n, _ in _sure_kinds(row)), np.inf)


def _is_wrong(row: Row) -> bool:
    return any(kind != row["true_kind"] for _, kind in _sure_kinds(row))
