"""Robust: the likelihood of the inliers, from a start by the least median of squares over many small subsets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

from flinders.estimators.base import Method, check_prior
from flinders.estimators.likelihood import estimate_from_record, fit_record
from flinders.likelihood import prior

if TYPE_CHECKING:
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings


@dataclass(frozen=True, slots=True)
class Robust:
    """General ellipsoid of the majority of the readings; outliers are rejected.

    Ellipsoids fitted to many random subsets of twelve readings are compared; the one with the least median of squared
    distances is the start. Readings that are farther from the surface than four standard deviations σ are rejected,
    and the cost of `Likelihood` is minimised over the others, until the rejected readings no longer change. σ is
    estimated from the median distance in a sample with few readings of each direction, so that a rest of the sensor
    does not determine it. If rejected runs outweigh the other readings, other random subsets are fitted, too, and the
    covariance includes the differences of their results.

    Use it if something magnetic passed, a cable moved or a bus dropped bits; `auto` uses it if residuals show
    outliers. Outliers have a negligible effect if they are less than about a quarter of the readings. Of clean
    readings, one in sixteen thousand is rejected.

    Parameters
    ----------
    prior : float, optional
        See `Likelihood`.

    References
    ----------
    .. [1] P. J. Rousseeuw, "Least median of squares regression", J. Am. Stat. Assoc. 79 (1984) 871–880.

    Examples
    --------
    >>> import numpy as np
    >>> from flinders.estimators.data import Readings
    >>> rng = np.random.default_rng(1)
    >>> directions = rng.normal(size=(500, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> field = directions * [45, 50, 55] + [20, 120, 90] + rng.normal(scale=0.5, size=directions.shape)
    >>> field[:100] += [0, 80, 0]                            # a magnet passes
    >>> Robust().estimate(Readings.of(field)).ellipsoid.centre.round()
    array([ 20., 120.,  90.])
    """

    prior: float | None = prior.SOFT_IRON_SPREAD

    name: ClassVar[str] = "robust"
    # smallest number of readings: of 25 readings, twelve can agree by chance, and 10 % of fits err by 9 times the claim
    unknowns: ClassVar[int] = 35
    is_biased: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse an invalid prior."""
        check_prior(self.prior)

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`. Raises `NotAnEllipsoid`
        if no small subset gives an ellipsoid, or there are fewer inliers than unknowns. Raises `Undetermined` if the
        inliers do not determine all parameters, and there is no prior. Raises `NeedsSamples` if only sums were given.
        """
        readings.require(self.unknowns, self.name)
        fitted = readings.for_fit()
        return estimate_from_record(fit_record(fitted, self.prior, robust=2, level=0), fitted, has_statistics=True)


METHOD: Final = Method(
    Robust,
    use="general ellipsoid of the majority of the readings: rejects outliers",
    source="Rousseeuw (1984)",
)
