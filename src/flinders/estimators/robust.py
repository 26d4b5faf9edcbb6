"""Robust: the likelihood of the inliers, started from the least median of squares over many small subsets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.errors import NotAnEllipsoid
from flinders.estimators.base import Method
from flinders.estimators.data import NO_RUN, dense_in
from flinders.estimators.likelihood import ENOUGH, Likelihood
from flinders.estimators.outliers import outliers_among
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.likelihood import magnitude, prior
from flinders.likelihood.equations import FINEST, ROUNDING

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import TypeAlias

    from numpy.random import Generator
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings

    Start: TypeAlias = Callable[[Floats, Generator], Ellipsoid]
    from numpy.random import Generator


POINTS: Final = 12
"""In a draw: three more than there are parameters, so that noise does not decide the shape."""

DRAWS: Final = 256
"""Of which eight are free of outliers, on average, where a quarter of the readings are strays."""

SCORED: Final = 600
"""Readings that a draw is scored on: their median distance is known to a twentieth."""

RIDGE: Final = np.diag([1e-3] * 5 + [1e-9] * 4)
"""Pull towards the sphere, in units of the squared radius; nothing beside what twelve scattered points say."""

LONGEST_AXIS: Final = 5.0
"""Of the shortest: a draw that is longer or flatter is not scored."""


def subset_start(readings: Floats, rng: Generator, *, draws: int = DRAWS, scored: int = SCORED) -> Ellipsoid:
    """Least median of squares: the best of many ellipsoids through a few readings each.

    All draws are fitted at once: twelve readings each, tr Q = 3, a slight pull towards the sphere that keeps few
    points from bending the surface. The winner has the smallest median distance; as long as one
    draw in all is free of outliers and outliers are a minority, they have no say.

    Parameters
    ----------
    readings : (N, 3) float
    rng : Generator
    draws, scored : int
        Subsets tried, and readings they are scored on.

    Raises
    ------
    NotAnEllipsoid
        If no draw gives one.

    References
    ----------
    P. J. Rousseeuw, "Least median of squares regression", J. Am. Stat. Assoc. 79 (1984).
    """
    some = readings if len(readings) <= scored else readings[rng.choice(len(readings), scored, replace=False)]
    origin = np.median(some, axis=0)
    scale = float(np.median(np.linalg.norm(some - origin, axis=1)))
    if scale == 0.0:
        raise NotAnEllipsoid((0.0, 0.0, 0.0))
    local = (some - origin) / scale
    chosen = local[np.argsort(rng.random((draws, len(local))), axis=1)[:, :POINTS]]
    centres, inverses = _closed(_quadrics(chosen))
    best = int(np.argmin(_scores(local, centres, inverses)))
    return Ellipsoid(centres[best], np.linalg.inv(inverses[best])).in_frame(origin, scale)


def _quadrics(points: Floats) -> Floats:
    """(H, 10) coefficients of H quadrics through (H, K, 3) points, in the least-squares sense with tr Q = 3.

    With Q = 1 + diag(a, b, −a − b) + … the sum of squares x² + y² + z² is the right-hand side.
    """
    x, y, z = np.moveaxis(points, 2, 0)
    rows = np.stack([x * x - z * z, y * y - z * z, 2 * x * y, 2 * x * z, 2 * y * z, x, y, z, np.ones_like(x)], axis=2)
    squares = x * x + y * y + z * z
    transposed = rows.transpose(0, 2, 1)
    normal = transposed @ rows + RIDGE
    normal += ROUNDING * np.trace(normal, axis1=1, axis2=2)[:, np.newaxis, np.newaxis] * np.eye(9)
    solution = np.linalg.solve(normal, -(transposed @ squares[..., np.newaxis]))[..., 0]
    a, b = solution[:, 0], solution[:, 1]
    return np.column_stack([1.0 + a, 1.0 + b, 1.0 - a - b, solution[:, 2:]])


def _closed(quadrics: Floats) -> tuple[Floats, Floats]:
    """Centres (H, 3) and inverse shapes (H, 3, 3) of those quadrics that are ellipsoids of a sensible shape."""
    forms = quadrics[:, [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(-1, 3, 3)
    eigenvalues, vectors = np.linalg.eigh(forms)
    flat = LONGEST_AXIS**-2 * eigenvalues[:, 2]
    sound = eigenvalues[:, 0] > np.maximum(flat, 1e-9)
    eigenvalues, vectors, quadrics = eigenvalues[sound], vectors[sound], quadrics[sound]
    linear = np.einsum("hji,hj->hi", vectors, quadrics[:, 6:9])
    centres = np.einsum("hij,hj->hi", vectors, -0.5 * linear / eigenvalues)
    levels = 0.25 * np.sum(linear**2 / eigenvalues, axis=1) - quadrics[:, 9]
    real = levels > 0.0
    if not real.any():
        raise NotAnEllipsoid((0.0, 0.0, 0.0))
    vectors, eigenvalues, levels = vectors[real], eigenvalues[real], levels[real]
    roots = np.sqrt(eigenvalues / levels[:, np.newaxis])
    return centres[real], np.einsum("hij,hj,hkj->hik", vectors, roots, vectors)


def _scores(readings: Floats, centres: Floats, inverses: Floats) -> Floats:
    """(H,) median Sampson distances of (N, 3) readings from H ellipsoids."""
    y = np.matmul(inverses, (readings - centres[:, np.newaxis]).transpose(0, 2, 1))
    lengths = np.maximum(np.sqrt(np.einsum("hin,hin->hn", y, y)), 1e-12)
    normals = np.matmul(inverses, y)
    steepness = np.maximum(np.sqrt(np.einsum("hin,hin->hn", normals, normals)), 1e-12)
    distances = np.abs(lengths - 1.0) * lengths / steepness
    middle = distances.shape[1] // 2
    scores: Floats = np.partition(distances, middle, axis=1)[:, middle]
    return scores


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
