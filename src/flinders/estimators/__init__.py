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
==============  =========  ==============================================================================

Each file holds the formula, when to use it and when not, its source and an example. `METHODS` maps
names to classes.

>>> sorted(METHODS)
['algebraic', 'auto', 'axes', 'consistent', 'ellipsoid', 'level', 'li', 'likelihood', 'minmax', 'robust', 'sphere']
"""

from __future__ import annotations

from typing import Final

from flinders.estimators.algebraic import Algebraic, fit_error
from flinders.estimators.auto import Auto
from flinders.estimators.axis_aligned import AxisAligned
from flinders.estimators.bias import with_bias
from flinders.estimators.consistent import Consistent
from flinders.estimators.constrained import Constrained
from flinders.estimators.drift import drift_of
from flinders.estimators.estimate import Estimate, Estimator
from flinders.estimators.level import Level
from flinders.estimators.li import Li
from flinders.estimators.likelihood import Likelihood
from flinders.estimators.minmax import MinMax
from flinders.estimators.rails import within_range
from flinders.estimators.readings import Readings
from flinders.estimators.robust import Robust
from flinders.estimators.sphere import Sphere
from flinders.estimators.strays import strays_of

METHODS: Final[dict[str, type[Estimator]]] = {
    method.name: method
    for method in (Auto, Likelihood, Robust, Level, Consistent, Li, Algebraic, Constrained, AxisAligned, Sphere, MinMax)
}
"""Every method by name, the one to try first at the top."""

__all__ = [
    "METHODS",
    "Algebraic",
    "Auto",
    "AxisAligned",
    "Consistent",
    "Constrained",
    "Estimate",
    "Estimator",
    "Level",
    "Li",
    "Likelihood",
    "MinMax",
    "Readings",
    "Robust",
    "Sphere",
    "drift_of",
    "fit_error",
    "strays_of",
    "with_bias",
    "within_range",
]
