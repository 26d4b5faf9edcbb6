"""Test for a disturbance that depends on the attitude, such as a current that follows it or a loose magnetic part.

A current that grows as a body leans moves the offset by P d, where d is the vertical by an accelerometer and P a
matrix. Offset and soft iron absorb most of this effect. The rest appears in the residuals as nᵀ P d, with the surface
normal n. The residuals are regressed on the nine products nᵢ dⱼ. Functions of the direction up to degree four,
including the ellipsoid, are removed from the products first, so that nonlinear axes are not mistaken for this fault.

Slow noise may follow the attitude by chance. This effect is estimated by residuals that are shifted in time against
the attitudes. Let c be the coefficients on an orthonormal basis of the products, and C the mean of c cᵀ over
all shifts. Then cᵀC⁻¹c is Hotelling's T² of a correlated series. For noise T² is about the number of coefficients, if
the correlation time is short against the recording. `MIN_T2` and `MIN_EXPLAINED` come from simulated noise (``python -m
benchmarks.adversary --felt``).

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> drive = simulate.tumble(seed=1).samples
>>> attitude_dependence_of(drive, calibrate.fit(drive).calibration.ellipsoid, dip_deg=60.0) is None
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.likelihood.dip import accelerometer_verticals
from flinders.likelihood.magnitude import distances, information
from flinders.summary.coverage import corrected_directions
from flinders.summary.moments import DEGREES, EXPONENTS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.geometry.ellipsoid import Ellipsoid

MIN_READINGS, MAX_READINGS = 100, 2000
"""Smallest count of readings for the test, and the count to which a longer recording is thinned evenly."""

MIN_TRUST: Final = 0.1
"""Smallest weight of a vertical; below it the body was accelerated."""

POWERS: Final = EXPONENTS[DEGREES >= 3]
"""(25, 3) exponents of monomials that span all functions on the sphere up to degree four."""

MIN_EIGENVALUE_RATIO: Final = 1e-8
"""Smallest ratio of an eigenvalue to the largest one; smaller ones are rounding errors."""

MIN_PRODUCT_RMS: Final = 0.05
"""Smallest rms of the part of a product nᵢ dⱼ that the direction of the field does not explain."""

MIN_SHIFT: Final = 0.05
"""Smallest shift of residuals in time, as a share of the recording; after a smaller shift they are still correlated."""

MIN_T2, MIN_EXPLAINED = 40.0, 0.1
"""Smallest T², and smallest explained share of the squared residuals, of a dependence on the attitude."""


@dataclass(frozen=True, slots=True)
class AttitudeDependence:
    """A disturbance of the readings that depends on the attitude."""

    # largest level heading error over all attitudes, without its mean, and without the part that offset and soft iron
    # absorb
    heading_deg: float
    explained: float  # share of the squared residuals that the disturbance explains
    significance: float  # T² of up to eight coefficients; by chance it is about the number of coefficients


def attitude_dependence_of(
    samples: Samples, ellipsoid: Ellipsoid, *, dip_deg: float, limit: float = math.inf
) -> AttitudeDependence | None:
    """Test whether residuals depend on the attitude; None if they do not, or the recording is not sufficient.

    `samples` are in the order of recording; `limit` is the largest distance of an inlier from the
    ellipsoid.
    """
    some = samples[:: -(-len(samples) // MAX_READINGS)]
    if some.acceleration is None:
        return None
    off = distances(some.field, ellipsoid)
    down, trust = accelerometer_verticals(some.acceleration)
    used = (np.abs(off) <= limit) & (trust > MIN_TRUST)
    off, down = off[used], down[used]
    if len(off) < MIN_READINGS:
        return None
    products = _products(corrected_directions(some.field[used], ellipsoid), down, ellipsoid)
    basis = _orthonormal(products, smallest=MIN_PRODUCT_RMS**2 * len(off))
    if not basis.shape[1]:
        return None
    coefficients = off @ products @ basis
    significance = _significance(products @ basis, off, coefficients)
    explained, total = float(coefficients @ coefficients), float(off @ off)
    if not (significance > MIN_T2 and explained > MIN_EXPLAINED * total):
        return None
    moved = down @ (basis @ coefficients).reshape(3, 3).T
    farthest = float(np.linalg.norm(moved - moved.mean(axis=0), axis=1).max())
    level = ellipsoid.radius * math.cos(math.radians(dip_deg))
    return AttitudeDependence(math.degrees(math.atan2(farthest, level)), explained / total, significance)


def _products(directions: Floats, down: Floats, ellipsoid: Ellipsoid) -> Floats:
    """(N, 9) products nᵢ dⱼ without the part that a function of the direction alone explains."""
    jacobian = information(directions, ellipsoid)
    alone = np.concatenate([jacobian, np.prod(directions[:, np.newaxis] ** POWERS, axis=2)], axis=1)
    alone /= np.linalg.norm(alone, axis=0)
    absorbed = alone @ _orthonormal(alone, smallest=0.0)
    products = np.reshape(jacobian[:, :3, np.newaxis] * down[:, np.newaxis], (len(down), 9))
    left: Floats = products - absorbed @ (absorbed.T @ products)
    return left


def _orthonormal(columns: Floats, *, smallest: float) -> Floats:
    """(K, k) coefficients of k orthonormal combinations of (N, K) columns with squares above `smallest`."""
    squares, vectors = np.linalg.eigh(columns.T @ columns)
    seen: NDArray[np.bool_] = squares > max(smallest, MIN_EIGENVALUE_RATIO * squares[-1])
    combinations: Floats = vectors[:, seen] / np.sqrt(squares[seen])
    return combinations


def _significance(basis: Floats, off: Floats, coefficients: Floats) -> float:
    """T² of coefficients on an orthonormal basis (N, k), against the coefficients of shifted residuals."""
    count, nearest = len(off), math.ceil(MIN_SHIFT * len(off))
    spectrum = np.conj(np.fft.rfft(off))[:, np.newaxis] * np.fft.rfft(basis, axis=0)
    shifted = np.fft.irfft(spectrum, count, axis=0)[nearest : count - nearest]
    scatter = shifted.T @ shifted / len(shifted)
    return float(coefficients @ np.linalg.pinv(scatter, rcond=MIN_EIGENVALUE_RATIO, hermitian=True) @ coefficients)
