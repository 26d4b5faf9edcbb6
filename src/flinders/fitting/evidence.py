"""Evidence of a fit: method, noise, coverage, residuals, and results of diagnostics.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> evidence = calibrate.fit(simulate.tumble(seed=1).samples).evidence
>>> evidence.method, evidence.samples, evidence.outliers, evidence.diagnosis.drift
('likelihood', 2922, (), None)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from flinders.core.short_repr import ShortRepr
from flinders.summary.coverage import Coverage

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.diagnostics.attitude_dependence import AttitudeDependence
    from flinders.diagnostics.axis_swap import AxisSwap
    from flinders.diagnostics.repeatability import Repeats
    from flinders.diagnostics.soft_iron import Refreshed
    from flinders.diagnostics.systematic import AxisLag, Drift, Nonlinearity
    from flinders.diagnostics.unmodelled import Unmodelled
    from flinders.estimators.outliers import Outlier
    from flinders.estimators.regressors import DisturbanceEstimate
    from flinders.fitting.aiding import Aiding

NOT_STATED: Final = "not stated"
"""Method of a calibration whose file does not state one, such as an imported calibration."""


@dataclass(frozen=True, slots=True, repr=False)
class Residuals(ShortRepr):
    """Statistics of the distances of readings from the ellipsoid."""

    #: count of independent readings that have as much information as the correlated readings in the fit
    independent_samples: float = math.inf
    autocorrelation: float | None = None  #: correlation of a residual with the next; None if not computed
    #: standard deviation of errors that depend on the direction and fit no ellipsoid, in the calibration's unit
    distortion: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Diagnosis(ShortRepr):
    """Results of diagnostics on a recording; None, or NaN, if a test was not made or found nothing."""

    drift: Drift | None = None  #: steady change over time within a single recording
    #: nonlinearity of the axes, for fits of 100 readings or more without disturbances. If it is proven, the claim's
    #: `structure_deg` includes its error, or the error that remains after linearization.
    nonlinearity: Nonlinearity | None = None
    axis_lag: AxisLag | None = None  #: delay of each axis, for fits of 100 readings or more without disturbances
    axis_swap: AxisSwap | None = None  #: axes that were swapped within the recording
    unmodelled: Unmodelled | None = None  #: recorded disturbance that changes the readings and that the fit ignores
    #: disturbance that depends on the attitude, by the accelerometer
    attitude_dependence: AttitudeDependence | None = None
    #: degrees: heading error from errors of the accelerometer's vertical, if the fit does not correct them; else NaN
    tilt_error_deg: float = math.nan
    #: comparison of several recordings with each other; the covariance includes their scatter
    repeats: Repeats | None = None
    #: changes since an earlier calibration, if the shape is that of this calibration, see `flinders.refresh`
    refreshed: Refreshed | None = None


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Disturbances(ShortRepr):
    """Disturbances that the offset follows."""

    #: statistics of each disturbance; empty if the offset follows none
    estimates: tuple[DisturbanceEstimate, ...] = ()
    #: (9 + K, 9 + K): covariance of the nine parameters of the claim's `covariance`, the offset per unit of each
    #: disturbance, and last the growth of the scale with the temperature; None if the offset follows no disturbance
    covariance: Floats | None = None
    #: standard deviation of distances from the best ellipsoid without disturbances, in the calibration's unit
    noise_uncompensated: float | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class Evidence(ShortRepr):
    """Method of a calibration, and properties of its readings."""

    method: str = NOT_STATED  #: method that gave the result; ``not stated`` if a file has only the calibration
    samples: int = 0  #: readings used; 0 if not stated
    #: standard deviation of the readings' distance from the ellipsoid, in the calibration's unit; NaN if not stated
    noise: float = math.nan
    #: directions that readings cover; a fit loaded from a file has no counts of readings in each direction
    coverage: Coverage = field(default_factory=Coverage)
    outliers: tuple[Outlier, ...] = ()  #: runs of rejected readings
    residuals: Residuals = field(default_factory=Residuals)  #: distances from the ellipsoid
    prior_influence: float = 0.0  #: share of the prior in the information on the least known shape parameter, 0 to 1
    #: count of directions of parameter space that only the prior determines, because the readings do not
    unobserved: int = 0
    #: False if an accelerometer shows that z does not point down, so that the dip of the site was not used. None if the
    #: dip of the site was used although the direction of z is neither measured nor stated. Else True.
    z_down: bool | None = True
    diagnosis: Diagnosis = field(default_factory=Diagnosis)  #: results of diagnostics on the recording
    disturbances: Disturbances = field(default_factory=Disturbances)  #: disturbances that the offset follows
    aiding: Aiding | None = None  #: results of other recorded sensors

    @property
    def is_described(self) -> bool:
        """Whether the method of the calibration is stated; an imported calibration states none."""
        return self.method != NOT_STATED
