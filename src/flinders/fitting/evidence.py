"""What the readings of a fit showed: how they were fitted, their noise and coverage, and what diagnostics found.

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
"""Method of a calibration of which the file says nothing, as of one that was imported."""


@dataclass(frozen=True, slots=True, repr=False)
class Residuals(ShortRepr):
    """What the distances of the readings from the ellipsoid tell."""

    independent_samples: float = math.inf  #: independent readings that say as much as those used, which are correlated
    autocorrelation: float | None = None  #: correlation of a residual with the next; None where nobody looked
    #: standard deviation of what belongs to the direction and no ellipsoid takes off, in the calibration's unit
    distortion: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Diagnosis(ShortRepr):
    """What diagnostics found in a recording; None, or NaN, where nobody looked or nothing was found."""

    drift: Drift | None = None  #: where the recording is one and long enough
    #: of the axes, where the fit is one of a hundred readings or more as they were recorded. Where it is proven, the
    #: claim's `structure_deg` has it, or what the linearization of the calibration leaves of it.
    nonlinearity: Nonlinearity | None = None
    axis_lag: AxisLag | None = None  #: how late each axis is read, likewise
    axis_swap: AxisSwap | None = None  #: where the readings tell that axes slipped in mid-recording
    unmodelled: Unmodelled | None = None  #: a disturbance that was recorded, moves the readings, and is not followed
    #: a disturbance that follows the attitude, as an accelerometer shows
    attitude_dependence: AttitudeDependence | None = None
    #: what the tilt by an accelerometer adds to a heading, where one was recorded at rest and nothing corrects it; else
    #: not a number
    tilt_error_deg: float = math.nan
    repeats: Repeats | None = None  #: several recordings, compared with each other; their scatter is in the covariance
    refreshed: Refreshed | None = None  #: where the shape is that of an earlier calibration, see `flinders.refresh`


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Disturbances(ShortRepr):
    """What the offset was asked to follow."""

    estimates: tuple[DisturbanceEstimate, ...] = ()  #: one for each; none where it follows nothing
    #: (9 + K, 9 + K): of the nine of the claim's `covariance` and the offset per unit of each disturbance, with the
    #: growth of the scale last; None where it follows nothing
    covariance: Floats | None = None
    noise_uncompensated: float | None = None  #: noise of the best ellipsoid that follows nothing


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class Evidence(ShortRepr):
    """How a calibration was found, and what its readings showed."""

    method: str = NOT_STATED  #: what was run in the end; ``not stated`` where a file says nothing but the calibration
    samples: int = 0  #: readings used; 0 if not stated
    #: standard deviation of the readings' distance from the ellipsoid, in the calibration's unit; NaN if not stated
    noise: float = math.nan
    #: directions seen. Of a loaded fit only its numbers are known, not the readings of each direction.
    coverage: Coverage = field(default_factory=Coverage)
    outliers: tuple[Outlier, ...] = ()  #: runs of readings that were rejected
    residuals: Residuals = field(default_factory=Residuals)  #: what they say of the readings and of the sensor
    prior_influence: float = 0.0  #: share of the least known shape parameter that the prior speaks for, 0 to 1
    unobserved: int = 0  #: directions of parameter space of which the readings say nothing; the prior holds them
    #: False where an accelerometer shows that z points elsewhere, so that the dip of the site was left out; None where
    #: that dip was used and neither an accelerometer nor anybody says which way z points
    z_down: bool | None = True
    diagnosis: Diagnosis = field(default_factory=Diagnosis)  #: what changes or disturbs the readings
    disturbances: Disturbances = field(default_factory=Disturbances)  #: what the offset was asked to follow
    aiding: Aiding | None = None  #: what was recorded beside the magnetometer and helped

    @property
    def is_described(self) -> bool:
        """Whether it says how the calibration was found; an imported calibration does not."""
        return self.method != NOT_STATED
