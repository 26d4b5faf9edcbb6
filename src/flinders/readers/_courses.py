"""Speed and course over ground from a separate log, if an installed package of `flinders.apps` reads such logs."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from flinders.core.plugins import app_modules
from flinders.errors import UsageError

if TYPE_CHECKING:
    import os


def read_courses(path: str | os.PathLike[str]) -> Any:  # noqa: ANN401 - type of the package that reads it
    """Read a log of velocities over ground. The result has `source`, `words` and `velocity_on_clock`.

    Raises `UsageError` if no package reads such logs, and `InputError` if the file is not such a log.
    """
    for module in app_modules("COURSES").values():
        return import_module(module).read_courses(path)
    raise UsageError(
        "no installed package reads logs of course and speed over ground: give a recording that contains velocities"
    )
