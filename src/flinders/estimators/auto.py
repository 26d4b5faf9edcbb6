"""Auto: the best that can be had from what is given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.errors import FitError, NeedsSamples
from flinders.estimators.base import Method, check_prior
from flinders.estimators.data import Readings
from flinders.estimators.level import Level, is_level
from flinders.estimators.likelihood import ENOUGH, Likelihood, estimated, recorded
from flinders.estimators.robust import Robust
from flinders.geometry.ellipsoid import symmetric
from flinders.heading.error_propagation import level_error
from flinders.likelihood import prior
from flinders.native.engine import engine
from flinders.summary.summary import NEARLY_FLAT_NOISE

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.native.engine import Records

FEWEST_LEFT: Final = 20
"""Readings that have to be left of those with outliers to see whether the rest is flat."""

THICK: Final = np.inf
"""Noise for which all readings are flat that can be a level turn at all."""

MUCH_BETTER: Final = 5.0
"""Times smaller a claim that takes readings for a level turn which stand out of their plane by more than noise."""


MAX_TILTED_SHARE: Final = 0.2
"""Of the readings: where more are off the plane of a level turn, the body was tilted."""


@dataclass(frozen=True, slots=True)
class Auto:
    """Likelihood from a consistent start; robust where residuals ask for it; consistent where there are only sums.

    Minimises what `Likelihood` minimises, over all readings or, as `Robust`, over those that belong together; of a
    level turn, what `Level` does, and of one that is nearly level whichever claims the smaller level heading error.

    Use it unless there is a reason not to. The estimate names what was run.

    Parameters
    ----------
    prior : float, optional
        See `Likelihood`; without one a level turn is not fitted either. Sums go without: `Consistent` leaves what
        was not seen free, as None asks for.
    robust : bool
        Look for outliers whether or not the residuals ask for it.
    dip_deg : float
        Inclination of the field at the site; it matters only to `Level`.

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

    prior: float | None = prior.SPREAD
    robust: bool = False
    dip_deg: float = 60.0

    name: ClassVar[str] = "auto"
    unknowns: ClassVar[int] = 10
    is_biased: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse a prior that means nothing."""
        check_prior(self.prior)

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises
        ------
        TooFewSamples, OutOfScale, StuckAxis, Unmoved, NotAnEllipsoid, Undetermined
            As the method that is run.
        NeedsSamples
            If only sums were given, and `robust` or a prior of its own was asked for: neither works on sums.
        """
        if readings.recording is None and not self.robust:
            return self._from_sums(readings)
        readings = readings.fitted()
        level = Level(self.prior, self.dip_deg) if self.prior is not None and _can_be_level(readings) else None
        if level is not None and is_level(readings.summary.moments.covariance, noise=0.0):
            return level.estimate(readings)
        method = Robust if self.robust else Likelihood
        readings.require(method.unknowns, method.name)
        estimate = estimated(self.recorded(readings), readings, has_statistics=True)
        if level is None:
            return estimate
        # Of all readings, too: to an ellipsoid through a rest, the turn itself is astray.
        covariances = readings.summary.moments.covariance, _covariance(readings, estimate)
        if not any(is_level(one, THICK) for one in covariances):
            return estimate
        turned = level.estimate(readings)
        if sum(run.independent for run in turned.outliers) > MAX_TILTED_SHARE * len(readings):
            return estimate
        is_turn = any(is_level(one, estimate.noise) for one in covariances)
        nearly = estimate.unobserved > 0 or any(
            is_level(one, estimate.noise, within=NEARLY_FLAT_NOISE) for one in covariances
        )
        much = 1.0 if nearly else np.inf if turned.outliers else MUCH_BETTER  # what leaves the plane are no outliers
        return turned if is_turn or much * self._claimed(turned) < self._claimed(estimate) else estimate

    def recorded(self, readings: Readings, *, statistics: int = 1) -> Records:
        """The engine's record of what `estimate` does with readings out of one plane."""
        robust = 2 if self.robust else 1
        return recorded(readings, self.prior, robust=robust, dip_deg=self.dip_deg, statistics=statistics)

    def _claimed(self, estimate: Estimate) -> float:
        """Worst level heading error that an estimate claims, in degrees."""
        return level_error(estimate.ellipsoid, estimate.covariance, dip_deg=self.dip_deg).worst

    def _from_sums(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid without looking at a reading."""
        if self.prior not in (None, prior.SPREAD):
            raise NeedsSamples(f"{self.name} with a prior of {self.prior:g}")
        from flinders.estimators.consistent import Consistent

        return Consistent().estimate(readings)


def found_alone(field: Floats) -> Estimate | None:
    """What (N, 3) readings of one sensor give by themselves, those that are there; None where that is no ellipsoid."""
    try:
        return Auto().estimate(Readings.of(field[np.isfinite(field).all(axis=1)]))
    except FitError:
        return None


def _can_be_level(readings: Readings) -> bool:
    """Enough readings of numbers that can be calculated with; an axis that never changes may be a broken one."""
    if len(readings) < Level.unknowns or not readings.are_in_scale:
        return False
    return bool(readings.summary.health.extent.all())


def _covariance(readings: Readings, estimate: Estimate) -> Floats:
    """(3, 3) of the readings about their mean; of outliers, without those left out and the farthest from their plane.

    A few outliers always lie on the surface that is found among them, however flat the rest.
    """
    if not estimate.outliers:
        return readings.summary.moments.covariance
    field = readings.near(estimate.ellipsoid, estimate.rejected_beyond).thinned(ENOUGH)
    return readings.summary.moments.covariance if len(field) < FEWEST_LEFT else trimmed_covariance(field)


def trimmed_covariance(field: Floats) -> Floats:
    """(3, 3) of (N, 3) readings without those farthest from their plane."""
    return symmetric(engine().trimmed_covariance(field))


METHOD: Final = Method(
    Auto,
    use="the default: likelihood, or robust where residuals ask for it; consistent where there are only sums",
    source="the likelihood, after `robust` where residuals ask for it",
)
