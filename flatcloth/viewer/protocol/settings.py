"""The settings of the page, few in number, saved with the session in ``settings.json``.

They are defined in one table, from which the dialog is made. The parameters of the method are shown next to
them; a session keeps those that it was started with, because every decision depends on them.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

from msgspec import structs
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.routing import Route

from flatcloth.core import config as numbers
from flatcloth.core.config import Config
from flatcloth.core.decoding import decoded, fitted
from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.core.plain_files import read_plain, replace_file
from flatcloth.viewer.protocol.state import Choice, SettingsTable, Slider, Switch

FILE = "settings.json"
FORMAT = "flatcloth-settings/1"


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The operator's settings; ``SETTINGS`` describes each."""

    auto_threshold: float = 0.75
    auto_until: Literal["all", "area", "views"] = "all"
    auto_least_cm2: float = 50.0
    auto_views: float = 14.0
    advance: bool = True
    follow: bool = True
    turn_to_pick: bool = True
    step_mm: float = 2.0
    step_deg: float = 1.0
    show_view: bool = True
    show_shape: bool = True
    show_new: bool = True
    show_all: bool = False
    show_axis: bool = True
    show_camera: bool = True


@dataclass(frozen=True, kw_only=True)
class _File(Settings):
    """The settings as they are saved."""

    format: Literal["flatcloth-settings/1"]


SETTINGS: tuple[Switch | Choice | Slider, ...] = (
    Switch(
        name="advance",
        title="Continue after a verdict",
        description="After Accept, Reject or Skip, propose the next view.",
    ),
    Slider(
        name="auto_threshold",
        title="Auto accepts from",
        description="Auto accepts a proposal with at least this score, and waits for you below it.",
        low=0.0,
        high=1.0,
        step=0.05,
    ),
    Choice(
        name="auto_until",
        title="Auto runs until",
        description="When Auto proposes no further view.",
        options=(("all", "no view adds cloth"), ("area", "a view adds little"), ("views", "this many views")),
    ),
    Slider(
        name="auto_least_cm2",
        title="Little, cm²",
        description='With "a view adds little": the least area that the next view must be expected to add.',
        low=1.0,
        high=5000.0,
        step=1.0,
    ),
    Slider(
        name="auto_views",
        title="This many views",
        description='With "this many views": those of the shape, the start view among them.',
        low=1.0,
        high=10000.0,
        step=1.0,
    ),
    Slider(
        name="step_mm",
        title="Arrow key, mm",
        description="Step of the arrow keys for the proposal; tenfold with Shift.",
        low=0.1,
        high=50.0,
        step=0.1,
    ),
    Slider(
        name="step_deg",
        title="Bracket key, °",
        description="Step of [ and ] for the proposal; tenfold with Shift.",
        low=0.05,
        high=45.0,
        step=0.05,
    ),
    Switch(
        name="follow",
        title="3D camera follows",
        description="The 3D camera takes the real camera's position of the shown view.",
    ),
    Switch(
        name="turn_to_pick",
        title="Turn the item to a pick",
        description="A pick that faces away from the 3D camera is looked at from where it was seen."
        " Off: its mark shows through the cloth.",
    ),
    Switch(name="show_view", title="Present view", description="The points of the present view, in 3D."),
    Switch(name="show_shape", title="Shape so far", description="The points of the shape, in 3D."),
    Switch(
        name="show_new", title="What the proposal adds", description="The points that it would add, in 3D."
    ),
    Switch(
        name="show_all",
        title="All views",
        description="The points of all views of the recording, in 3D, also of those that are not used.",
    ),
    Switch(name="show_axis", title="Turning axis", description="The axis that the item is turned about."),
    Switch(name="show_camera", title="Camera", description="Where the camera stood at the present view."),
)
"""Their values, and the defaults, are those of :class:`Settings`."""


