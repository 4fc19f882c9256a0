"""How many views an active loop needs on simulated cells, and whether what it says is true.

``--meshes`` are OBJ files; ``--recordings`` recordings of them with true points, found by the mesh's name at
their beginning. Each panel is looked at from ``--starts`` start angles, with the noise of a D435 and 2 mm of
sway, for two named points that are visible by truth, and for two that are not. ``fixed`` turns by 10 degrees;
``present`` is the choice among views every 10 degrees by new area alone. ``--keep`` keeps each loop, so that
many can be measured in pieces; with ``--starts 0`` nothing more is measured.
"""

from __future__ import annotations

import functools
import json
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.inputs import Remembered
from benchmarks.output import Options, save, say
from flatcloth.active.choosing import Next, shorter_deg
from flatcloth.active.ending import End
from flatcloth.active.goal import Budget, Goal
from flatcloth.active.loop import ActiveLoop
from flatcloth.active.station import view_of_cell
from flatcloth.core.geometry import back_project, camera_from_held, fit_rigid2, held_from_camera
from flatcloth.engine.garment.truth import read_true_points
from flatcloth.export.garment import garment_points
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import read_truth
from flatcloth.synthesis.cell import Cell
from flatcloth.synthesis.hanging import PoseErrors
from flatcloth.synthesis.meshes import read_mesh
from flatcloth.synthesis.recording import Request

SEEN_M = 0.012
"""A point is visible by truth if a pixel of its panel is as near. Chosen: the error of a named point."""
WITHIN_M, TRULY_M = 0.020, 0.040
"""What is asked of a point: its deviation, and its true error."""
VIEWS = 12
PAIRS = ("shoulder", "waist", "hem", "sleeve_top", "armpit", "neck", "pipe_outer", "cuff")
"""Pairs of named points, the first that fits is asked for."""
CHOICES = ("active", "fixed", "present")


class _Fixed(ActiveLoop):
    """Turns by ten degrees."""

    def _decided(self) -> Next | End:
        asked = super()._decided()
        if isinstance(asked, End) and (asked.reached or "budget" in asked.reason):
            return asked
        return Next(angle_deg=(self.stands_deg + 10.0) % 360.0 if self.views else 0.0, turn_deg=10.0, why="")


class _Present(ActiveLoop):
    """Chooses by new area among views every ten degrees, as among those of a recording."""

    def _decided(self) -> Next | End:
        asked = super()._decided()
        if isinstance(asked, End) and (asked.reached or "budget" in asked.reason):
            return asked
        if self.integration is None or self.document.start_view is None:
            return asked
        taken = self.integration.views.angles_deg
        free = [a for a in np.arange(0.0, 360.0, 10.0) if min(abs(shorter_deg(a - t)) for t in taken) > 5.0]
        plan = self.integration.algorithm.look_ahead(self.document, [*taken, *map(float, free)])
        assert plan.view_index is not None
        angle = float([*taken, *free][plan.view_index])
        return Next(angle_deg=angle, turn_deg=shorter_deg(angle - self.stands_deg), why="")


LOOPS = {"active": ActiveLoop, "fixed": _Fixed, "present": _Present}


def run(options: Options) -> None:
    """Measure and print; write ``results/active.json`` unless ``quick``."""
    rows: list[dict[str, Any]] = []
    if options.keep and options.starts == 0:  # nothing more is measured
        rows = [json.loads(file.read_text()) for file in sorted(Path(options.keep).glob("*.json"))]
    for mesh in map(Path, options.meshes):
        found = [name for name in options.recordings if Path(name).name.startswith(mesh.stem)]
        if not found:
            say(f"{mesh.stem}: no recording with true points")
            continue
        for panel in (1, 2):
            truth: dict[str, Any] | None = None
            for start_deg in np.arange(options.starts) * (360.0 / options.starts):
                for choice, hidden in [*((each, False) for each in CHOICES), ("active", True)]:
                    key = f"{mesh.stem}-{panel}-{start_deg:.0f}-{choice}{'-hidden' if hidden else ''}"
                    file = Path(options.keep) / f"{key}.json" if options.keep else None
                    if file is not None and file.exists():
                        rows.append(json.loads(file.read_text()))
                        continue
                    truth = truth or true_points(mesh, found[0], panel)
                    row = measured(mesh, panel, float(start_deg), choice, truth, hidden=hidden)
                    if row is None:
                        continue
                    rows.append(row)
                    if file is not None:
                        file.parent.mkdir(parents=True, exist_ok=True)
                        file.write_text(json.dumps(row))
                    say(f"{key}: {row['known_after']} {row['errors_mm']} {row['reason'][:90]}")
    found_figures = figures(rows)
    say(json.dumps(found_figures, indent=1))
    if rows and not options.quick:
        save("active", {"summary": found_figures, "loops": rows}, [row["mesh"] for row in rows])


