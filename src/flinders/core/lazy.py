"""Public names of a package, looked up when they are first used, so that importing it costs next to nothing."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING

from flinders.errors import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


def attributes(package: str, homes: Mapping[str, str]) -> Callable[[str], object]:
    """Make the ``__getattr__`` of a package, by public names and the module below it that each lives in.

    They are what `dir` lists of it, unless it has a ``__dir__`` of its own.

    A module of the name that is asked for is the thing itself.

    >>> attributes("flinders", {"Unit": "core.units", "units": "core.units"})("Unit").__name__
    'Unit'
    """

    def attribute(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}{did_you_mean(name, homes)}")
        home = homes[name]
        module = import_module(f"{package}.{home}")
        found: object = module if home.rpartition(".")[2] == name else getattr(module, name)
        vars(sys.modules[package])[name] = found  # looked up once
        return found

    vars(sys.modules[package]).setdefault("__dir__", lambda: sorted(homes))
    return attribute
