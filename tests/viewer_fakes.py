"""A small integration of an exact cylinder, and an in-memory session folder: fast, no files, no noise.

View ``i`` sees the half of a cylinder that faces the camera; the flattened plane is its unrolled
side, so every place has a closed form: ``u = radius * angle about the axis``, ``v = height``.
"""

import tempfile
import threading
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from flatcloth.core.config import Config
from flatcloth.core.errors import GarmentError
from flatcloth.core.types import FlattenedView, Intrinsics, Progress, Rigid2, RotationAxis
from flatcloth.engine.placing import RefinedScore
from flatcloth.engine.views import ViewCloud
from flatcloth.methods.answers import AlignmentScore, Canonical
from flatcloth.session.document import Document, PlacedPart, Side
from flatcloth.session.header import read_header, state_folder
from flatcloth.session.journal import JOURNAL, Entry, Replay, read_journal
from flatcloth.session.machine import (
    Event,
    NothingMore,
    Proposed,
    Request,
    Started,
)
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.server.workspace import Opened

RADIUS_M = 0.15
HEIGHT_M = 0.30
CENTER_M = np.array([0.0, 0.0, 0.85])
PIXEL_M = 0.005
SEEN_DEG = 55.0


def _no_cameras(_document: Document) -> None:
    raise GarmentError("There are no frames, so nothing is said of a garment.")


@dataclass
class CylinderRecording:
    name: str = "cylinder"
    description: str = "an exact cylinder <b>not bold</b>"
    location: str = "memory"
    has_masks: bool = True
    is_growing: bool = False
    held_point_m: Any = None
    n_views: int = 12
    intrinsics: Intrinsics = field(
        default_factory=lambda: Intrinsics(width=480, height=640, fx=425.0, fy=425.0, cx=239.5, cy=319.5)
    )

    @property
    def angles_deg(self) -> tuple[float, ...]:
        return tuple(i * 360.0 / self.n_views for i in range(self.n_views))

    @property
    def rotation_axis(self) -> RotationAxis:
        return RotationAxis(point_m=CENTER_M, direction=np.array([0.0, -1.0, 0.0]))

    def __len__(self) -> int:
        return self.n_views


def point_on_cylinder(u_m, v_m):
    """Held-frame point and outward normal of a place on the plane; u = 0 faces the camera of view 0."""
    phi = np.asarray(u_m) / RADIUS_M
    normal = np.stack([np.sin(phi), np.zeros_like(phi), -np.cos(phi)], axis=-1)
    point = CENTER_M + RADIUS_M * normal
    point[..., 1] += np.asarray(v_m) - HEIGHT_M / 2
    return point, normal


def cylinder_view(views: dict[int, float]) -> FlattenedView:
    """The unrolled side as the given views (index to held-frame angle in degrees) see it together."""
    lows = [a - SEEN_DEG for a in views.values()]
    highs = [a + SEEN_DEG for a in views.values()]
    u = np.arange(np.radians(min(lows)) * RADIUS_M, np.radians(max(highs)) * RADIUS_M, PIXEL_M)
    v = np.arange(0.0, HEIGHT_M, PIXEL_M)
    uu, vv = np.meshgrid(u, v)
    xyz, normal = point_on_cylinder(uu, vv)
    z_angles = np.degrees(uu / RADIUS_M)[..., None] - np.array(list(views.values()))
    nearest = np.argmin(np.abs(z_angles), axis=-1)
    z_angle = np.take_along_axis(z_angles, nearest[..., None], axis=-1)[..., 0]
    index = np.array(list(views), dtype=np.int16)[nearest]
    rgb = np.zeros((*uu.shape, 3), dtype=np.uint8)
    rgb[..., 0] = np.where((np.floor(uu / 0.03) + np.floor(vv / 0.03)) % 2 == 0, 200, 60)
    rgb[..., 1:] = 120
    rows, cols = np.indices(uu.shape)
    return FlattenedView(
        rgb=rgb, xyz_m=xyz.astype(np.float32), normal=normal.astype(np.float32),
        z_angle_deg=z_angle.astype(np.float32), valid=np.abs(z_angle) <= SEEN_DEG, view_index=index,
        source_rc=np.stack([rows, cols], axis=-1).astype(np.float32), pixel_size_m=PIXEL_M,
        origin_uv_m=(float(u[0]), float(v[0])),
        quality=np.stack([400 * np.cos(np.radians(z_angle)), np.abs(z_angle), np.abs(uu) / 3], axis=-1)
        .astype(np.float32),
    )  # fmt: skip


