"""SAR-LS: the offset by linear least squares from the change of readings and the angular rate.

Minimises ``Σ |ẋ + ω × (x − b)|²``. With W = [ω]× and y = ẋ + ω × x each reading gives y = W b, so

    b = (Σ WᵀW)⁻¹ Σ Wᵀy                                             (section IV.A)

ẋ is the difference of consecutive readings by `benchmarks.emulations.gyro_windows`, which is exact without noise. At
high rates of readings the differences are mostly noise. A bias of the gyro changes the offset by about bias × field /
rate. The model has no soft iron.

G. Troni, L. L. Whitcomb, "Field sensor bias calibration with angular-rate sensors: theory and experimental evaluation
with application to magnetometer calibration", IEEE/ASME Trans. Mechatronics 24 (2019) 1698–1710. The equations are
those of an implementation by the first author, except that it squares W element by element, which is not WᵀW.

A vehicle that tilts by at most 35°, without noise:

>>> from flinders import simulate
>>> calm = simulate.Imu(gyro_noise=0.0)
>>> bare = simulate.Sensor(offset=[20.0, 120.0, 90.0])
>>> recording = simulate.tumble(seed=1, motion="swayed", n=500, sensor=bare, imu=calm)
>>> sar_ls(recording.samples).centre.round(6)
array([ 20., 120.,  90.])
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.emulations.gyro_windows import sphere_about, steps_of
from flinders.summary.moments import Moments

if TYPE_CHECKING:
    from flinders import Samples
    from flinders.geometry.ellipsoid import Ellipsoid


def sar_ls(samples: Samples) -> Ellipsoid:
    """Sphere about the offset.

    Raises
    ------
    NeedsRate, OneAxisTurned
        See `benchmarks.emulations.gyro_windows.steps_of`.
    """
    steps = steps_of(samples)
    moments = Moments.of(samples.field)
    origin, scale = moments.mean, moments.spread
    rate = np.concatenate([one.rate for one in steps])
    middle = np.concatenate([(one.middle - origin) / scale for one in steps])
    slope = np.concatenate([one.slope / scale for one in steps])
    matrix = np.sum(rate**2) * np.eye(3) - rate.T @ rate  # Σ WᵀW
    vector = -np.cross(rate, slope + np.cross(rate, middle)).sum(axis=0)  # Σ Wᵀy
    return sphere_about(origin + scale * np.linalg.solve(matrix, vector), samples)
