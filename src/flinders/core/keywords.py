"""Errors for mistyped keywords of public functions, with the most similar keyword."""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Final, ParamSpec, TypeVar

from flinders.errors import UnknownParameter, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

NO_KEYWORDS: Final[Mapping[str, str]] = {}
FIT_KEYWORDS: Final = dict.fromkeys(
    ("method", "target_deg", "site", "disturbances", "aiding", "linearize"), "flinders.fit"
)
"""Parameters of `flinders.fit` that are typed by mistake in a call of another function."""
P = ParamSpec("P")
T = TypeVar("T")


def check_keywords(elsewhere: Mapping[str, str] = NO_KEYWORDS) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Decorate a function to raise `UnknownParameter` for a mistyped keyword, with the most similar one.

    `elsewhere` maps keywords of other functions to the name of their function.

    >>> @check_keywords({"columns": "flinders.read"})
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
