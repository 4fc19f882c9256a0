"""Small sessions to take away: an exact cylinder, integrated by a scripted operator, with picks."""

import contextlib
import json
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scenes import AXIS, CAMERA, Cylinder

from flatcloth.engine.integration import Integration
from flatcloth.export.garment import pick_at
from flatcloth.export.session import OpenedSession, open_session
from flatcloth.grasping.grasps import Grip, nearest_cloth
from flatcloth.grasping.grips import GripStore
from flatcloth.recordings import Recording, open_recording
from flatcloth.recordings.base import fingerprint
from flatcloth.recordings.writer import RecordingWriter
from flatcloth.session.header import HEADER
from flatcloth.session.machine import Accept, Command, Event, Propose, Reject, Start, Undo
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened

ANGLES_DEG = (0.0, 30.0, 60.0, 330.0)
NAME = "cylinder </script><b>&"
PICKS = ("middle", "edge <b>", "gone")


def write_cylinder(folder: Path, name: str = NAME, cut_rows: slice = slice(0)) -> Path:
    """Write the cylinder as a recording folder; of ``cut_rows`` of each image nothing is seen."""
    cylinder = Cylinder(angles_deg=ANGLES_DEG)
    with RecordingWriter(
        folder,
        name=name,
        description="a computed <i>cylinder</i>",
        intrinsics=CAMERA,
        depth_scale_m=0.0001,
        rotation_axis=AXIS,
        held_point_m=[0.0, -0.1, 0.85],
    ) as writer:
        for n, angle_deg in enumerate(ANGLES_DEG):
            frame = cylinder[n]
            frame.mask[cut_rows] = False
            writer.add(angle_deg, frame.color, np.rint(frame.depth_m * 10_000).astype(np.uint16), frame.mask)
    return folder


@dataclass
class Operator:
    """Decides, and lets the work be done at once."""

    integration: Integration
    folder: SessionFolder

    def do(self, command: Command | Event) -> None:
        self.folder.record(command)
        request = self.folder.state.request
        if request is not None:
            self.do(self.integration.answer(self.folder.state.document, request))

    @property
    def pending(self) -> int:
        pending = self.folder.state.document.pending
        return pending.view_index


_WRITTEN = tempfile.TemporaryDirectory(prefix="flatcloth-sessions-")
"""The sessions that were written, by the fingerprints of their recordings: each takes two seconds."""


def write_session(folder: Path, recording: Path) -> Path:
    """Integrate by hand: accepted, refused, taken back; with picks on the cloth, at its edge, and lost."""
    opened = open_recording(recording)
    kept = Path(_WRITTEN.name) / fingerprint(opened)
    if not kept.exists():
        _integrated_by_hand(kept, opened)
    shutil.copytree(kept, folder)
    header = json.loads((folder / HEADER).read_text())
    header["recording"]["location"] = opened.location
    (folder / HEADER).write_text(json.dumps(header, indent=1) + "\n")
    return folder


def _integrated_by_hand(folder: Path, opened: Recording) -> None:
    integration = Integration(opened, method="paper")
    session = SessionFolder.open(folder, opened, integration.config, "paper")
    try:
        operator = Operator(integration, session)
        operator.do(Start(0))
        operator.do(Propose(1))
        operator.do(Reject(operator.pending, "bad depth"))
        operator.do(Undo())
        operator.do(Accept(operator.pending))
        operator.do(Propose())
        operator.do(Accept(operator.pending))
        view = integration.canonical(session.state.document).view
        rows, cols = np.nonzero(view.valid)
        middle = np.array([rows.mean(), cols.mean()])
        edge = np.array([rows.mean(), cols[np.abs(rows - rows.mean()) < 1].max()])
        for name, rc in zip(PICKS, (middle, edge, middle), strict=True):
            uv = view.uv_from_rc(rc)
            pixel, _ = nearest_cloth(view, (float(uv[0]), float(uv[1])))
            pick = pick_at(view, pixel, 0, name)
            away = 0.05 * pick.normal_held if name == "gone" else 0.0
            session.add_pick(
                name, pick.position_held_m + away, pick.normal_held, pick.view_index, pick.source_rc
            )
        GripStore(folder).set(1, Grip(opening_m=0.06))
    finally:
        session.close()


def cylinder_session(folder: Path) -> OpenedSession:
    """Write recording and session into a folder, and open the session for export."""
    return open_session(write_session(folder / "session", write_cylinder(folder / "recording")))


@contextlib.contextmanager
def serving(session: Path, recording: Path, **options: Any) -> Iterator[PageServer]:
    """Serve a written session of a cylinder."""
    opened = open_recording(recording)
    integration = Integration(opened, method="paper")
    folder = SessionFolder.open(session, opened, integration.config, "paper")
    try:
        with PageServer(Opened(integration, folder, **options)) as running:
            yield running
    finally:
        folder.close()
