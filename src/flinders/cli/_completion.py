"""Shell completion of file names, targets and methods.

>>> [item.value for item in complete_targets(None, None, "mic")]
['micropython']
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, TypeAlias

from click.shell_completion import CompletionItem

if TYPE_CHECKING:
    from collections.abc import Iterable

    import click


Completion: TypeAlias = list[CompletionItem]
"""Candidates for the word that is being typed."""


def complete_files(_context: click.Context | None, _option: click.Parameter | None, begun: str) -> Completion:
    """Complete a file name, which the shell does itself."""
    return [CompletionItem(begun, type="file")]


def complete_targets(_context: click.Context | None, _option: click.Parameter | None, begun: str) -> Completion:
    """Complete the name of a target.

    >>> [item.value for item in complete_targets(None, None, "c-")]
    ['c-q15', 'c-q31', 'c-axes']
    """
    from flinders.targets import registry

    return _matching(registry(), begun)


def complete_methods(_context: click.Context | None, _option: click.Parameter | None, begun: str) -> Completion:
    """Complete the name of a method."""
    from flinders.estimators import METHODS

    return _matching(("auto", *METHODS), begun)


def _matching(names: Iterable[str], begun: str) -> Completion:
    """Names that start with the typed letters, `begun`."""
    return [CompletionItem(name) for name in names if name.startswith(begun)]


BY_METAVAR: Final = {
    **dict.fromkeys(("FILE", "CALIBRATION", "LOG", "TRUTH", "SESSION"), complete_files),
    "TARGET": complete_targets,
}
"""Completion functions of options, by the metavar of the option."""
