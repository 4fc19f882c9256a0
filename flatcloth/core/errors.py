"""The errors that are reported to the user: one root class, one subclass for each stage.

Every message names the object (file, view, option), the cause and the remedy in one line.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator


class FlatclothError(Exception):
    """Root of all errors that are reported to the user as one line, without a traceback."""


class RecordingError(FlatclothError):
    """A recording cannot be read, or its content is not valid."""


class ConfigError(FlatclothError):
    """A setting is out of its range or unknown."""


class SurfaceError(FlatclothError):
    """A view shows no usable cloth surface."""


class FlatteningError(FlatclothError):
    """A surface cannot be flattened."""


class AlignmentError(FlatclothError):
    """Two flattened views cannot be aligned."""


class IllegalDecisionError(FlatclothError):
    """A decision that the session does not allow in its present state; the message gives the reason."""


class OutOfBoundsError(IllegalDecisionError):
    """A decision with a number that no garment has."""


class JournalError(FlatclothError):
    """A session folder cannot be written or read, or belongs to another recording."""


class SegmentationError(FlatclothError):
    """The views do not show the item or its side of interest, or a stroke is not valid."""


class SynthesisError(FlatclothError):
    """A recording cannot be synthesized from a mesh."""


class EvaluationError(FlatclothError):
    """A result cannot be compared with the truth."""


class GarmentError(FlatclothError):
    """A shape has too little cloth to recognise a garment, or its file cannot be read."""


class ServerError(FlatclothError):
    """The page cannot be served (busy port, unknown host)."""


class CancelledError(Exception):
    """The operator cancelled the computation; not a failure."""


@contextlib.contextmanager
def os_errors_as(kind: type[FlatclothError], what: str, remedy: str) -> Iterator[None]:
    """Raise an ``OSError`` of the context as ``kind``: ``what`` (cause). ``remedy``."""
    try:
        yield
    except OSError as error:
        raise kind(f"{what} ({error.strerror or error}). {remedy}") from error
