"""Ways of finding the ellipsoid, one file each.

What to use when
----------------
==============  =========  ==============================================================================
method          unknowns   when
==============  =========  ==============================================================================
auto            10         always, unless there is a reason not to
likelihood      10         to set the prior or switch off the bias correction
robust          12         strays are known to be there, however quiet
level           6          a level turn: the vehicle cannot be turned over
consistent      10         there are only sums: a stream, a fleet, a saved summary
li              10         parity with Magneto; something closed at any price
algebraic       10         parity with NXP, MATLAB and MotionCal
ellipsoid       10         constraints that are known to hold; parity with ellipsoid_fit and magcal
axes            7          unequal gains, no soft iron; few readings
sphere          5          a bare sensor; a base line
minmax          7          parity with the recipe of the tutorials; no algebra
two-step        7          parity with Gebre-Egziabher, Elkaim and Foster
alonso-shuster  10         TWOSTEP: the field's strength is known at each reading and varies
sequential      5          the same reading by reading: the offset, or all where the strength varies
ekf             10         how a Kalman filter on board would settle
ellipse         6          one plane, of any axis: uneven turns, arcs
two-axis        6          one plane, points equally spaced: parity with the ADIS recipe
==============  =========  ==============================================================================

Each file holds the formula, when to use it and when not, its source and an example. `METHODS` maps
names to classes.

>>> sorted(METHODS)
['algebraic', 'alonso-shuster', 'auto', 'axes', 'consistent', 'ekf', 'ellipse', 'ellipsoid', 'level', 'li', \
'likelihood', 'minmax', 'robust', 'sequential', 'sphere', 'two-axis', 'two-step']
"""

from __future__ import annotations

from typing import Final

from flinders.errors import UsageError
from flinders.estimators.algebraic import Algebraic, fit_error
from flinders.estimators.auto import Auto
from flinders.estimators.base import Estimate, Estimator
from flinders.estimators.bias_inflation import as_correlated, with_bias
from flinders.estimators.consistent import Consistent
from flinders.estimators.data import Readings
from flinders.estimators.ellipse import Ellipse
from flinders.estimators.level import Level
from flinders.estimators.likelihood import Likelihood
from flinders.estimators.outliers import strays_of
from flinders.estimators.reference.alonso_shuster import AlonsoShuster
from flinders.estimators.reference.attitude_independent import at_one_strength
from flinders.estimators.reference.axes import AxisAligned
from flinders.estimators.reference.ekf import Ekf
from flinders.estimators.reference.ellipsoid import Constrained
from flinders.estimators.reference.li import Li
from flinders.estimators.reference.minmax import MinMax
from flinders.estimators.reference.sequential import Sequential
from flinders.estimators.reference.sphere import Sphere
from flinders.estimators.reference.trace import Convergence
from flinders.estimators.reference.two_step import TwoStep
from flinders.estimators.robust import Robust
from flinders.estimators.saturation import within_range
from flinders.estimators.two_axis import TwoAxisRecipe

METHODS: Final[dict[str, type[Estimator]]] = {
    method.name: method
    for method in (
        Auto,
        Likelihood,
        Robust,
        Level,
        Consistent,
        Li,
        Algebraic,
        Constrained,
        AxisAligned,
        Sphere,
        MinMax,
        TwoStep,
        AlonsoShuster,
        Sequential,
        Ekf,
        Ellipse,
        TwoAxisRecipe,
    )
}
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


__all__ = [
    "EMULATED",
    "METHODS",
    "Algebraic",
    "AlonsoShuster",
    "Auto",
    "AxisAligned",
    "Consistent",
    "Constrained",
    "Convergence",
    "Ekf",
    "Ellipse",
    "Estimate",
    "Estimator",
    "Level",
    "Li",
    "Likelihood",
    "MinMax",
    "Readings",
    "Robust",
    "Sequential",
    "Sphere",
    "TwoAxisRecipe",
    "TwoStep",
    "as_correlated",
    "at_one_strength",
    "fit_error",
    "method_of",
    "strays_of",
    "with_bias",
    "within_range",
]
