"""Robust: the likelihood of the readings that belong together, found among those that do not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.errors import NotAnEllipsoid
from flinders.estimators.base import Method
from flinders.estimators.inliers import NO_RUN, dense_in
from flinders.estimators.least_median import subset_start
from flinders.estimators.likelihood import ENOUGH, Likelihood
from flinders.estimators.outliers import outliers_among
from flinders.likelihood import magnitude, prior
from flinders.likelihood.equations import FINEST

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import TypeAlias

    from numpy.random import Generator
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings
    from flinders.geometry.ellipsoid import Ellipsoid

    Start: TypeAlias = Callable[[Floats, Generator], Ellipsoid]

SEED: Final = 20240607
"""Any number: with a fixed one the same readings give the same fit."""

ROUNDS: Final = 12
"""Of rejection and fit; three or four settle it, and more are for readings that hardly belong together."""

SETTLED: Final = 1e-4
"""Of the limit: a change that moves no reading worth speaking of across it."""

REJECT: Final = 4.0
"""Standard deviations from the surface; of clean readings one in sixteen thousand is as far off."""

TO_SIGMA: Final = 1.4826
"""From the median of absolute values to the standard deviation of a normal distribution."""

# What follows was set with ``python -m benchmarks.claims --tables outliers``: as small as clean readings of every
# motion and noise allow, and ``tests/truth/test_robust.py`` holds it to that.
HEAVY_TAIL: Final = 1.2
"""Standard deviation from the squares over that from the median, 1 for normal residuals; chance gets 3/√N more."""

PEAKED, PEAKED_ERRORS = 4.5, 8.0
"""Kurtosis (3 is normal), and its standard errors above 3, from which on a tail is not that of noise."""

FAR_OUT: Final = 6.5
"""Standard deviations: of 20,000 normal residuals one is that far off in one recording out of half a million."""

MASKED: Final = 0.75
"""Of the median distance: what another ellipsoid through a few readings must leave at most, to be the better one."""

NORMAL: Final = 2.0
"""Standard errors within which a kurtosis is that of normal residuals."""

QUIET: Final = 0.05
"""Of the radius: as far off as a recording is allowed to be before `flinders.fitting.verdict` calls it noisy."""

ENOUGH_TO_JUDGE: Final = 40
"""Residuals from which on their median tells their spread to a fifth."""

VERY_FAR_OUT: Final = 20.0
"""Standard deviations, where readings are fewer: in 400 clean recordings of twelve the farthest is at 8.5."""

FEW_DRAWS, FEW_SCORED = 24, 150
"""For a look whether outliers have bent the fit: a fortieth of the work of `subset_start` itself."""


@dataclass(frozen=True, slots=True)
class Robust:
    """General ellipsoid of the majority: readings that do not belong to it are rejected.

    Starts from the least median of squares over many small subsets (`subset_start`), rejects what is farther
    from the surface than four standard deviations, and minimises what `Likelihood` minimises over the rest,
    until the same readings are rejected again. σ comes from the median distance, in a sample
    that takes few readings of each place, so that a rest of the sensor does not pass for its noise.

    Use it where something magnetic passed by, a cable moved or a bus dropped bits; `auto` takes it when the
    residuals ask for it. Up to about a quarter of outliers have no effect worth a digit; clean readings
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
    >>> from flinders.estimators.data import Readings
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
            If no small subset gives an ellipsoid, or fewer readings than unknowns belong together.
        Undetermined
            If those leave parameters open, and there is no prior to hold them.
        NeedsSamples
            If only sums were given.
        """
        readings.require(self.unknowns, self.name)
        return self.majority(readings, subset_start)

    def majority(self, readings: Readings, start: Start) -> Estimate:
        """Fit those that belong together, from a start that the others cannot bend; raises as `estimate`."""
        some = readings.thinned(ENOUGH, self.name)
        ellipsoid, limit = self._settled(readings, some, start)
        dense = dense_in(_are_far(some, ellipsoid, limit), len(readings))
        estimate = self._fit_near(readings, ellipsoid, limit, dense)
        outliers = outliers_among(readings, ellipsoid, limit, dense)
        return replace(estimate, method=self.name, rejected_beyond=limit, outliers=outliers)

    def _settled(self, readings: Readings, some: Floats, start: Start) -> tuple[Ellipsoid, float]:
        """Reject and fit in turn until the limit stays: the ellipsoid of the majority, and how far it reaches.

        Of a part of the readings only single ones are rejected: what lies around a run of outliers is not beside them.
        """
        rng = np.random.default_rng(SEED)
        spread = readings.spread_out(some, rng)
        ellipsoid, limit = start(spread, rng), 0.0
        thinned = len(some) < len(readings)
        part = readings.only(some) if thinned else readings
        for _ in range(ROUNDS):
            before, limit = limit, rejection_limit(spread, ellipsoid)
            dense = NO_RUN if thinned else dense_in(_are_far(some, ellipsoid, limit), len(some))
            ellipsoid = self._fit_near(part, ellipsoid, limit, dense).ellipsoid
            if abs(limit - before) <= SETTLED * limit:
                break
        return ellipsoid, limit

    def _fit_near(self, readings: Readings, ellipsoid: Ellipsoid, limit: float, dense: int) -> Estimate:
        """Fit those readings that belong together; raises as `estimate`."""
        near = readings.near(ellipsoid, limit, dense)
        if len(near) < self.unknowns:
            raise NotAnEllipsoid((0.0, 0.0, 0.0), self.name)
        return Likelihood(prior=self.prior).polish(near, ellipsoid)


def _are_far(readings: Floats, ellipsoid: Ellipsoid, limit: float) -> NDArray[np.bool_]:
    """(N,) which of (N, 3) readings are rejected on their own."""
    return np.asarray(np.abs(magnitude.distances(readings, ellipsoid)) > limit, dtype=bool)


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

    They do where their tail is heavy, by its spread or its kurtosis, where one is far out, or where an ellipsoid
    through a few readings explains the median reading clearly better: then outliers have bent the fit towards
    themselves (masking). A bent fit leaves residuals that are large or not of normal kurtosis, so only those are
    looked at twice. Of few readings only one that is very far out is a stray: their median says little of their
    spread.
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
    error = float(np.sqrt(24.0 / len(squares)))
    if kurtosis > max(PEAKED, 3.0 + PEAKED_ERRORS * error):
        return True
    is_normal = abs(kurtosis - 3.0) < NORMAL * error
    if is_normal and square < (QUIET * ellipsoid.radius) ** 2:
        return False
    try:
        other = subset_start(spread, rng, draws=FEW_DRAWS, scored=FEW_SCORED)
    except NotAnEllipsoid:
        return False
    return typical_distance(np.abs(magnitude.distances(spread, other))) < MASKED * sigma


METHOD: Final = Method(
    Robust,
    use="general ellipsoid of the majority: rejects readings that do not belong",
    source="Rousseeuw (1984)",
)
