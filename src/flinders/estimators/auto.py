"""Auto: the best that can be had from what is given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from flinders.estimators.consistent import Consistent
from flinders.estimators.likelihood import Likelihood
from flinders.terms import prior

if TYPE_CHECKING:
    from flinders.estimators.estimate import Estimate, Readings


@dataclass(frozen=True, slots=True)
class Auto:
    """Consistent start, likelihood polish; the consistent fit alone where there are only sums.

    Minimises what `Likelihood` minimises.

    Use it unless there is a reason not to. The estimate names what was run.

    Parameters
    ----------
    prior : float, optional
        See `Likelihood`.

    Examples
    --------
    >>> import numpy as np
    >>> from flinders.estimators.estimate import Readings
    >>> directions = np.random.default_rng(1).normal(size=(200, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> readings = Readings.of(directions * [45, 50, 55] + [20, 120, 90])
    >>> Auto().estimate(readings).method, Auto().estimate(Readings(readings.summary)).method
    ('likelihood', 'consistent')
    """

    prior: float | None = prior.SPREAD

    name: ClassVar[str] = "auto"
    unknowns: ClassVar[int] = 10
    is_biased: ClassVar[bool] = False
    use: ClassVar[str] = (
        "the default: likelihood, started from the consistent fit; consistent where there are only sums"
    )

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises
        ------
        TooFewSamples, StuckAxis, NotAnEllipsoid
            As the method that is run.
        """
        if readings.recording is None:
            return Consistent().estimate(readings)
        return Likelihood(prior=self.prior).estimate(readings)
