"""Commands that are imported when they are called, so that none waits for the others."""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import click


class Commands(MutableMapping[str, "click.Command"]):
    """Commands by name, each the ``command`` of a module of its own beside this one.

    Parameters
    ----------
    modules : str
        ``two_axis`` holds ``two-axis``; a name that Python keeps for itself ends with an underscore.

    Examples
    --------
    >>> commands = Commands("info", "import_", "two_axis")
    >>> list(commands), commands["two-axis"].name
    (['info', 'import', 'two-axis'], 'two-axis')
    """

    def __init__(self, *modules: str) -> None:
        self._modules = {module.rstrip("_").replace("_", "-"): module for module in modules}
        self._loaded: dict[str, click.Command] = {}

    def __getitem__(self, name: str) -> click.Command:
        if name not in self._loaded:
            found: click.Command = import_module(f"flinders.cli.{self._modules[name]}").command
            self._loaded[name] = found
        return self._loaded[name]

    def __contains__(self, name: object) -> bool:
        return name in self._modules

    def __iter__(self) -> Iterator[str]:
        return iter(self._modules)

    def __len__(self) -> int:
        return len(self._modules)

    def __setitem__(self, name: str, command: click.Command) -> None:
        self._modules[name], self._loaded[name] = name, command

    def __delitem__(self, name: str) -> None:
        del self._modules[name]
        self._loaded.pop(name, None)
