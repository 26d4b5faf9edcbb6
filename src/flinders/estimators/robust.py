"""Robust: the likelihood of the readings that belong together, found among those that do not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.errors import NotAnEllipsoid
from flinders.estimators.estimate import FINEST
from flinders.estimators.likelihood import ENOUGH, Likelihood
from flinders.estimators.subsets import subset_start
from flinders.terms import magnitude, prior

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.estimate import Estimate, Readings
    from flinders.quadric import Ellipsoid

SEED: Final = 20240607
ROUNDS: Final = 12
REJECT: Final = 4.0
TO_SIGMA: Final = 1.4826
"""From the median of absolute values to the standard deviation of a normal distribution."""

HEAVY_TAIL: Final = 1.2
FAR_OUT: Final = 6.5
MASKED: Final = 0.75
NORMAL: Final = 2.0
QUIET: Final = 0.05
ENOUGH_TO_JUDGE: Final = 40
VERY_FAR_OUT: Final = 20.0
FEW_DRAWS, FEW_SCORED = 24, 150


@dataclass(frozen=True, slots=True)
class Robust:
    """General ellipsoid of the majority: readings that do not belong to it are rejected.

    Starts from the least median of squares over many small subsets (`subset_start`), rejects what is farther
    from the surface than four standard deviations, and minimises what `Likelihood` minimises over the rest,
    until the same readings are rejected again. σ comes from the median distance, in a sample
    that takes few readings of each place, so that a rest of the sensor does not pass for its noise.

    Use it where something magnetic passed by, a cable moved or a bus dropped bits; `auto` takes it when the
    residuals ask for it. Up to about a quarter of strays have no effect worth a digit; clean readings
    lose one in sixteen thousand.

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
    >>> from flinders.estimators.estimate import Readings
    >>> rng = np.random.default_rng(1)
    >>> directions = rng.normal(size=(500, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> field = directions * [45, 50, 55] + [20, 120, 90] + rng.normal(scale=0.5, size=directions.shape)
    >>> field[:100] += [0, 80, 0]                            # a magnet passes
    >>> Robust().estimate(Readings.of(field)).ellipsoid.centre.round()
    array([ 20., 120.,  90.])
    """

    prior: float | None = prior.SPREAD

    name: ClassVar[str] = "robust"
    unknowns: ClassVar[int] = 12
    use: ClassVar[str] = "general ellipsoid of the majority: rejects readings that do not belong"
    is_biased: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse a prior that means nothing."""
        prior.check(self.prior)

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises
        ------
        TooFewSamples, OutOfScale, StuckAxis, Unmoved
            See `Readings.require`.
        NotAnEllipsoid
            If no small subset gives an ellipsoid.
        NeedsSamples
            If only sums were given.
        """
        readings.require(self.unknowns, self.name)
        rng = np.random.default_rng(SEED)
        some = readings.thinned(ENOUGH, self.name)
        spread = readings.spread_out(some, rng)
        ellipsoid = subset_start(spread, rng)
        polish = Likelihood(prior=self.prior).polish
        part = readings.only(some)
        limit = 0.0
        for _ in range(ROUNDS):
            before, limit = limit, rejection_limit(spread, ellipsoid)
            near = part.near(ellipsoid, limit)
            if len(near) < self.unknowns:
                raise NotAnEllipsoid((0.0, 0.0, 0.0), self.name)
            ellipsoid = polish(near, ellipsoid).ellipsoid
            if abs(limit - before) <= 1e-4 * limit:
                break
        found = polish(readings.near(ellipsoid, limit), ellipsoid)
        return replace(found, method=self.name, rejected_beyond=limit)


def typical_distance(distances: Floats) -> float:
    """Standard deviation of absolute distances, from their median; nine parameters were fitted to them."""
    freedom = max(len(distances) - 9, 1) / len(distances)
    return TO_SIGMA * float(np.median(distances)) / float(np.sqrt(freedom))


def rejection_limit(readings: Floats, ellipsoid: Ellipsoid) -> float:
    """The distance from the surface beyond which a reading is rejected."""
    distances = np.abs(magnitude.distances(readings, ellipsoid))
    return REJECT * max(typical_distance(distances), FINEST * ellipsoid.radius)


def asks_for_it(readings: Readings, ellipsoid: Ellipsoid) -> bool:
    """Whether the residuals of a fit to all readings call for a robust one.

    They do where their tail is heavy, where one is far out, or where an ellipsoid through a few readings explains
    the median reading clearly better: then strays have bent the fit towards themselves (masking). A bent fit leaves
    residuals that are large or not of normal kurtosis, so only those are looked at twice. Of few
    readings only one that is very far out is a stray: their median says little of their spread.
    """
    rng = np.random.default_rng(SEED)
    spread = readings.spread_out(readings.thinned(ENOUGH, Robust.name), rng)
    distances = np.abs(magnitude.distances(spread, ellipsoid))
    sigma, farthest = typical_distance(distances), float(distances.max())
    if len(spread) < ENOUGH_TO_JUDGE:
        return farthest > VERY_FAR_OUT * sigma
    squares = distances * distances
    square = float(squares.mean())
    if square > ((HEAVY_TAIL + 3.0 / np.sqrt(len(spread))) * sigma) ** 2 or farthest > FAR_OUT * sigma:
        return True
    kurtosis = float(squares @ squares) / len(squares) / max(square * square, np.finfo(float).tiny)
    is_normal = abs(kurtosis - 3.0) < NORMAL * np.sqrt(24.0 / len(squares))
    if is_normal and square < (QUIET * ellipsoid.radius) ** 2:
        return False
    try:
        other = subset_start(spread, rng, draws=FEW_DRAWS, scored=FEW_SCORED)
    except NotAnEllipsoid:
        return False
    return typical_distance(np.abs(magnitude.distances(spread, other))) < MASKED * sigma
