"""Evidence of a fit: its method, noise and coverage of its readings, residuals, and results of diagnostics.

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

    independent_samples: float = math.inf  #: count of independent readings with the information of the used, correlated
    #: ones
    autocorrelation: float | None = None  #: correlation of a residual with the next; None if not computed
    #: standard deviation of errors that depend on the direction and fit no ellipsoid, in the calibration's unit
    distortion: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Diagnosis(ShortRepr):
    """Results of diagnostics on a recording; None, or NaN, if a test was not made or found nothing."""

    drift: Drift | None = None  #: change over time, of a single recording that is long enough
    #: of the axes, for fits of 100 uncompensated readings or more. If proven, the claim's `structure_deg` includes its
    #: error, or the error that the linearization of the calibration leaves.
    nonlinearity: Nonlinearity | None = None
    axis_lag: AxisLag | None = None  #: delay of each axis, for the same fits
    axis_swap: AxisSwap | None = None  #: if the readings show that axes were swapped in mid-recording
    unmodelled: Unmodelled | None = None  #: a recorded disturbance that changes the readings and is not followed
    #: a disturbance that depends on the attitude, by the accelerometer
    attitude_dependence: AttitudeDependence | None = None
    #: heading error from the tilt by the accelerometer, if one was recorded at rest and no fit corrects it; else NaN
    tilt_error_deg: float = math.nan
    repeats: Repeats | None = None  #: several recordings, compared with each other; their scatter is in the covariance
    refreshed: Refreshed | None = None  #: if the shape is that of an earlier calibration, see `flinders.refresh`


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Disturbances(ShortRepr):
    """Disturbances that the offset follows."""

    estimates: tuple[DisturbanceEstimate, ...] = ()  #: one for each disturbance; empty if the offset follows nothing
    #: (9 + K, 9 + K): of the nine parameters of the claim's `covariance`, the offset per unit of each disturbance, and
    #: last the change of the scale; None if the offset follows nothing
    covariance: Floats | None = None
    noise_uncompensated: float | None = None  #: noise of the best ellipsoid without disturbances


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class Evidence(ShortRepr):
    """Method of a calibration, and properties of its readings."""

    method: str = NOT_STATED  #: method that gave the result; ``not stated`` if a file has only the calibration
    samples: int = 0  #: readings used; 0 if not stated
    #: standard deviation of the readings' distance from the ellipsoid, in the calibration's unit; NaN if not stated
    noise: float = math.nan
    #: directions that readings cover. A loaded fit has only the numbers, not the count of readings in each direction.
    coverage: Coverage = field(default_factory=Coverage)
    outliers: tuple[Outlier, ...] = ()  #: runs of rejected readings
    residuals: Residuals = field(default_factory=Residuals)  #: distances from the ellipsoid
    prior_influence: float = 0.0  #: share of the prior in the information on the least known shape parameter, 0 to 1
    unobserved: int = 0  #: directions of parameter space that the readings do not determine, so that the prior fixes
    #: them False if an accelerometer shows that z does not point down, so that the dip of the site was not used; None
    #: if that dip was used and the direction of z is neither measured nor stated
    z_down: bool | None = True
    diagnosis: Diagnosis = field(default_factory=Diagnosis)  #: changes and disturbances of the readings
    disturbances: Disturbances = field(default_factory=Disturbances)  #: disturbances that the offset follows
    aiding: Aiding | None = None  #: results of other recorded sensors

    @property
    def is_described(self) -> bool:
        """Whether the method of the calibration is stated; an imported calibration states none."""
        return self.method != NOT_STATED
