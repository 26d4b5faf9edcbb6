"""Mistyped keywords of public functions, answered with the one that is like them."""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Final, ParamSpec, TypeVar

from flinders.errors import UnknownParameter, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

NOWHERE: Final[Mapping[str, str]] = {}
OF_A_FIT: Final = dict.fromkeys(("method", "target_deg", "site", "disturbances", "aiding", "linearize"), "flinders.fit")
"""Parameters of the function that fits what others read."""
P = ParamSpec("P")
T = TypeVar("T")


def spell_checked(elsewhere: Mapping[str, str] = NOWHERE) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Answer a mistyped keyword of a function with an `UnknownParameter` that names the one that is like it.

    `elsewhere`: keywords that belong to another function, and which.

    >>> @spell_checked({"columns": "flinders.read"})
    ... def fit(*, target_deg: float) -> float:
    ...     return target_deg
    >>> fit(targt_deg=1.0)
    Traceback (most recent call last):
    flinders.errors.UnknownParameter: fit has no parameter 'targt_deg' (did you mean 'target_deg'?)
    """

    def checked(function: Callable[P, T]) -> Callable[P, T]:
        code = function.__code__
        known = frozenset(code.co_varnames[: code.co_argcount + code.co_kwonlyargcount])

        @wraps(function)
        def call(*values: P.args, **keywords: P.kwargs) -> T:
            for word in keywords.keys() - known:
                where = f": it is one of {elsewhere[word]}" if word in elsewhere else did_you_mean(word, known)
                raise UnknownParameter(f"{function.__qualname__} has no parameter {word!r}{where}")
            return function(*values, **keywords)

        return call

    return checked
