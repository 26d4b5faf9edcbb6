"""Ways of finding the ellipsoid, one file each: the formula, when to use it and when not, its source and an example.

Each file of a method ends with its row, ``METHOD``, by which it is found here: a new method is a new file of its name
and nothing else. `METHODS` maps names to classes, and the rows make the lists of docs and command line; a file is
imported when its method is asked for.

>>> METHODS["consistent"]()
Consistent()
>>> print(ROWS["consistent"].use)
general ellipsoid without bias from sums alone: streams, fleets, saved summaries
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, TypeVar

from flinders.core.plugins import modules_of
from flinders.errors import UsageError, did_you_mean
from flinders.estimators.algebraic import fit_error
from flinders.estimators.base import Estimate, Estimator, Method
from flinders.estimators.data import Readings, within_range
from flinders.estimators.outliers import outliers_of
from flinders.estimators.trace import Convergence

if TYPE_CHECKING:
    from flinders.estimators.algebraic import Algebraic as Algebraic
    from flinders.estimators.auto import Auto as Auto
    from flinders.estimators.consistent import Consistent as Consistent
    from flinders.estimators.ellipse import Ellipse as Ellipse
    from flinders.estimators.level import Level as Level
    from flinders.estimators.likelihood import Likelihood as Likelihood
    from flinders.estimators.minmax import MinMax as MinMax
    from flinders.estimators.robust import Robust as Robust

FIRST: Final = (
    "auto", "likelihood", "robust", "level", "consistent", "li", "algebraic", "ellipsoid", "axes", "sphere", "minmax",
    "two-step", "alonso-shuster", "sequential", "ekf", "ellipse", "two-axis",
)  # fmt: skip
"""Methods in the order in which they are listed, the one to try first at the top; all others come after them."""


T = TypeVar("T")


@cache
def _modules() -> dict[str, str]:
    """Full names of the modules of methods, and of others of this package, by their last part."""
    return modules_of(sys.modules[__name__], "METHODS")


@cache
def _row(name: str) -> Method | None:
    """The row at the end of the file of a method; None where there is no such method."""
    module = _modules().get(name.replace("-", "_"))
    row: Method | None = getattr(import_module(module), "METHOD", None) if module else None
    return row if row and row.kind.name == name else None


@cache
def _names() -> tuple[str, ...]:
    """All methods, the one to try first at the top."""
    names = {stem.replace("_", "-") for stem in _modules()}
    there = {name for name in names if _row(name)}
    listed = [name for name in FIRST if name in there]
    return (*listed, *sorted(there.difference(listed)))


class _ByName(Mapping[str, T]):
    """Something of each method, by its name.

    Parameters
    ----------
    part : callable
        What it is, of the row of a method.
    """

    def __init__(self, part: Callable[[Method], T]) -> None:
        self._part = part

    def __getitem__(self, name: str) -> T:
        row = _row(name)
        if row is None:
            raise KeyError(name)
        return self._part(row)

    def __iter__(self) -> Iterator[str]:
        return iter(_names())

    def __len__(self) -> int:
        return len(_names())


ROWS: Final[Mapping[str, Method]] = _ByName(lambda row: row)
"""What each method is for and whom it follows, by name."""

METHODS: Final[Mapping[str, type[Estimator]]] = _ByName(lambda row: row.kind)
"""Every method by name, the one to try first at the top."""


def method_of(name: str) -> type[Estimator]:
    """Look a method up.

    Raises `UsageError` for a name that does not exist.
    """
    if name not in METHODS:
        raise UsageError(f"method {name!r} is not known{did_you_mean(name, METHODS)}: use one of {', '.join(METHODS)}")
    return METHODS[name]


def table() -> str:
    """The methods as a Markdown table, as in docs/methods.md."""
    rows = [(f"`{name}`", str(row.kind.unknowns), row.use, row.source) for name, row in ROWS.items()]
    lines = "".join(f"| {' | '.join(cells)} |\n" for cells in rows)
    return f"| method | unknowns | when to use it | source |\n|---|---:|---|---|\n{lines}"


def __getattr__(name: str) -> Any:  # noqa: ANN401 - of which type checkers know those that are imported above
    """The class of a method by its own name, ``flinders.estimators.Likelihood``."""
    for kind in METHODS.values() if name[0].isupper() else ():
        if kind.__name__ == name:
            return kind
    known = [kind.__name__ for kind in METHODS.values()]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}{did_you_mean(name, known)}")


__all__ = [
    "METHODS",
    "ROWS",
    "Convergence",
    "Estimate",
    "Estimator",
    "Method",
    "Readings",
    "fit_error",
    "method_of",
    "outliers_of",
    "table",
    "within_range",
]
