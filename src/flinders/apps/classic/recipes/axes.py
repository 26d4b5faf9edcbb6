"""Axis-aligned: offset and one scale for each axis, no cross terms. Seven unknowns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

from flinders.estimators.base import Method
from flinders.estimators.covariance import ALIGNED_BASIS
from flinders.estimators.quadric_fit import CONSTRAINT_BASES, Frame, fit_constrained, make_estimate

if TYPE_CHECKING:
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings


@dataclass(frozen=True, slots=True)
class AxisAligned:
    """Offset and a scale for each axis by linear least squares.

    Minimises ``Σ (Σᵢ aᵢxᵢ² + l·x + d)²`` with ``a₁ + a₂ + a₃ = 3``.

    Use it if the sensor's axes have unequal gains and there is no soft iron, or if the readings are too few for ten
    unknowns.

    References
    ----------
    .. [1] NXP AN4246 rev. 4 (2015) and AN5019, the seven-element calibration.

    Examples
    --------
    >>> import numpy as np
    >>> from flinders.estimators.data import Readings
    >>> directions = np.random.default_rng(1).normal(size=(40, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> ellipsoid = AxisAligned().estimate(Readings.of(directions * [30, 20, 50] + [-50, 20, 100])).ellipsoid
    >>> ellipsoid.centre.round(6), ellipsoid.semi_axes.round(6)
    (array([-50.,  20., 100.]), array([20., 30., 50.]))
    """

    name: ClassVar[str] = "axes"
    unknowns: ClassVar[int] = 7
    is_biased: ClassVar[bool] = True

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid whose axes are the sensor's.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`; `NotAnEllipsoid` if the
        quadric is open.
        """
        readings.require(self.unknowns, self.name)
        frame = Frame.of(readings)
        ellipsoid = frame.to_ellipsoid(fit_constrained(frame.scatter, CONSTRAINT_BASES["aligned"]), self.name)
        return make_estimate(readings, ellipsoid, self.name, ALIGNED_BASIS)


METHOD: Final = Method(
    AxisAligned,
    use="offset and a scale for each axis: unequal gains, no soft iron",
    source="NXP AN4246 and AN5019, seven elements",
    is_recipe=True,
)
