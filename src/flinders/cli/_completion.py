"""What a shell completes after an option or as an argument: files, targets, methods.

>>> [item.value for item in targets(None, None, "px")]
['px4', 'px4-shell']
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from click.shell_completion import CompletionItem

if TYPE_CHECKING:
    from collections.abc import Iterable

    import click


def files(_context: click.Context | None, _option: click.Parameter | None, begun: str) -> list[CompletionItem]:
    """Let the shell complete names of files."""
    return [CompletionItem(begun, type="file")]


def targets(_context: click.Context | None, _option: click.Parameter | None, begun: str) -> list[CompletionItem]:
    """Names of targets."""
    from flinders.targets import registry

    return _matching(registry(), begun)


def methods(_context: click.Context | None, _option: click.Parameter | None, begun: str) -> list[CompletionItem]:
    """Names of methods."""
    from flinders.estimators import METHODS

    return _matching(("auto", *METHODS), begun)


def _matching(names: Iterable[str], begun: str) -> list[CompletionItem]:
    """Items of the names that begin so."""
    return [CompletionItem(name) for name in names if name.startswith(begun)]


BY_METAVAR: Final = {
    "FILE": files, "CALIBRATION": files, "LOG": files, "TRUTH": files, "SESSION": files, "TARGET": targets,
}  # fmt: skip
"""Completion of options by what their value is called in the help."""
