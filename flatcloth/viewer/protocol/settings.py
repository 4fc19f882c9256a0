"""The settings of the page, few in number, saved with the session in ``settings.json``.

They are declared once, with titles and ranges, from which the dialog is made. The parameters of the method
are not among them: a session keeps those that it was started with, in its ``session.json``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, structs

from flatcloth.core.decoding import MisfitError, fitted
from flatcloth.core.errors import FlatclothError
from flatcloth.session.kept import read_kept, write_kept
from flatcloth.viewer.protocol import Sent, table

FILE = "settings.json"
FORMAT = "flatcloth-settings/1"
_REMEDY = "Delete it to restore the defaults."


class Settings(Sent, frozen=True):
    """The operator's settings, in the order of their dialog, which :data:`_DIALOG` describes."""

    advance: bool = True
    auto_threshold: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.75
    auto_until: Literal["all", "views"] = "all"
    auto_views: Annotated[float, Meta(ge=1.0, le=10000.0)] = 14.0
    step_mm: Annotated[float, Meta(ge=0.1, le=50.0)] = 2.0
    step_deg: Annotated[float, Meta(ge=0.05, le=45.0)] = 1.0
    follow: bool = True
    show_view: bool = True
    show_shape: bool = True
    show_new: bool = True
    show_all: bool = False
    show_axis: bool = True
    show_camera: bool = True


_DIALOG = """
advance | Continue after a verdict | After Accept, Reject or Skip, propose the next view.
auto_threshold | Auto accepts from a score of | Below it, Auto waits for you.
auto_until | Auto runs until | When Auto proposes no further view.
auto_views | Number of views | Auto ends when the shape has so many, the start view among them.
step_mm | Arrow keys move by, mm | A key moves the proposal so far; tenfold with Shift.
step_deg | [ and ] turn by, ° | A key turns the proposal so far; tenfold with Shift.
follow | 3D camera follows | The 3D camera takes the real camera's position of the shown view.
show_view | Present view | The points of the present view, in 3D.
show_shape | Shape so far | The points of the shape, in 3D.
show_new | What the proposal adds | The points that it would add, in 3D.
show_all | All views | The points of all views of the recording, in 3D, also of those that are not used.
show_axis | Turning axis | The axis that the item is turned about.
show_camera | Camera | Where the camera stood at the present view.
"""
_STEPS = {
    "auto_threshold": 0.05, "auto_views": 1.0, "step_mm": 0.1, "step_deg": 0.05,
}  # fmt: skip
_OPTIONS = {"auto_until": {"all": "no view adds cloth", "views": "a number of views"}}


class Setting(Sent, frozen=True):
    """What the dialog shows of a setting; ``options`` are values and words, numbers have a range."""

    name: str
    title: str
    description: str
    default: bool | float | str
    low: float | None = None
    high: float | None = None
    step: float | None = None
    options: dict[str, str] = msgspec.field(default_factory=dict)


def _rows(defaults: Settings) -> Iterator[Setting]:
    for field, (name, title, description) in zip(structs.fields(Settings), table(_DIALOG), strict=True):
        (limits,) = getattr(field.type, "__metadata__", (Meta(),))
        yield Setting(
            name=name,
            title=title,
            description=description,
            default=getattr(defaults, field.name),
            low=limits.ge,
            high=limits.le,
            step=_STEPS.get(name),
            options=_OPTIONS.get(name, {}),
        )


class SettingsStore:
    """The settings of a session. Used by one thread.

    Raises
    ------
    FlatclothError
        If the existing file is damaged.
    """

    def __init__(self, folder: Path, defaults: Settings) -> None:
        self._path = folder / FILE
        self.defaults = defaults
        self.rows = tuple(_rows(defaults))
        self.now = self._read()

    def change(self, values: Mapping[str, Any], *, reset: bool = False) -> None:
        """Change settings, after a reset to their defaults if that is wanted, and save them.

        Raises
        ------
        FlatclothError
            If a value is of another type or out of its range, or the file cannot be written.
        """
        settings = self._with(values, self.defaults if reset else self.now)
        write_kept(self._path, {"format": FORMAT, **structs.asdict(settings)})
        self.now = settings

    def _with(self, values: Mapping[str, Any], before: Settings) -> Settings:
        try:
            return fitted({**structs.asdict(before), **values}, Settings)
        except MisfitError as error:
            titles = {row.name: row.title for row in self.rows}
            name = titles.get(error.where, error.where)
            raise FlatclothError(f"{name}: {error.found} cannot be set.") from error

    def _read(self) -> Settings:
        kept = read_kept(self._path, dict[str, Any], _REMEDY)
        if kept is None:
            return self.defaults
        try:
            if kept.pop("format", None) != FORMAT:
                raise FlatclothError(f"its format is not {FORMAT}")
            return self._with({k: v for k, v in kept.items() if hasattr(self.defaults, k)}, self.defaults)
        except FlatclothError as error:
            raise FlatclothError(f"{self._path}: damaged ({error}). {_REMEDY}") from error
