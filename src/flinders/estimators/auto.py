"""Auto: the best that can be had from what is given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.core.samples import Samples
from flinders.errors import FitError, NeedsSamples
from flinders.estimators.base import Method, check_prior
from flinders.estimators.data import Readings
from flinders.estimators.likelihood import Likelihood, estimated, recorded
from flinders.estimators.robust import Robust
from flinders.likelihood import prior
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.native.layouts import Records


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
        record = self.recorded(readings)
        if not record["plane"]:
            method = Robust if self.robust else Likelihood
            readings.require(method.unknowns, method.name)
        return estimated(record, readings, has_statistics=True)

    def recorded(self, readings: Readings, *, statistics: int = 1) -> Records:
        """The engine's record of what `estimate` does with readings in memory."""
        robust, level = 2 if self.robust else 1, levelness(readings)
        return recorded(readings, self.prior, robust=robust, level=level, dip_deg=self.dip_deg, statistics=statistics)

    def _from_sums(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid without looking at a reading."""
        if self.prior not in (None, prior.SPREAD):
            raise NeedsSamples(f"{self.name} with a prior of {self.prior:g}")
        from flinders.estimators.consistent import Consistent

        return Consistent().estimate(readings)


def levelness(readings: Readings) -> int:
    """What an accelerometer shows of a level turn, for the engine: 0 that there is none, 2 that there is, 1 nothing."""
    recording = readings.recording
    if not isinstance(recording, Samples) or recording.acceleration is None:
        return 1
    return engine().levelness(recording.acceleration)


def found_alone(field: Floats) -> Estimate | None:
    """What (N, 3) readings of one sensor give by themselves, those that are there; None where that is no ellipsoid."""
    try:
        return Auto().estimate(Readings.of(field[np.isfinite(field).all(axis=1)]))
    except FitError:
        return None


METHOD: Final = Method(
    Auto,
    use="the default: likelihood, or robust where residuals ask for it; consistent where there are only sums",
    source="the likelihood, after `robust` where residuals ask for it",
)