class SettingsStore:
    """The settings of a session; ``folder`` None keeps them in memory only. Used by one thread.

    Raises
    ------
    FlatclothError
        If the existing file is damaged.
    """

    def __init__(self, folder: Path | None, defaults: Settings) -> None:
        self._path = None if folder is None else folder / FILE
        self.defaults = defaults
        self.now = defaults if self._path is None else _read(self._path, defaults)

    def change(self, **values: float | bool | str) -> None:
        """Change settings and save them.

        Raises
        ------
        FlatclothError
            If a value is out of its range, or the file cannot be written.
        """
        for setting in SETTINGS:
            check(setting, values.get(setting.name))
        self._keep(dataclasses.replace(self.now, **values))  # type: ignore[arg-type]

    def reset(self) -> None:
        """Reset all settings to their defaults.

        Raises
        ------
        FlatclothError
            If the file cannot be written.
        """
        self._keep(self.defaults)

    def table(self) -> SettingsTable:
        """Return the table for the page, with values and defaults."""
        now, first = dataclasses.asdict(self.now), dataclasses.asdict(self.defaults)
        rows: dict[str, Any] = {
            s.name: structs.replace(s, value=now[s.name], default=first[s.name]) for s in SETTINGS
        }
        return SettingsTable(**rows)

    def _keep(self, settings: Settings) -> None:
        if self._path is not None:
            content = {"format": FORMAT, **dataclasses.asdict(settings)}
            with os_errors_as(
                FlatclothError, f"{self._path}: cannot be written", "Nothing was set. Free disk space."
            ):
                replace_file(self._path, json.dumps(content, indent=1).encode() + b"\n")
        self.now = settings


def check(setting: Switch | Choice | Slider, value: float | bool | str | None) -> None:
    """Raise if a value is out of its range.

    Raises
    ------
    FlatclothError
        The message gives the range.
    """
    if not isinstance(setting, Slider) or value is None or isinstance(value, str):
        return
    low, high = setting.low, setting.high
    if not low <= value <= high:
        raise FlatclothError(f"{setting.title}: between {low:g} and {high:g}, not {value:g}.")


def _read(path: Path, defaults: Settings) -> Settings:
    try:
        kept = fitted({**dataclasses.asdict(defaults), **decoded(read_plain(path), dict[str, Any])}, _File)
        values = {setting.name: getattr(kept, setting.name) for setting in SETTINGS}
        for setting in SETTINGS:
            check(setting, values[setting.name])
        return Settings(**values)
    except FileNotFoundError:
        return defaults
    except OSError as error:
        raise FlatclothError(f"{path}: cannot be read ({error.strerror}). Check its permissions.") from error
    except (ValueError, FlatclothError) as error:
        raise FlatclothError(f"{path}: is damaged ({error}). Delete it to restore the defaults.") from error


def method_numbers(config: Config) -> list[dict[str, Any]]:
    """Return the parameters of the method for the page, by section: name, value, default, meaning."""
    now, first = config.to_dict(), Config().to_dict()
    meanings = _meanings(numbers)
    classes = {field.name: type(getattr(config, field.name)).__name__ for field in dataclasses.fields(config)}
    return [
        {
            "section": section,
            "values": [
                {
                    "name": name,
                    "value": value,
                    "default": first[section][name],
                    "about": meanings.get((classes[section], name), ""),
                }
                for name, value in values.items()
            ],
        }
        for section, values in now.items()
    ]


def numbers_route(config: Config) -> Route:
    """Return the route to the parameters of the method."""
    numbers = method_numbers(config)

    async def answer(_: Request) -> JSONResponse:
        return JSONResponse(numbers)

    return Route("/settings/numbers.json", answer)


@cache
def _meanings(module: ModuleType) -> Mapping[tuple[str, str], str]:
    """Read the docstring below each field of the configuration."""
    found = {}
    for section in ast.parse(inspect.getsource(module)).body:
        if not isinstance(section, ast.ClassDef):
            continue
        for field, text in zip(section.body, section.body[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                match text:
                    case ast.Expr(value=ast.Constant(value=str(words))):
                        found[section.name, field.target.id] = " ".join(words.split())
    return found
