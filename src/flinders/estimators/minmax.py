"""Min/max: offset and scale of each axis from its extremes, six unknowns.

The recipe of most tutorials: two comparisons for each axis while the sensor turns, without algebra.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final, Literal, TypeAlias, get_args

import numpy as np

from flinders.errors import NeedsSamples, NotAnEllipsoid, TooFewSamples, UsageError
from flinders.estimators.base import Estimate, Method
from flinders.estimators.covariance import algebraic_noise
from flinders.estimators.outliers import NO_RUN, list_outliers
from flinders.estimators.robust import Robust
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.likelihood.equations import MIN_NOISE
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.data import Readings

Variant: TypeAlias = Literal["mean", "largest", "full-range"]

HALF_RANGE_LENGTH: Final = 0.5
"""Length of corrected readings for ``full-range``."""


@dataclass(frozen=True, slots=True)
class MinMax:
    """Offset and scale of each axis from its smallest and its largest reading.

    With h = (max − min) / 2 for each axis

        offset = (min + max) / 2,     corrected = (raw − offset) · F / h

    where F, the length of corrected readings, depends on the variant:

    ``"mean"``
        The mean of the three h: the three-axis recipe of blogs, and of the slide deck that repeats it [1]_.
    ``"largest"``
        The largest h, so that no scale is below 1: the recipe of robot cars, which call the numbers Xoff and Xsca.
    ``"full-range"``
        ½, as ``(raw − min) / (max − min) − ½``: the recipe of the MinIMU-9. Its ``SENSOR_SIGN`` is the axes mapping of
        the recording (``--axes x,-y,-z``).

    A given field strength replaces F. If readings are moved or scaled, or their axes exchanged or reversed, the result
    changes in the same way. This does not hold for a rotation of the readings.

    Use it for the same results as a program with this recipe, or if only six numbers are known
    (`flinders.fitting.axis_extremes`). Do not use it for accuracy: two readings determine each axis. The noise of the
    extremes always makes the range wider, directions that were not reached make it narrower, and soft iron between axes
    is not estimated.

    Parameters
    ----------
    variant : str
        ``mean``, ``largest`` or ``full-range``.
    trim : bool
        First reject outliers as `Robust` does, which needs the readings, not only their sums. Off by default, because
        it is not part of the recipe; the ellipsoid of `Robust` is more accurate than the extremes of its inliers.

    Notes
    -----
    One published script initialises its maxima with zero, so that the maximum of an axis whose readings are all
    negative is zero. That mistake is not reproduced. (Copies of [1]_ initialise with ∓32767, which is correct.)
    Sketches with integers also truncate offset and half-range; that is not reproduced either.

    Covariance: the error of each extreme is the noise of its reading and the distance to the true end of the axis. For
    K evenly distributed directions the variance is σ² + 8 h² / ((K+1)(K+2)), as each coordinate of a uniformly covered
    sphere is uniform. Other differences from the likelihood fit are added (`flinders.estimators.base`).

    References
    ----------
    .. [1] K. Winer, "Simple and Effective Magnetometer Calibration", wiki of the repository ``kriswiner/MPU6050``. Seen
       in the sketches that name and copy it; the page itself was not read.

    Examples
    --------
    >>> from flinders.estimators.data import Readings
    >>> turned = [[-157, 20, 3], [98, 9, -5], [-30, -123, 0], [-22, 124, 4], [-40, 7, -109], [-12, 1, 101], [40, 8, 33]]
    >>> estimate = MinMax("largest").estimate(Readings.of(turned))
    >>> estimate.ellipsoid.centre, (estimate.strength / estimate.ellipsoid.shape.diagonal()).round(2)
    (array([-29.5,   0.5,  -4. ]), array([1.  , 1.03, 1.21]))
    """

    variant: Variant = "mean"
    trim: bool = False

    name: ClassVar[str] = "minmax"
    LABELS: ClassVar[dict[Variant, str]] = {
        "mean": "minmax", "largest": "minmax largest", "full-range": "minmax full-range",
    }  # fmt: skip
    """Name of the method in estimates, by variant."""
    unknowns: ClassVar[int] = 7
    is_biased: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Refuse an unknown variant."""
        if self.variant not in get_args(Variant):
            raise UsageError(f"variant is {self.variant!r}: need one of {', '.join(get_args(Variant))}")
        if not isinstance(self.trim, bool):
            raise UsageError(f"trim is {self.trim!r}: need True or False")

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid by extremes.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`. Raises `NotAnEllipsoid`
        if an axis hardly changes compared with another, or the readings are far from the ellipsoid of their extremes.
        With `trim` raises also as `Robust`, and `NeedsSamples` if only sums were given.
        """
        readings.require(self.unknowns, self.name)
        return self._by_inliers(readings) if self.trim else self._by_extremes(readings)

    def _by_extremes(self, readings: Readings) -> Estimate:
        """Fit by the extremes of all readings."""
        health = readings.summary.health
        ellipsoid = extremes_ellipsoid(health.lows.values, -health.highs.values)
        half = ellipsoid.shape.diagonal()
        if half.min() < MIN_NOISE * half.max():
            raise NotAnEllipsoid((0.0, 0.0, 1.0), self.name)
        noise = algebraic_noise(readings, ellipsoid, self.unknowns - 1)
        places = len(readings.summary.cloud)
        ends = max(noise, MIN_NOISE * ellipsoid.radius) ** 2 + 8.0 * half**2 / ((places + 1) * (places + 2))
        covariance = np.zeros((9, 9))
        covariance[range(6), range(6)] = np.tile(ends, 2) / 2.0
        strength = corrected_length(half, self.variant)
        return Estimate(ellipsoid, covariance, noise, self.LABELS[self.variant], strength=strength, estimator=self.name)

    def _by_inliers(self, readings: Readings) -> Estimate:
        """Fit by the extremes of the inliers of a robust fit."""
        if readings.recording is None:
            raise NeedsSamples(f"{self.name} with trim")
        if len(readings) < Robust.unknowns:
            raise TooFewSamples(found=len(readings), needed=Robust.unknowns, method=f"{self.name} with trim")
        majority = Robust().estimate(readings)
        limit = majority.rejected_beyond
        near = readings.inliers(majority.ellipsoid, limit).recording
        if near is None:  # never, as there is a recording
            raise NeedsSamples(f"{self.name} with trim")
        inliers = type(readings)(Summary.of_recording(near), near)
        inliers.require(self.unknowns, self.name)
        return replace(
            self._by_extremes(inliers),
            used=len(inliers.summary),
            rejected_beyond=limit,
            outliers=list_outliers(readings, majority.ellipsoid, limit, NO_RUN),
        )


def extremes_ellipsoid(low: Floats, high: Floats) -> Ellipsoid:
    """Ellipsoid aligned with the sensor's axes, between the (3,) smallest and the (3,) largest readings of the axes."""
    return Ellipsoid((low + high) / 2.0, np.diag((high - low) / 2.0))


def corrected_length(half: Floats, variant: Variant) -> float:
    """Length F of corrected readings, from the (3,) half-ranges h of the axes."""
    return {"mean": float(half.mean()), "largest": float(half.max()), "full-range": HALF_RANGE_LENGTH}[variant]


METHOD: Final = Method(
    MinMax,
    use="the recipe of the tutorials, from the extremes of each axis: same numbers as a sketch",
    source="Winer, wiki of kriswiner/MPU6050",
    is_recipe=True,
)
