"""Flattening and integration, from a recording to its shape."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from flatcloth.api.shape import Shape
from flatcloth.core.config import Config
from flatcloth.core.errors import CancelledError
from flatcloth.core.strokes import Decision
from flatcloth.core.types import Progress, no_progress
from flatcloth.engine.garment import GarmentService, place_sure_pieces
from flatcloth.engine.headless import Run, ViewDecision
from flatcloth.engine.integration import Integration
from flatcloth.engine.segmenting import prepare, take_strokes
from flatcloth.engine.sheet import sheet_of
from flatcloth.export.data import SessionData
from flatcloth.flattening.flatten import Flattening
from flatcloth.grasping.grips import read_grips
from flatcloth.methods.registry import method_name
from flatcloth.recordings.base import Recording, check_index
from flatcloth.session.header import kept_config
from flatcloth.session.kept import keep_summary
from flatcloth.session.machine import MemorySession, SessionState
from flatcloth.session.store import Keeper, SessionFolder

PathLike = str | os.PathLike[str]
Sides = Literal["one", "both"]


def integration_of(
    recording: Recording, method: str | None = None, config: Config | None = None
) -> Integration:
    """Return what computes the views, proposals and shapes of a recording, for an operator or a program.

    Without masks, the side of interest is found from the views.

    Raises
    ------
    ConfigError
        If the method is unknown.
    """
    return Integration(recording, config, method, segmenter=prepare)


def flatten(
    recording: Recording,
    view_index: int,
    *,
    method: str | None = None,
    config: Config | None = None,
    progress: Progress | None = None,
) -> Flattening:
    """Flatten one view of a recording (paper, section 3), as the integration does.

    Parameters
    ----------
    recording : Recording
        Its axis and masks are used; those that it lacks are found from its views, which takes seconds.
    view_index : int
        The view.
    method : str, optional
        ``robust`` (default) or ``paper``.
    config : Config, optional
        The settings; by default those of the method.
    progress : callable, optional
        Called with a share (0 to 1) and a text.

    Returns
    -------
    Flattening
        ``view`` is the flattened view; ``components`` are all connected components, the largest first.

    Raises
    ------
    IndexError
        If there is no such view.
    SurfaceError, FlatteningError, SegmentationError
        If the view shows too little cloth, or its side of interest cannot be found.
    """
    check_index(recording, view_index)
    integration = integration_of(recording, method, config)
    integration.views.segment((), progress or no_progress)
    return integration.views.flattening(view_index)


def integrate(
    recording: Recording,
    *,
    method: str | None = None,
    config: Config | None = None,
    session: PathLike | None = None,
    strokes: Sequence[Decision] = (),
    progress: Progress | None = None,
    cancel: Callable[[], bool] | None = None,
    on_view: Callable[[ViewDecision, Shape], None] | None = None,
    cores: int | None = None,
    sides: Sides = "one",
) -> Shape:
    """Integrate the views of a recording without an operator.

    Parameters
    ----------
    recording : Recording
        Of a source (``open_recording``) or of arrays (``recording_from_arrays``).
    method : str, optional
        ``robust`` (default) or ``paper``.
    config : Config, optional
        The settings; by default those of the session, or of the method fitted to the camera.
    session : path, optional
        Folder in which each decision is saved when it is made. A session that is there is continued; the
        operator page and :func:`open_session` open it. Without it nothing is written.
    strokes : sequence of ImageStroke or SpaceStroke
        An operator's strokes about the side of interest, for a recording without masks.
    progress : callable, optional
        Called with a share (0 to 1) and a text.
    cancel : callable, optional
        Asked often, e.g. ``threading.Event().is_set``; the integration stops when it returns True.
    on_view : callable, optional
        Called after the start view and after each decision about a proposed view, with the decision and the
        shape so far; its arrays are computed when they are first read.
    cores : int, optional
        Cores to use, by default all that this process may use; the result does not depend on it.
    sides : str
        ``one`` (default), or ``both``: the other side is integrated too and joined to this one along the
        seams (:attr:`Shape.other`), with the method ``robust``.

    Raises
    ------
    FlatclothError
        If nothing can be flattened, the session belongs to another recording, or cannot be written.
    CancelledError
        If ``cancel`` returned True.
    """
    folder, told = None if session is None else Path(session), progress or no_progress
    name = method_name(method)
    if config is None and folder is not None:
        config = kept_config(folder, name)

    def watched(share: float, text: str) -> None:
        if cancel is not None and cancel():
            raise CancelledError("The integration was cancelled.")
        told(share, text)

    seconds: dict[str, float] = {}
    with contextlib.ExitStack() as stack:
        with timed(seconds, "opening"):
            integration = integration_of(recording, name, config)
            keeper: Keeper = MemorySession(SessionState(len(recording)))
            if folder is not None:
                keeper = SessionFolder.open(folder, recording, integration.config, name)
                stack.callback(keeper.close)
            take_strokes(integration.views, keeper, strokes)
        joins = sides == "both" and integration.algorithm.joins_sides
        service = GarmentService(integration)
        run = Run(integration, keeper)
        if (show := on_view) is not None:
            run.on_view = lambda decision: show(
                decision, Shape(replace(_data(service, keeper), is_growing=True))
            )
        with timed(seconds, "integrating"):
            document = run.finish(watched, cores or len(os.sched_getaffinity(0))).document
            integration.canonical(document)
        if joins:  # first, as the garment is recognised by the edges of both sides
            with timed(seconds, "other side"):
                service.joined(document, watched)
        with timed(seconds, "garment"):
            watched(1.0, "recognising the garment")
            place_sure_pieces(service, keeper)
            if isinstance(keeper, SessionFolder):  # lists tell how far the session is
                document = keeper.state.document
                sheet, known = sheet_of(integration.canonical(document), document), service.known(document)
                kind = "" if isinstance(known, str) else known.kind
                keep_summary(keeper.folder, document, sheet.shape_m2, sheet.floating_m2, kind)
        data = replace(_data(service, keeper), both=service.joined if joins else None)
    return Shape(data, tuple(run.decisions), seconds)


def open_session(
    folder: PathLike, *, recording: PathLike | None = None, progress: Progress | None = None
) -> Shape:
    """Return the shape of a session folder, of ``integrate``, ``flatcloth run`` or the operator page.

    It is computed from the recording and the decisions when something is asked of it. The folder is neither
    locked nor changed.

    Parameters
    ----------
    folder : path
        The session folder.
    recording : path, optional
        Present location of its recording, if it was moved.
    progress : callable, optional
        Called with a share (0 to 1) and a text.

    Raises
    ------
    JournalError
        If the folder is not a session, is damaged, or belongs to another recording.
    RecordingError
        If the recording is missing.
    """
    from flatcloth.export.session import open_session as opened

    place = None if recording is None else Path(recording)
    return Shape(opened(Path(folder), place, progress or no_progress).data)


def _data(service: GarmentService, keeper: Keeper) -> SessionData:
    document, integration = keeper.state.document, service.integration
    if isinstance(keeper, MemorySession):
        return SessionData(integration, document, garments=service)
    return SessionData(integration, document, keeper.picks, read_grips(keeper.folder), service)


@contextlib.contextmanager
def timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    """Add the wall time of the context to that of a name."""
    started = time.perf_counter()
    try:
        yield
    finally:
        seconds[name] = seconds.get(name, 0.0) + time.perf_counter() - started
