"""Auto: the default method, which chooses by the readings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.core.samples import Samples
from flinders.errors import FitError, NeedsSamples
from flinders.estimators.base import Method, check_prior
from flinders.estimators.data import Readings
from flinders.estimators.likelihood import Likelihood, estimate_from_record, fit_record
from flinders.estimators.robust import Robust
from flinders.likelihood import prior
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.native.layouts import Records


@dataclass(frozen=True, slots=True)
class Auto:
    """Likelihood from a consistent start; robust if residuals show outliers; consistent if there are only sums.

    Minimises the cost of `Likelihood` over all readings, or over the inliers as `Robust`. For a level turn it is
    `Level`; for a nearly level one, the method that claims the smaller level heading error.

    Use it unless there is a reason not to. The estimate names the method that gave it.

    Parameters
    ----------
    prior : float, optional
        See `Likelihood`; a level turn is fitted only with a prior. For sums the prior is not used: `Consistent` leaves
        unobserved parameters free, as None does.
    robust : bool
        Reject outliers regardless of the residuals.
    dip_deg : float
        Inclination of the field at the site in degrees; only `Level` uses it.

    Examples
    --------
    >>> import numpy as np
    >>> from flinders.estimators.data import Readings
    >>> directions = np.random.default_rng(1).normal(size=(200, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> field = directions * [45, 50, 55] + [20, 120, 90]
    >>> field += np.random.default_rng(2).normal(size=field.shape)
    >>> readings = Readings.of(field)
    >>> Auto().estimate(readings).method, Auto().estimate(Readings(readings.summary)).method
    ('likelihood', 'consistent')
    >>> field[:20] += 100.0                                # something magnetic passes
    >>> Auto().estimate(Readings.of(field)).method
    'robust'
    """

    prior: float | None = prior.SOFT_IRON_SPREAD
    robust: bool = False
    dip_deg: float = 60.0

    name: ClassVar[str] = "auto"
    unknowns: ClassVar[int] = 10
    is_biased: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse an invalid prior."""
        check_prior(self.prior)

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises
        ------
        TooFewSamples, OutOfScale, StuckAxis, Unmoved, NotAnEllipsoid, Undetermined
            As the chosen method.
        NeedsSamples
            If only sums were given, and `robust` or a prior other than the default, which need readings.
        """
        if readings.recording is None and not self.robust:
            return self._from_sums(readings)
        readings = readings.for_fit()
        record = self.fit_record(readings)
        if not record["plane"]:
            method = Robust if self.robust else Likelihood
            readings.require(method.unknowns, method.name)
        return estimate_from_record(record, readings, has_statistics=True)

    def fit_record(self, readings: Readings, *, statistics: int = 1) -> Records:
        """Record of the engine for the fit of `estimate`, of readings in memory."""
        robust, level = 2 if self.robust else 1, level_option(readings)
        return fit_record(readings, self.prior, robust=robust, level=level, dip_deg=self.dip_deg, statistics=statistics)

    def _from_sums(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid to the sums alone."""
        if self.prior not in (None, prior.SOFT_IRON_SPREAD):
            raise NeedsSamples(f"{self.name} with a prior of {self.prior:g}")
        from flinders.estimators.consistent import Consistent

        return Consistent().estimate(readings)


def level_option(readings: Readings) -> int:
    """Option ``level`` of the engine by an accelerometer: 0 for no level turn, 2 for a level turn, 1 if not known."""
    recording = readings.recording
    if not isinstance(recording, Samples) or recording.acceleration is None:
        return 1
    return engine().levelness(recording.acceleration)


def fit_alone(field: Floats) -> Estimate | None:
    """Estimate of `Auto` from (N, 3) readings of one sensor, without NaN; None if the fit fails."""
    try:
        return Auto().estimate(Readings.of(field[np.isfinite(field).all(axis=1)]))
    except FitError:
        return None


METHOD: Final = Method(
    Auto,
    use="the default: likelihood, robust if residuals show outliers, or consistent if there are only sums",
    source="the likelihood, after `robust` if residuals show outliers",
)
