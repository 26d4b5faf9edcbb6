"""Speed and course over ground from a log beside a recording, where a package of `flinders.apps` reads such logs."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from flinders.core.plugins import app_modules
from flinders.errors import UsageError

if TYPE_CHECKING:
    import os


def read_courses(path: str | os.PathLike[str]) -> Any:  # noqa: ANN401 - of the package that reads it
    """Read a log of velocities over ground, by the instruments of a vehicle: `source`, `words` and `by_clock`.

    Raises `UsageError` where no package reads such logs, `InputError` for what is none.
    """
    for module in app_modules("COURSES").values():
        return import_module(module).read_courses(path)
    raise UsageError("no package that reads logs of courses is installed: give a recording with a velocity of its own")