class CylinderIntegration:
    """Answers at once, unless ``gate`` is cleared; ``error`` is raised by the next answer."""

    def __init__(self, scores: float = 0.8) -> None:
        self.views = self
        self.recording = CylinderRecording()
        self.config = Config()
        self.method = "paper"
        self.accept_score = self.config.alignment.accept_agreement
        self.axis = self.recording.rotation_axis
        self.finds_sides = False
        self.notes = ("No masks: <i>a note</i>.",)
        self.scores = scores
        self.also: tuple[PlacedPart, ...] = ()
        self.gate = threading.Event()
        self.gate.set()
        self.at_gate = threading.Event()
        self.error: Exception | None = None
        self.score_error: Exception | None = None
        self.reached = 0
        self._canonicals: dict[Any, Canonical] = {}
        self._overlays: dict[Any, FlattenedView] = {}
        self.is_unattended = False
        self.algorithm = SimpleNamespace(
            cameras=_no_cameras,
            poses=_no_cameras,
            joined_piece=lambda _document: None,
            joins_sides=False,
            why_unusable=lambda _view_index: "",
        )

    def _held_angle(self, view_index: int) -> float:
        # The item turns right-handed about up; in the object frame the camera goes the other way.
        return (-self.recording.angles_deg[view_index] + 180.0) % 360.0 - 180.0

    def cloud(self, view_index: int) -> ViewCloud:
        view = cylinder_view({view_index: self._held_angle(view_index)})
        of_interest = np.arange(view.valid.sum()) % 5 != 0
        return ViewCloud(
            xyz_m=view.xyz_m[view.valid],
            rgb=view.rgb[view.valid],
            of_interest=of_interest,
        )

    def part(self, view_index: int, _component: int) -> FlattenedView:
        return cylinder_view({view_index: self._held_angle(view_index)})

    def segment(self, _strokes: Any, _progress: Progress) -> None:
        """The recording has masks."""

    def canonical(self, document: Document) -> Canonical:
        key = (document.start_view, document.accepted)
        if key not in self._canonicals:
            assert document.start_view is not None
            views = [document.start_view, *(a.view_index for a in document.accepted)]
            self._canonicals[key] = Canonical(
                view=cylinder_view({i: self._held_angle(i) for i in views}),
                current_from_view={i: Rigid2() for i in views},
            )
        return self._canonicals[key]

    def cloth(self, _document: Document) -> None:
        """The paper's method does not know how its shape hangs together."""

    def laid_out(self, document: Document) -> Canonical:
        return self.canonical(document)

    def overlay(self, document: Document) -> FlattenedView:
        pending = document.pending
        if pending not in self._overlays:
            view = cylinder_view({pending.view_index: self._held_angle(pending.view_index)})
            at = pending.current_from_new
            u, v = view.origin_uv_m
            self._overlays[pending] = replace(view, origin_uv_m=(u + at.u_m, v + at.v_m))
        return self._overlays[pending]

    def score(self, document: Document) -> AlignmentScore:
        nudge = document.pending.nudge
        off_mm = 1000 * float(np.hypot(nudge.u_m, nudge.v_m))
        return AlignmentScore(
            total=max(0.0, self.scores - 0.01 * off_mm),
            parts={"height_rms_mm": off_mm, "overlap_cm2": 42.0},
            apart_mm=off_mm,
        )

    def refined_score(self, document: Document) -> RefinedScore:
        """Refinement takes back what the operator has moved, to a tenth of a millimetre."""
        self.reached += 1
        assert self.gate.wait(timeout=30), "the test never opened the gate"
        if self.score_error is not None:
            error, self.score_error = self.score_error, None
            raise error
        pending = document.pending
        assert pending is not None
        at_best = replace(document, pending=replace(pending, nudge=Rigid2()))
        refined = Rigid2(0.0, 0.0001, 0.0) @ pending.proposed if pending.moved else pending.proposed
        return RefinedScore(score=self.score(document), refined=refined, refined_score=self.score(at_best))

    def proposal(self, document: Document) -> Any:
        pending = document.pending
        found = SimpleNamespace(current_from_new=Rigid2(0.0, 0.003, 0.0))
        parts = (
            SimpleNamespace(component=0, area_m2=0.03, alignment=found),
            SimpleNamespace(component=1, area_m2=0.008, alignment=None),
        )
        best = SimpleNamespace(current_from_new=pending.proposed, score=SimpleNamespace(total=pending.score))
        return SimpleNamespace(parts=parts, change=None, alignment=best)

    def answer(self, document: Document, request: Request, progress: Progress) -> Event:
        progress(0.1, "working")
        self.at_gate.set()
        assert self.gate.wait(timeout=30), "the test never opened the gate"
        progress(0.5, "still working")
        if self.error is not None:
            error, self.error = self.error, None
            raise error
        if request.kind == "start":
            return Started(request.token, request.view_index or 0)
        view = request.view_index
        if view is None:
            left = [i for i in (1, 2, 3) if i not in document.used_views | document.refused_views]
            if not left:
                return NothingMore(request.token, "Nothing more to give.")
            view = left[0]
        return Proposed(request.token, view, Rigid2(), Side.LEFT, self.scores, also=self.also)


def new_session() -> SessionFolder:
    """A session of the cylinder, below the test's own folder."""
    place = state_folder()
    place.mkdir(parents=True, exist_ok=True)
    return SessionFolder.open(Path(tempfile.mkdtemp(dir=place)), CylinderRecording(), Config(), "paper")


def entries_of(folder: SessionFolder) -> list[Entry]:
    """What was recorded in a session, in order."""
    journal = folder.folder / JOURNAL
    lines = read_journal(journal, journal.read_bytes(), Replay.of(read_header(folder.folder)))
    return [line.entry for line, _ in lines]


def cylinder(*_: object) -> Opened:
    """The cylinder as the page opens it, whatever is asked for, with a new session."""
    folder = new_session()
    return Opened(CylinderIntegration(), folder, close=folder.close)  # type: ignore[arg-type]