def request_of(mesh: Path, panel: int, **more: Any) -> Request:
    return Request(mesh=mesh, out=Path(), panel=str(panel), texture="floral", **more)


def true_points(mesh_file: Path, recorded: str, panel: int) -> dict[str, Any]:
    """Return the true places of the named points on the mesh, object frame at start 0, and which are seen.

    The recording's truth says where a point lies on its flat panel; the pattern coordinates of the mesh lead
    from there to a vertex. As seen from outside of the other panel, left and right are exchanged.
    """
    recording, truth = Remembered(open_recording(recorded)), read_truth(recorded)
    named = read_true_points(Path(recording.location))
    assert named is not None
    cell = Cell(request_of(mesh_file, panel))
    mesh, vertices = read_mesh(mesh_file), cell.points_m
    own = truth.panel_of_interest
    members = mesh.group == [name.lower() for name in mesh.group_names].index("front" if own == 1 else "back")
    corner = mesh.triangles[members].ravel()
    assert mesh.corner_uv is not None
    pattern = mesh.corner_uv[members].reshape(-1, 2) * (1.0, -1.0)
    seen_xyz, seen_uv = [], []
    for n in range(0, len(recording), 3):
        frame, true = recording[n], truth[n]
        shown = (true.panel == own) & true.outer_face & (frame.depth_m > 0)
        held = held_from_camera(recording.rotation_axis, frame.angle_deg)
        seen_xyz.append(held.apply(back_project(frame.depth_m, frame.intrinsics)[shown][::20].astype(float)))
        seen_uv.append(true.flat_uv_m[shown][::20].astype(float))
    xyz, flat_uv = np.concatenate(seen_xyz), np.concatenate(seen_uv)
    tree = cKDTree(vertices[corner])
    turns = [camera_from_held(cell.axis, angle) for angle in np.arange(0.0, 360.0, 5.0)]
    turn = min(turns, key=lambda each: float(np.median(tree.query(each.apply(xyz))[0])))
    off, nearest = tree.query(turn.apply(xyz))
    near = off < 0.006
    fits = []
    for mirror in (1.0, -1.0):
        flat = pattern[nearest[near]] * (mirror, 1.0)
        motion = fit_rigid2(flat, flat_uv[near])
        left = float(np.median(np.linalg.norm(motion.apply(flat) - flat_uv[near], axis=1)))
        fits.append((left, mirror, motion))
    left_m, mirror, motion = min(fits, key=lambda fit: fit[0])
    say(f"{mesh_file.stem}: pattern {1e3 * left_m:.1f} mm off the truth, mesh {1e3 * np.median(off):.1f} mm")
    placed = cKDTree(motion.apply(pattern * (mirror, 1.0)))
    places = {
        (name if own == panel else _swapped(name)): vertices[corner[placed.query(np.array(uv))[1]]]
        for name, uv in named.points_m.items()
    }
    seen = _seen(cell, places)
    return {"kind": named.kind, "places": places, "seen": seen}


def _swapped(name: str) -> str:
    for one, other in (("_left", "_right"), ("_right", "_left")):
        if name.endswith(one):
            return name.removesuffix(one) + other
    return name


def _seen(cell: Cell, places: dict[str, np.ndarray]) -> dict[str, bool]:
    """Return which places the panel of interest shows in any of 36 views."""
    nearest = dict.fromkeys(places, np.inf)
    for number, angle in enumerate(np.arange(0.0, 360.0, 10.0)):
        view = cell.look(float(angle), number)
        depth = view.depth_units.astype(np.float32) * np.float32(cell.depth_scale_m)
        points = back_project(depth, cell.intrinsics)[view.mask]
        if not len(points):
            continue
        tree = cKDTree(held_from_camera(cell.axis, float(angle)).apply(points.astype(float)))
        for name, place in places.items():
            nearest[name] = min(nearest[name], float(tree.query(place)[0]))
    return {name: off <= SEEN_M for name, off in nearest.items()}


def asked_points(truth: dict[str, Any], *, hidden: bool) -> tuple[str, ...]:
    """Return two named points that are visible by truth, or two that are not; a pair if there is one."""
    fits = {name for name, seen in truth["seen"].items() if seen != hidden}
    for pair in PAIRS:
        both = (f"{pair}_left", f"{pair}_right")
        if set(both) <= fits:
            return both
    some = sorted(fits)[:2]
    return tuple(some) if len(some) == 2 and truth["kind"] != "towel" else ()


