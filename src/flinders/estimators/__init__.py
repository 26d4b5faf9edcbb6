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
forgetting      10         a stream whose offset wanders: old readings fade
ladder          40         parity with firmware of NXP's and Freescale's, and when it takes what
sar-ls          5          field and gyro, the offset alone: parity with Troni and Whitcomb
sar-kf          5          the same by a Kalman filter
px4-observer    5          field and gyro: what PX4's online observer would learn
magyc-ls        13         field and gyro, offset and soft iron: parity with MAGYC's differentiated form
ellipse         6          one plane, of any axis: uneven turns, arcs
two-axis        6          one plane, points equally spaced: parity with the ADIS recipe
==============  =========  ==============================================================================

Each file holds the formula, when to use it and when not, its source and an example. `METHODS` maps
names to classes.

>>> sorted(METHODS)
['algebraic', 'alonso-shuster', 'auto', 'axes', 'consistent', 'ekf', 'ellipse', 'ellipsoid', 'forgetting', \
'ladder', 'level', 'li', 'likelihood', 'magyc-ls', 'minmax', 'px4-observer', 'robust', 'sar-kf', 'sar-ls', \
'sequential', 'sphere', 'two-axis', 'two-step']
"""

from __future__ import annotations

from typing import Final

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
from flinders.estimators.reference.forgetting import Forgetting
from flinders.estimators.reference.ladder import Ladder
from flinders.estimators.reference.li import Li
from flinders.estimators.reference.magyc_ls import MagycLs
from flinders.estimators.reference.minmax import MinMax
from flinders.estimators.reference.px4_observer import Px4Observer
from flinders.estimators.reference.sar_kf import SarKf
from flinders.estimators.reference.sar_ls import SarLs
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
        Forgetting,
        Ladder,
        SarLs,
        SarKf,
        Px4Observer,
        MagycLs,
    )
}
"""Every method by name, the one to try first at the top."""

__all__ = [
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
    "Forgetting",
    "Ladder",
    "Level",
    "Li",
    "Likelihood",
    "MagycLs",
    "MinMax",
    "Px4Observer",
    "Readings",
    "Robust",
    "SarKf",
    "SarLs",
    "Sequential",
    "Sphere",
    "TwoAxisRecipe",
    "TwoStep",
    "as_correlated",
    "at_one_strength",
    "fit_error",
    "strays_of",
    "with_bias",
    "within_range",
]
