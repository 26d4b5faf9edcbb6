"""SAR-LS: the offset by linear least squares from how readings change while the body turns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from flinders.estimators.base import Estimate
from flinders.estimators.reference.gyro_windows import cut, require_two_axes, sphere_about, steps_of

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.data import Readings


@dataclass(frozen=True, slots=True)
class SarLs:
    """Offset from field and angular rate, by linear least squares.

    Minimises ``Σ |ẋ + ω × (x − b)|²``. With W = [ω]× and y = ẋ + ω × x each reading says y = W b, so

        b = (Σ WᵀW)⁻¹ Σ Wᵀy                                             (section IV.A)

    ẋ is the difference of consecutive readings, as `flinders.estimators.reference.gyro_windows` has it: exact without
    noise.

    Use it for parity with the published method, or for an offset from a few tilts where the sphere is hardly seen. Not
    where accuracy counts: differences of readings are nearly all noise at high rates, a bias of the gyro moves the
    answer by about bias × field / rate, and soft iron is not seen at all. The angular rate aid of `flinders.fit` has
    none of the three.

    Notes
    -----
    Covariance: jackknife over twenty stretches of time, since the noise of differences is not independent. Soft
    iron left out of the model joins it (`flinders.estimators.bias_inflation`). The radius is that of the sphere about
    b.

    References
    ----------
    .. [1] G. Troni, L. L. Whitcomb, "Field sensor bias calibration with angular-rate sensors: theory and experimental
       evaluation with application to magnetometer calibration", IEEE/ASME Trans. Mechatronics 24 (2019) 1698–1710. The
       equations as in an implementation by its first author, whose element-wise square of W is no WᵀW and is not
       repeated.

    Examples
    --------
    A vehicle that tilts by 35° at most, without noise:

    >>> from flinders import simulate
    >>> from flinders.estimators.data import Readings
    >>> calm = simulate.Imu(gyro_noise=0.0)
    >>> bare = simulate.Sensor(offset=[20.0, 120.0, 90.0])
    >>> recording = simulate.tumble(seed=1, motion="swayed", n=500, sensor=bare, imu=calm)
    >>> SarLs().estimate(Readings.of(recording.samples)).ellipsoid.centre.round(6)
    array([ 20., 120.,  90.])
    """

    name: ClassVar[str] = "sar-ls"
    unknowns: ClassVar[int] = 5
    use: ClassVar[str] = "the offset from field and gyro by linear least squares: parity with Troni and Whitcomb"
    is_biased: ClassVar[bool] = True

    def estimate(self, readings: Readings) -> Estimate:
        """Find the offset.

        Raises
        ------
        TooFewSamples, OutOfScale, StuckAxis, Unmoved
            See `Readings.require`.
        NeedsSamples, NeedsRate
            If only sums were given; if there is no angular rate, or no times.
        OneAxisTurned
            If the body turned about one axis alone: Σ WᵀW is singular.
        """
        readings.require(self.unknowns, self.name)
        steps = steps_of(readings, self.name)
        require_two_axes(steps, self.name)
        origin, scale = readings.summary.moments.mean, readings.summary.moments.spread
        rate = np.concatenate([one.rate for one in steps])
        middle = np.concatenate([(one.middle - origin) / scale for one in steps])
        slope = np.concatenate([one.slope / scale for one in steps])
        matrices = np.einsum("ni,ni,jk->njk", rate, rate, np.eye(3)) - np.einsum("nj,nk->njk", rate, rate)  # WᵀW
        vectors = -np.cross(rate, slope + np.cross(rate, middle))  # Wᵀy
        begins = cut(len(rate))
        offset, covariance = jackknifed(np.add.reduceat(matrices, begins), np.add.reduceat(vectors, begins))
        ellipsoid, whole, noise = sphere_about(origin + scale * offset, readings, scale**2 * covariance)
        return Estimate(ellipsoid, whole, noise, self.name, used=len(readings.summary))


def jackknifed(matrices: Floats, vectors: Floats) -> tuple[Floats, Floats]:
    """Solve the normal equations of K blocks together, and without each in turn.

    Parameters
    ----------
    matrices : (K, P, P) float
    vectors : (K, P) float

    Returns
    -------
    solution : (P,) float
    covariance : (P, P) float
        (K − 1)/K Σ (θₖ − θ̄)(θₖ − θ̄)ᵀ over the solutions θₖ that have not seen one block.

    Examples
    --------
    The mean of four numbers, with its standard error:

    >>> mean, variance = jackknifed(np.ones((4, 1, 1)), np.array([[1.0], [2.0], [3.0], [4.0]]))
    >>> mean, variance.round(4)
    (array([2.5]), array([[0.4167]]))
    """
    matrix, vector = matrices.sum(axis=0), vectors.sum(axis=0)
    without = np.linalg.solve(matrix - matrices, (vector - vectors)[..., np.newaxis])[..., 0]
    apart = without - without.mean(axis=0)
    covariance: Floats = apart.T @ apart * ((len(apart) - 1) / len(apart))
    return np.linalg.solve(matrix, vector), covariance
