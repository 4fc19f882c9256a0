"""Opening a session for export: its history, and the results computed from its recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flatcloth.core.errors import ConfigError, JournalError, RecordingError
from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import FlattenedView, Float64, Progress, no_progress
from flatcloth.engine.outcome import has_other_side
from flatcloth.engine.sheet import Sheet, lay_out, sheet_of
from flatcloth.export.data import SessionData
from flatcloth.export.growth import Growth, Kept, colors_of, grow, key_of
from flatcloth.export.history import SessionHistory, read_history
from flatcloth.grasping.grasps import LOST_AT_M, GraspPose, grasp_pose, pixel_of_point
from flatcloth.methods.answers import ColumnCurves, JoinedSides
from flatcloth.recordings import SourceOptions, open_recording
from flatcloth.recordings.base import fingerprint
from flatcloth.session.document import Document
from flatcloth.session.header import HEADER
from flatcloth.session.journal import Pick, SheetSide

if TYPE_CHECKING:
    from flatcloth.engine.integration import Integration


@dataclass(frozen=True, kw_only=True)
class ViewNumbers:
    """Numbers of a flattened view: its energies (m2) level by level, and h(u) and A_z(u) at its rotation."""

    energies_m2: tuple[Float64, ...]
    curves: ColumnCurves


@dataclass(frozen=True, eq=False)
class OpenedSession:
    """A session for export; data are computed on first use.

    ``progress`` is called with the progress of the work; ``kept`` is shared with other exports of it;
    ``numbers`` are those of :meth:`numbers_of`; the rest is as in :class:`.data.SessionData`.
    """

    history: SessionHistory
    integration: Integration
    progress: Progress = no_progress
    kept: Kept = field(default_factory=Kept)
    numbers: dict[int, ViewNumbers] = field(default_factory=dict)
    rotation_deg: float | None = None
    base_from_camera: Rigid3 | None = None

    @cached_property
    def growth(self) -> Growth:
        """The shape and its growth."""
        return grow(self.integration, self.history, self.progress, self.kept)

    @cached_property
    def has_both(self) -> bool:
        """Whether the session has the other side: its page or an unattended run computed it, or uses it."""
        begun, picks = self.history.begun, self.history.picks
        used = begun.garment.seams or any(pick.side == "other" for pick in picks)
        return self.kept.both() or bool(used) or has_other_side(self.history.folder)

    def view_of(self, side: SheetSide) -> FlattenedView | None:
        """Return the cloth of a side, floating pieces included; None if it is not known."""
        if side == "this":
            return self.growth.view
        sides = self.data.sides
        return lay_out(sides.other).view if isinstance(sides, JoinedSides) else None

    def pose_of(self, pick: Pick) -> GraspPose | None:
        """Return the grasp pose of a pick or named point; None if its side or its normal is not known."""
        view = self.view_of(pick.side)
        if view is None:
            return None
        # Named points have numbers of their own, and no grips.
        grip = self.history.grips.get(pick.id) if pick in self.history.picks else None
        return grasp_pose(view, pick.position_held_m, pick.normal_held, self.integration.axis, grip)

    def pixel_of(self, pick: Pick) -> tuple[int, int] | None:
        """Return the pixel of a pick on its side; None if it does not lie on the cloth."""
        view = self.view_of(pick.side)
        if view is None:
            return None
        rc, distance_m = pixel_of_point(view, pick.position_held_m)
        return rc if distance_m <= LOST_AT_M else None

    @property
    def view(self) -> FlattenedView:
        """The shape, without its growth.

        Raises
        ------
        FlatclothError
            If nothing is flattened yet.
        """
        return self.integration.canonical(self.history.begun).view

    def sheet_of(self, document: Document) -> Sheet:
        """Return the shape of a document of the past with its colors, without its measurements."""
        sheet: Sheet = self.kept.values.get(
            ("sheet", key_of(self.integration.axis, document)),
            lambda: colors_of(sheet_of(self.integration.canonical(document), document)),
        )
        return sheet

    def numbers_of(self, view_index: int) -> ViewNumbers:
        """Return numbers of a view's own flattened view."""
        from flatcloth.methods.paper.planning import column_curves

        if view_index not in self.numbers:
            integration, flattening = self.integration, self.integration.views.flattening(view_index)
            angle_deg = integration.recording.angles_deg[view_index]
            limit_deg = integration.config.planning.z_angle_limit_deg
            self.numbers[view_index] = ViewNumbers(
                energies_m2=tuple(np.array(level.energy) for level in flattening.levels),
                curves=column_curves(flattening.view, integration.axis, angle_deg, limit_deg),
            )
        return self.numbers[view_index]

    @cached_property
    def data(self) -> SessionData:
        """The data files."""
        history, garments = self.history, self.kept.garments_of(self.integration)
        return SessionData(
            self.integration,
            history.begun,
            history.picks,
            history.grips,
            garments,
            (lambda document: garments.joined(document, self.progress)) if self.has_both else None,
            rotation_deg=self.rotation_deg,
            base_from_camera=self.base_from_camera,
        )


def open_session(
    folder: Path,
    recording: Path | None = None,
    progress: Progress = no_progress,
    *,
    options: SourceOptions | None = None,
) -> OpenedSession:
    """Open a session folder for export, without locking or changing it.

    Parameters
    ----------
    folder : Path
        The session folder.
    recording : Path, optional
        Present location of its recording; by default that of the session.
    progress : callable
        Called with the progress of the work.
    options : SourceOptions, optional
        Options to open the recording with; by default those that the session was started with.

    Raises
    ------
    JournalError
        If the folder is not a session, is damaged, or belongs to another recording.
    RecordingError
        If the recording is missing; the message explains how to give its path.
    ConfigError
        If the session uses a method that this version does not have.
    """
    from flatcloth.engine.integration import Integration
    from flatcloth.engine.segmenting import prepare

    history = read_history(folder)
    header, about = history.header, history.header.recording
    place = about.location if recording is None else str(recording)
    if options in (None, SourceOptions()):
        options = SourceOptions.from_dict(about.options, f"{folder / HEADER}")
    try:
        opened = open_recording(place, options)
    except RecordingError as error:
        if recording is not None:
            raise
        raise RecordingError(
            f"{folder}: its recording {about.name!r} cannot be opened ({error})"
            " Give its present location with --recording."
        ) from error
    if fingerprint(opened) != about.fingerprint:
        raise JournalError(
            f"{folder}: the session belongs to another recording ({about.name!r}) than {place}."
            " Give the right one with --recording."
        )
    try:
        integration = Integration(opened, header.effective_config, header.method, prepare)
    except ConfigError as error:
        raise ConfigError(f"{folder / 'session.json'}: {error}") from error
    return OpenedSession(history, integration, progress)
