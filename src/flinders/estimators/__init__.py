"""Ways of finding the ellipsoid, one file each: the formula, when to use it and when not, its source and an example.

Each file of a method ends with its row, ``METHOD``, by which it is found here: a new method is a new file and nothing
else. `METHODS` maps names to classes, and the rows make the lists of docs and command line.

>>> METHODS["consistent"]()
Consistent()
>>> print(ROWS["consistent"].use)
general ellipsoid without bias from sums alone: streams, fleets, saved summaries
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import walk_packages
from textwrap import indent
from typing import Any, Final

from flinders.errors import UsageError
from flinders.estimators.algebraic import fit_error
from flinders.estimators.base import Estimate, Estimator, Method, as_correlated, with_bias
from flinders.estimators.data import Readings, within_range
from flinders.estimators.outliers import outliers_of
from flinders.estimators.reference.attitude_independent import at_one_strength
from flinders.estimators.reference.trace import Convergence

FIRST: Final = (
    "auto", "likelihood", "robust", "level", "consistent", "li", "algebraic", "ellipsoid", "axes", "sphere", "minmax",
    "two-step", "alonso-shuster", "sequential", "ekf", "ellipse", "two-axis",
)  # fmt: skip
"""Methods in the order in which they are listed, the one to try first at the top; all others come after them."""


def _found() -> dict[str, Method]:
    """The row of each file that has one, by the name of its method."""
    modules = (import_module(module.name) for module in walk_packages(__path__, f"{__name__}."))
    rows = {row.kind.name: row for module in modules if (row := getattr(module, "METHOD", None))}
    listed = [name for name in FIRST if name in rows]
    return {name: rows[name] for name in (*listed, *sorted(rows.keys() - listed))}


ROWS: Final = _found()
"""What each method is for and whom it follows, by name."""

METHODS: Final[dict[str, type[Estimator]]] = {name: row.kind for name, row in ROWS.items()}
"""Every method by name, the one to try first at the top."""

EMULATED: Final[dict[str, str]] = {
    "ladder": "'auto', or 'algebraic' with normalisation='nxp'",
    "forgetting": "'consistent' on the latest readings",
    "sar-ls": "'auto' with the aiding sensor 'rate'",
    "sar-kf": "'auto' with the aiding sensor 'rate'",
    "px4-observer": "'auto' with the aiding sensor 'rate'",
    "magyc-ls": "'auto' with the aiding sensor 'rate'",
}
"""Algorithms of other projects that were methods once, and what to use instead."""


def method_of(name: str) -> type[Estimator]:
    """Look a method up.

    Raises
    ------
    UsageError
        For a name that does not exist.
    """
    if name in EMULATED:
        raise UsageError(
            f"method {name!r} is another project's algorithm: use {EMULATED[name]}; its emulation is in "
            "benchmarks/emulations of the source repository"
        )
    if name not in METHODS:
        raise UsageError(f"method {name!r} is not known: use one of {', '.join(METHODS)}")
    return METHODS[name]


def table() -> str:
    """The methods as a Markdown table, as in docs/methods.md."""
    rows = [(f"`{name}`", str(row.kind.unknowns), row.use, row.source) for name, row in ROWS.items()]
    lines = "".join(f"| {' | '.join(cells)} |\n" for cells in rows)
    return f"| method | unknowns | when to use it | source |\n|---|---:|---|---|\n{lines}"


def __getattr__(name: str) -> Any:  # noqa: ANN401
    """The class of a method by its own name: ``flinders.estimators.Likelihood``."""
    for kind in METHODS.values():
        if kind.__name__ == name:
            return kind
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__doc__ = f"{__doc__}\n::\n\n{indent(table(), '    ')}"

__all__ = [
    "EMULATED",
    "METHODS",
    "ROWS",
    "Convergence",
    "Estimate",
    "Estimator",
    "Method",
    "Readings",
    "as_correlated",
    "at_one_strength",
    "fit_error",
    "method_of",
    "outliers_of",
    "table",
    "with_bias",
    "within_range",
]
