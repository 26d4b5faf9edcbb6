"""Auto: the best that can be had from what is given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from flinders.errors import NeedsSamples, NotAnEllipsoid
from flinders.estimators.consistent import Consistent
from flinders.estimators.level import Level, is_level
from flinders.estimators.likelihood import ENOUGH, Likelihood
from flinders.estimators.robust import Robust, asks_for_it
from flinders.terms import prior

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.estimate import Estimate
    from flinders.estimators.readings import Readings

TRIMS, TRIMMED = 3, 0.03
"""Of readings among which there are strays, the share that is left out and how often, to see whether they are flat."""


@dataclass(frozen=True, slots=True)
class Auto:
    """Likelihood from a consistent start; robust where residuals ask for it; consistent where there are only sums.

    Minimises what `Likelihood` minimises, over all readings or, as `Robust`, over those that belong together; of a
    level turn, what `Level` does.

    Use it unless there is a reason not to. The estimate names what was run.

    Parameters
    ----------
    prior : float, optional
        See `Likelihood`; without one a level turn is not fitted either. Sums go without: `Consistent` leaves what
        was not seen free, as None asks for.
    robust : bool
        Look for strays whether or not the residuals ask for it.
    dip_deg : float
        Inclination of the field at the site; it matters only to `Level`.

    Examples
    --------
    >>> import numpy as np
    >>> from flinders.estimators.readings import Readings
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
    use: ClassVar[str] = (
        "the default: likelihood, or robust where residuals ask for it; consistent where there are only sums"
    )

    def __post_init__(self) -> None:
        """Refuse a prior that means nothing."""
        prior.check(self.prior)

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises
        ------
        TooFewSamples, OutOfScale, StuckAxis, Unmoved, NotAnEllipsoid, Undetermined
            As the method that is run.
        NeedsSamples
            If only sums were given, and `robust` or a prior of its own was asked for: neither works on sums.
        """
        if self.robust:
            return Robust(prior=self.prior).estimate(readings)
        if readings.recording is None:
            return self._from_sums(readings)
        level = self._level(readings, readings.summary.moments.covariance, noise=0.0)
        if level is not None:
            return level.estimate(readings)
        found = self._without_strays(readings, Likelihood(prior=self.prior).estimate(readings))
        level = self._level(readings, _covariance(readings, found), found.noise)
        return found if level is None else level.estimate(readings)

    def _level(self, readings: Readings, covariance: Floats, noise: float) -> Level | None:
        """What fits a level turn, where this is one and a prior holds what it leaves open."""
        can_be_level = len(readings) >= Level.unknowns and readings.are_in_scale
        if self.prior is None or not can_be_level or not is_level(covariance, noise):
            return None
        return Level(self.prior, self.dip_deg)

    def _without_strays(self, readings: Readings, found: Estimate) -> Estimate:
        """Fit the majority alone, where the residuals of a fit to all ask for it and there is one."""
        if len(readings) < Robust.unknowns or not asks_for_it(readings, found.ellipsoid):
            return found
        try:
            return Robust(prior=self.prior).estimate(readings)
        except NotAnEllipsoid:
            return found

    def _from_sums(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid without looking at a reading."""
        if self.prior not in (None, prior.SPREAD):
            raise NeedsSamples(f"{self.name} with prior={self.prior:g}")
        return Consistent().estimate(readings)


def _covariance(readings: Readings, found: Estimate) -> Floats:
    """(3, 3) of the readings about their mean; of strays, without those left out and the farthest from their plane.

    A few strays always lie on the surface that is found among them, however flat the rest.
    """
    if not found.strays:
        return readings.summary.moments.covariance
    field = readings.near(found.ellipsoid, found.rejected_beyond).thinned(ENOUGH)
    for _ in range(TRIMS):
        local = field - field.mean(axis=0)
        across = np.abs(local @ np.linalg.eigh(local.T @ local)[1][:, 0])
        field = field[across <= np.quantile(across, 1.0 - TRIMMED)]
    return np.cov(field.T)
