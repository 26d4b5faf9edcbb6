"""Methods that estimate the ellipsoid, one file each: formula, when to use it and when not, source and an example.

Each file of a method ends with a row, ``METHOD``, which registers the method: a new method needs only a new file.
`METHODS` maps names to classes; lists in docs and command line are made of the rows. The file of a method is imported
at its first use.

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
from flinders.estimators.data import Readings, remove_saturated
from flinders.estimators.outliers import outlier_runs
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

FIRST_METHODS: Final = (
    "auto", "likelihood", "robust", "level", "consistent", "li", "algebraic", "ellipsoid", "axes", "sphere", "minmax",
    "two-step", "alonso-shuster", "sequential", "ekf", "ellipse", "two-axis",
)  # fmt: skip
"""Methods at the beginning of lists, in the order in which to try them; others follow in alphabetical order."""


T = TypeVar("T")


@cache
def _modules() -> dict[str, str]:
    """Full names, by short name, of the modules of this package and of methods in other packages."""
    return modules_of(sys.modules[__name__], "METHODS")


@cache
def _row(name: str) -> Method | None:
    """Row of a method, from the end of its file; None if there is no such method."""
    module = _modules().get(name.replace("-", "_"))
    row: Method | None = getattr(import_module(module), "METHOD", None) if module else None
    return row if row and row.kind.name == name else None


@cache
def _names() -> tuple[str, ...]:
    """Names of all methods, in the order in which to try them."""
    names = {stem.replace("_", "-") for stem in _modules()}
    there = {name for name in names if _row(name)}
    listed = [name for name in FIRST_METHODS if name in there]
    return (*listed, *sorted(there.difference(listed)))


class _RowMapping(Mapping[str, T]):
    """Mapping from the names of methods to a part of their rows.

    Parameters
    ----------
    part : callable
        Returns the part of a row.
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


ROWS: Final[Mapping[str, Method]] = _RowMapping(lambda row: row)
"""Rows of all methods by name; a row states the use and the source of a method."""

METHODS: Final[Mapping[str, type[Estimator]]] = _RowMapping(lambda row: row.kind)
"""Classes of all methods by name, in the order in which to try them."""


def method_class(name: str) -> type[Estimator]:
    """Class of a method by its name.

    Raises `UsageError` for an unknown name. For the name of a program, such as ``magneto``, the error names the method
    with the numbers of that program.
    """
    if name not in METHODS:
        by_program = {program: known for known, row in ROWS.items() for program in row.programs}
        meant = did_you_mean(name, METHODS, by_other=by_program)
        raise UsageError(f"method {name!r} is not known{meant}: use one of {', '.join(METHODS)}")
    return METHODS[name]


def table() -> str:
    """Markdown table of all methods, as in docs/methods.md."""
    rows = [(f"`{name}`", str(row.kind.unknowns), row.use, row.source) for name, row in ROWS.items()]
    lines = "".join(f"| {' | '.join(cells)} |\n" for cells in rows)
    return f"| method | unknowns | when to use it | source |\n|---|---:|---|---|\n{lines}"


def __getattr__(name: str) -> Any:  # noqa: ANN401 - type checkers see the imports above
    """Class of a method by the name of the class, ``flinders.estimators.Likelihood``."""
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
    "method_class",
    "outlier_runs",
    "remove_saturated",
    "table",
]