def measured(
    mesh: Path, panel: int, start_deg: float, choice: str, truth: dict[str, Any], *, hidden: bool
) -> dict[str, Any] | None:
    """Return what one loop found, view by view; None if there are no such points."""
    names = asked_points(truth, hidden=hidden)
    if not names:
        return None
    seed = int(start_deg)
    request = request_of(mesh, panel, noise="d435", loose=PoseErrors(swing_m=0.002), seed=seed)
    cell = Cell(request, start_deg=start_deg)
    eye = functools.partial(view_of_cell, cell)
    goal = Goal(about="points", points=names, within_m=WITHIN_M)
    back = held_from_camera(cell.axis, start_deg).inverse()  # the object frame begins where the cell starts
    with tempfile.TemporaryDirectory() as folder:
        loop = LOOPS[choice](Path(folder) / "out", goal, Budget(views=VIEWS))
        views: list[dict[str, Any]] = []
        while isinstance(loop.asked, Next):
            angle = loop.asked.angle_deg
            view = eye(angle, loop.views)
            began_s = time.process_time()
            try:
                loop.take(view, loop.views)
            except Exception as error:  # noqa: BLE001 - a row says so
                views.append({"trouble": str(error)})
                break
            picks = {pick.name: pick for pick in garment_points(loop.known)}
            errors = {}
            for name in (each for each in names if each in picks):
                true = back.apply(truth["places"][name][None])[0]
                errors[name] = 1e3 * float(np.linalg.norm(picks[name].position_held_m - true))
            views.append(
                {
                    "angle_deg": angle,
                    "seconds": time.process_time() - began_s,
                    "area_cm2": 1e4 * loop.knowledge.area_m2,
                    "kind": loop.knowledge.kind,
                    "probability": loop.knowledge.probability,
                    "known": not loop.knowledge.missing(goal),
                    "errors_mm": {name: round(value, 1) for name, value in errors.items()},
                }
            )
        end = loop.asked
        loop.close()
    known = next((n for n, view in enumerate(views, start=1) if view.get("known")), None)
    return {
        "mesh": mesh.stem,
        "panel": panel,
        "start_deg": start_deg,
        "choice": choice,
        "hidden": hidden,
        "points": list(names),
        "true_kind": truth["kind"],
        "known_after": known,
        "errors_mm": views[known - 1]["errors_mm"] if known else {},
        "reached": isinstance(end, End) and end.reached,
        "reason": end.reason if isinstance(end, End) else "",
        "views": views,
    }


def figures(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the figures of all loops, by how they chose."""
    found: dict[str, Any] = {}
    for choice in CHOICES:
        loops = [row for row in rows if row["choice"] == choice and not row["hidden"]]
        if not loops:
            continue
        after = np.array([row["known_after"] or np.inf for row in loops])
        right = [max(row["errors_mm"].values()) <= 1e3 * TRULY_M for row in loops if row["known_after"]]
        kinds = [_kind_after(row) for row in loops]
        seconds = [view["seconds"] for row in loops for view in row["views"][2:] if "seconds" in view]
        found[choice] = {
            "loops": len(loops),
            "known_after_median": float(np.median(after)) if np.isfinite(np.median(after)) else None,
            "known_within_6": float((after <= 6).mean()),
            "known_within_12": float((after <= 12).mean()),
            "known_and_within_40_mm": float(np.mean(right)) if right else None,
            "said_cannot_be_known_wrongly": _said_unknowable(loops),
            "kind_after_median": float(np.median(kinds)) if np.isfinite(np.median(kinds)) else None,
            "wrong_kind_above_0.9": sum(_is_wrong(row) for row in loops),
            "seconds_a_view_median": float(np.median(seconds)) if seconds else None,
        }
    hidden = [row for row in rows if row["hidden"]]
    if hidden:
        found["hidden"] = {
            "loops": len(hidden),
            "said_cannot_be_known": _said_unknowable(hidden),
            "said_known": float(np.mean([row["known_after"] is not None for row in hidden])),
            "views_median": float(np.median([len(row["views"]) for row in hidden])),
        }
    return found


def _said_unknowable(rows: Sequence[dict[str, Any]]) -> float:
    return float(np.mean(["cannot be known" in row["reason"] for row in rows]))


def _sure_kinds(row: dict[str, Any]) -> list[tuple[int, str]]:
    """Return after which views a kind was surer than 0.9, and which."""
    numbered = enumerate(row["views"], start=1)
    return [(n, view["kind"]) for n, view in numbered if view.get("kind") and view["probability"] >= 0.9]


def _kind_after(row: dict[str, Any]) -> float:
    return next((n for n, _ in _sure_kinds(row)), np.inf)


def _is_wrong(row: dict[str, Any]) -> bool:
    return any(kind != row["true_kind"] for _, kind in _sure_kinds(row))
