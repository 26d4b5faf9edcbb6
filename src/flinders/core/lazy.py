"""Public names of a package that are imported at their first use, which keeps the import of the package fast."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING

from flinders.errors import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


def lazy_getattr(package: str, homes: Mapping[str, str]) -> Callable[[str], object]:
    """Make the ``__getattr__`` of a package from its public names and the submodule that defines each.

    `dir` lists these names, unless the package has its own ``__dir__``. If the submodule has the same name as the
    public name, the submodule itself is returned.

    >>> lazy_getattr("flinders", {"Unit": "core.units", "units": "core.units"})("Unit").__name__
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
