"""Old spellings of public names, which work for one release and warn.

>>> import warnings
>>> @renamed_keywords(aids="aiding")
... def fit(aiding: str) -> str:
...     return aiding
>>> with warnings.catch_warnings(record=True, action="always") as caught:
...     fit(aids="rate")
'rate'
>>> print(caught[0].message)
fit() takes 'aiding' now: 'aids' goes with the next release
"""

from __future__ import annotations

import functools
import warnings
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

P = ParamSpec("P")
R = TypeVar("R")


def renamed_keywords(**new_names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Let a function take keywords by their old names too: ``old="new"``."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def call(*args: P.args, **given: P.kwargs) -> R:
            for old in new_names.keys() & given.keys():
                new = new_names[old]
                if new in given:
                    raise TypeError(f"{function.__name__}() got {new!r} and its old name {old!r}: give one")
                warn(f"{function.__name__}() takes {new!r} now: {old!r} goes with the next release")
                given[new] = given.pop(old)
            return function(*args, **given)

        return call

    return decorate


def renamed_attribute(old: str, new: str) -> property:
    """Give a class an attribute by its old name, to be read."""

    def read(owner: object) -> object:
        warn(f"{type(owner).__name__}.{old} is called {new!r} now: the old name goes with the next release")
        return getattr(owner, new)

    return property(read, doc=f"Old name of `{new}`.")


def warn(message: str) -> None:
    """Warn of an old name where it is used."""
    warnings.warn(message, DeprecationWarning, stacklevel=3)
