"""Algebraic: the ellipsoid fit of NXP, MATLAB and MotionCal, with ten coefficients and one scale.

Linear, fast and biased: noise makes the best quadric flatter than the ellipsoid. The bias grows with σ²
and with the directions that the recording lacks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, Literal, TypeAlias, get_args

import numpy as np

from flinders.errors import UsageError
from flinders.estimators.base import Method
from flinders.estimators.quadric_fit import Frame, least_squares, make_estimate
from flinders.geometry.ellipsoid import Ellipsoid

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings
    from flinders.summary.moments import Moments

_TRACE_FREE: Final = np.concatenate(
    [[[1.0, 1.0], [-1.0, 0.0], [0.0, -1.0], *np.zeros((7, 2))], np.eye(10)[:, 3:]], axis=1
)
_TRACE: Final = np.array([1.0, 1.0, 1.0, 0, 0, 0, 0, 0, 0, 0])


Normalisation: TypeAlias = Literal["trace", "unit", "nxp"]


@dataclass(frozen=True, slots=True)
class Algebraic:
    """General ellipsoid by least squares on the quadric's value.

    Minimises ``Σ q(x)²``, ``q(x) = xᵀQx + l·x + d``, with one of these normalisations:

    ``"trace"``
        tr Q = 3, the default. If the readings are moved, rotated or scaled, the result changes in the same way.
    ``"unit"``
        The ten coefficients have unit length after the mean is removed and the readings are
        divided by their root mean square distance from it.
    ``"nxp"``
        The ten coefficients have unit length after the first reading is subtracted and the readings are divided
        by 50: the ten-element calibration of NXP and Freescale, MotionCal and MATLAB's ``magcal``, except for
        their choice of origin.

    Use it for the same results as these tools. For accuracy use `Consistent`, which takes the same time and
    has no bias, or `Likelihood`.

    References
    ----------
    .. [1] NXP AN4246 rev. 4 and AN5019, ten-element calibration; J. Merayo et al. (2000).

    Examples
    --------
    The documented example of MATLAB's ``magcal``: centre (−50, 20, 100), radii (30, 20, 50).

    >>> from flinders.estimators.data import Readings
    >>> directions = np.random.default_rng(1).normal(size=(40, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> ellipsoid = Algebraic("nxp").estimate(Readings.of(directions * [30, 20, 50] + [-50, 20, 100])).ellipsoid
    >>> ellipsoid.centre.round(6), round(ellipsoid.radius, 4)
    (array([-50.,  20., 100.]), 31.0723)
    """

    normalisation: Normalisation = "trace"

    name: ClassVar[str] = "algebraic"
    unknowns: ClassVar[int] = 10
    is_biased: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Refuse an unknown normalisation."""
        if self.normalisation not in get_args(Normalisation):
            raise UsageError(
                f"normalisation is {self.normalisation!r}: need one of {', '.join(get_args(Normalisation))}"
            )

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`; `NotAnEllipsoid` if the
        quadric is open.
        """
        readings.require(self.unknowns, self.name)
        nxp = self.normalisation == "nxp"
        frame = Frame.of(readings, readings.summary.health.first, 50.0) if nxp else Frame.of(readings)
        by_trace = self.normalisation == "trace"
        coefficients = trace_fit(frame.scatter) if by_trace else np.linalg.eigh(frame.scatter)[1][:, 0]
        return make_estimate(readings, frame.to_ellipsoid(coefficients, self.name), self.name)


def trace_fit(scatter: Floats) -> Floats:
    """(10,) coefficients c that minimise cᵀMc with tr Q = 3, for a (10, 10) scatter M."""
    return least_squares(scatter, _TRACE, _TRACE_FREE)


def fit_error(moments: Moments, ellipsoid: Ellipsoid) -> float:
    """Fit error as NXP and MATLAB define it, √(mean (|y|² − B²)²) / 2B² with corrected readings y of ideal length B.

    The fit error is about the noise relative to the field. MotionCal prints it in per cent.
    """
    scale = ellipsoid.radius
    quadric = Ellipsoid(np.zeros(3), ellipsoid.shape / scale).as_quadric()
    mean_square = float(quadric @ moments.about(ellipsoid.centre, scale) @ quadric) / moments.count
    return 0.5 * float(np.sqrt(max(mean_square, 0.0)))


METHOD: Final = Method(
    Algebraic,
    use="general ellipsoid as NXP, MATLAB and MotionCal fit it; biased by noise",
    source="NXP AN4246 and AN5019, ten elements",
    programs=("MotionCal", "NXP"),
)
