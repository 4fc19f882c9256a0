"""flatcloth: integrate turned RGB-D views of a hanging garment into its canonical shape.

The method is that of Kita & Kita, "Integration of Multiple RGB-D Data of a Deformed Clothing
Item into Its Canonical Shape"; the word paper in the docstrings of this package means that article.

The public names are listed in ``__all__`` and described in docs/api.md. They are loaded when they are first
used, so that ``import flatcloth`` itself takes a few milliseconds.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flatcloth.api.integrating import flatten as flatten
    from flatcloth.api.integrating import integrate as integrate
    from flatcloth.api.integrating import integration_of as integration_of
    from flatcloth.api.integrating import open_session as open_session
    from flatcloth.api.shape import Shape as Shape
    from flatcloth.checking.check import check_recording as check_recording
    from flatcloth.checking.findings import Check as Check
    from flatcloth.checking.findings import Finding as Finding
    from flatcloth.core.config import Config as Config
    from flatcloth.core.errors import CancelledError as CancelledError
    from flatcloth.core.errors import FlatclothError as FlatclothError
    from flatcloth.core.errors import GarmentError as GarmentError
    from flatcloth.core.errors import RecordingError as RecordingError
    from flatcloth.core.geometry import Rigid3 as Rigid3
    from flatcloth.core.strokes import ImageStroke as ImageStroke
    from flatcloth.core.strokes import SpaceStroke as SpaceStroke
    from flatcloth.core.types import FlattenedView as FlattenedView
    from flatcloth.core.types import Intrinsics as Intrinsics
    from flatcloth.core.types import RgbdFrame as RgbdFrame
    from flatcloth.core.types import RotationAxis as RotationAxis
    from flatcloth.engine.headless import ViewDecision as ViewDecision
    from flatcloth.engine.integration import Integration as Integration
    from flatcloth.export.data import read_shape as read_shape
    from flatcloth.flattening.flatten import Flattening as Flattening
    from flatcloth.garments.recognition import Recognition as Recognition
    from flatcloth.grasping.grasps import GraspPose as GraspPose
    from flatcloth.grasping.hand_eye import read_hand_eye as read_hand_eye
    from flatcloth.methods.registry import method_names as method_names
    from flatcloth.recordings import Recording as Recording
    from flatcloth.recordings import SourceOptions as SourceOptions
    from flatcloth.recordings import open_recording as open_recording
    from flatcloth.recordings.arrays import recording_from_arrays as recording_from_arrays
    from flatcloth.recordings.mending import Mends as Mends
    from flatcloth.recordings.mending import mended as mended
    from flatcloth.recordings.writer import copy_recording as copy_recording

__version__ = "0.1.0"

_HOMES = {
    "flatcloth.api.integrating": ("flatten", "integrate", "integration_of", "open_session"),
    "flatcloth.api.shape": ("Shape",),
    "flatcloth.checking.check": ("check_recording",),
    "flatcloth.checking.findings": ("Check", "Finding"),
    "flatcloth.core.config": ("Config",),
    "flatcloth.core.errors": ("CancelledError", "FlatclothError", "GarmentError", "RecordingError"),
    "flatcloth.core.geometry": ("Rigid3",),
    "flatcloth.core.strokes": ("ImageStroke", "SpaceStroke"),
    "flatcloth.core.types": ("FlattenedView", "Intrinsics", "RgbdFrame", "RotationAxis"),
    "flatcloth.engine.headless": ("ViewDecision",),
    "flatcloth.engine.integration": ("Integration",),
    "flatcloth.export.data": ("read_shape",),
    "flatcloth.flattening.flatten": ("Flattening",),
    "flatcloth.garments.recognition": ("Recognition",),
    "flatcloth.grasping.grasps": ("GraspPose",),
    "flatcloth.grasping.hand_eye": ("read_hand_eye",),
    "flatcloth.methods.registry": ("method_names",),
    "flatcloth.recordings": ("Recording", "SourceOptions", "open_recording"),
    "flatcloth.recordings.arrays": ("recording_from_arrays",),
    "flatcloth.recordings.writer": ("copy_recording",),
    "flatcloth.recordings.mending": ("Mends", "mended"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = ["__version__", *_HOME_OF]


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'flatcloth' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
