"""Min/max: the middle between the extremes of each axis, and a scale from how far apart they are. Six unknowns.

The recipe of most tutorials: two comparisons for each axis while the sensor turns, and no algebra at all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final, Literal, TypeAlias, get_args

import numpy as np

from flinders.errors import NeedsSamples, NotAnEllipsoid, TooFewSamples, UsageError
from flinders.estimators.base import Estimate, Method
from flinders.estimators.covariance import algebraic_noise
from flinders.estimators.outliers import NO_RUN, outliers_among
from flinders.estimators.robust import Robust
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.likelihood.equations import FINEST
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.data import Readings

Variant: TypeAlias = Literal["mean", "largest", "full-range"]

HALF: Final = 0.5
"""What ``full-range`` scales each half-range to."""


@dataclass(frozen=True, slots=True)
class MinMax:
    """Offset and a scale for each axis from its smallest and its largest reading.

    With h = (max − min) / 2 for each axis

        offset = (min + max) / 2,     corrected = (raw − offset) · F / h

    where the variant says what F is, the length of corrected readings:

    ``"mean"``
        The mean of the three h: the three-axis recipe of the blogs, and of the slide deck that repeats it [1]_.
    ``"largest"``
        The largest h, so that no scale is below 1: the robot car's, with its Xoff and Xsca.
    ``"full-range"``
        ½, as ``(raw − min) / (max − min) − ½``: the MinIMU-9's. Its ``SENSOR_SIGN`` is the axes mapping of the
        recording (``--axes x,-y,-z``).

    A field strength that is given takes the place of F. Moving and scaling the readings moves and scales
    the answer alike, and so does swapping axes or changing their signs; turning them does not turn it.

    Use it for parity with such a program, or where six numbers are all there is (`flinders.fitting.axis_extremes`).
    Not where accuracy counts: two readings settle each axis, the noise of the outermost
    always makes it wider, ends that the turn did not reach make it narrower, and soft iron across axes is not seen.

    Parameters
    ----------
    variant : str
    trim : bool
        First leave out what `Robust` leaves out: outliers, and clumps of them off the surface. A clump
        on the surface, as of a sensor at rest, does extremes no harm. Off by default: it is no part of the recipe, and
        whoever can do it can do without extremes. Looks at each reading.

    Notes
    -----
    One published script starts its maxima at zero: of an axis whose readings are all negative, zero then passes for
    an extreme. Nothing is started here but at the readings. (Copies of [1]_ start at ∓32767 and are right.) Sketches
    that calculate with integers also cut off the halves of offset and half-range, which is not repeated.

    Covariance: each end is off by the noise of its one reading and by the gap to the next,
    σ² + 8 h² / ((K+1)(K+2)) for K places of readings, as coordinates of an even sphere are even along each axis. What
    else separates it from the likelihood is seen, and joins it (`flinders.estimators.base`).

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
    """Method of its estimates, by their variants."""
    unknowns: ClassVar[int] = 7
    is_biased: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Refuse a variant that is not there."""
        if self.variant not in get_args(Variant):
            raise UsageError(f"variant is {self.variant!r}: need {', '.join(get_args(Variant))}")
        if not isinstance(self.trim, bool):
            raise UsageError(f"trim is {self.trim!r}: need True or False")

    def estimate(self, readings: Readings) -> Estimate:
        """Take the extremes.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`; `NotAnEllipsoid` if an
        axis hardly changes beside another, or the readings are nowhere near what their extremes span; with `trim` also
        as `Robust`; `NeedsSamples` if only sums were given, and `trim` was asked for.
        """
        readings.require(self.unknowns, self.name)
        return self._trimmed(readings) if self.trim else self._spanned(readings)

    def _spanned(self, readings: Readings) -> Estimate:
        """Take the extremes of all readings."""
        health = readings.summary.health
        ellipsoid = spanned(health.lows.values, -health.highs.values)
        half = ellipsoid.shape.diagonal()
        if half.min() < FINEST * half.max():
            raise NotAnEllipsoid((0.0, 0.0, 1.0), self.name)
        noise = algebraic_noise(readings, ellipsoid, self.unknowns - 1)
        places = len(readings.summary.cloud)
        ends = max(noise, FINEST * ellipsoid.radius) ** 2 + 8.0 * half**2 / ((places + 1) * (places + 2))
        covariance = np.zeros((9, 9))
        covariance[range(6), range(6)] = np.tile(ends, 2) / 2.0
        strength = strength_of(half, self.variant)
        return Estimate(ellipsoid, covariance, noise, self.LABELS[self.variant], strength=strength, estimator=self.name)

    def _trimmed(self, readings: Readings) -> Estimate:
        """Take the extremes of those that a robust fit keeps."""
        if readings.recording is None:
            raise NeedsSamples(f"{self.name} with trim")
        if len(readings) < Robust.unknowns:
            raise TooFewSamples(found=len(readings), needed=Robust.unknowns, method=f"{self.name} with trim")
        majority = Robust().estimate(readings)
        limit = majority.rejected_beyond
        near = readings.near(majority.ellipsoid, limit).recording
        if near is None:  # it is there, as the recording is
            raise NeedsSamples(f"{self.name} with trim")
        inliers = type(readings)(Summary.through(near), near)
        inliers.require(self.unknowns, self.name)
        return replace(
            self._spanned(inliers),
            used=len(inliers.summary),
            rejected_beyond=limit,
            outliers=outliers_among(readings, majority.ellipsoid, limit, NO_RUN),
        )


def spanned(low: Floats, high: Floats) -> Ellipsoid:
    """The ellipsoid with its axes along the sensor's that touches (3,) extremes on both sides."""
    return Ellipsoid((low + high) / 2.0, np.diag((high - low) / 2.0))


def strength_of(half: Floats, variant: Variant) -> float:
    """Length of corrected readings, of (3,) half-ranges."""
    return {"mean": float(half.mean()), "largest": float(half.max()), "full-range": HALF}[variant]


METHOD: Final = Method(
    MinMax,
    use="the recipe of the tutorials, from the extremes of each axis: parity with a sketch",
    source="Winer, wiki of kriswiner/MPU6050",
    is_recipe=True,
)
