"""Auto: the best that can be had from what is given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from flinders.errors import NotAnEllipsoid
from flinders.estimators.consistent import Consistent
from flinders.estimators.likelihood import Likelihood
from flinders.estimators.robust import Robust, asks_for_it
from flinders.terms import prior

if TYPE_CHECKING:
    from flinders.estimators.estimate import Estimate, Readings


@dataclass(frozen=True, slots=True)
class Auto:
    """Likelihood from a consistent start; robust where residuals ask for it; consistent where there are only sums.

    Minimises what `Likelihood` minimises, over all readings or, as `Robust`, over those that belong together.

    Use it unless there is a reason not to. The estimate names what was run.

    Parameters
    ----------
    prior : float, optional
        See `Likelihood`.
    robust : bool
        Look for strays whether or not the residuals ask for it.

    Examples
    --------
    >>> import numpy as np
    >>> from flinders.estimators.estimate import Readings
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
        TooFewSamples, OutOfScale, StuckAxis, Unmoved, NotAnEllipsoid
            As the method that is run.
        """
        if readings.recording is None:
            return Consistent().estimate(readings)
        robust = Robust(prior=self.prior)
        if self.robust:
            return robust.estimate(readings)
        found = Likelihood(prior=self.prior).estimate(readings)
        if len(readings) >= Robust.unknowns and asks_for_it(readings, found.ellipsoid):
            try:
                return robust.estimate(readings)
            except NotAnEllipsoid:
                return found
        return found
