"""Whether readings are disturbed in step with the attitude: by a current that follows it, or by a loose magnetic part.

A load that grows as a body leans moves the offset by P d, for the vertical d that an accelerometer shows. Most of that
hides in offset and soft iron. The rest is in the residuals as nᵀ P d, with the surface normal n: they are regressed on
the nine products nᵢ dⱼ, less what the ellipsoid and any function of the direction up to degree four explain, so that
axes that are not linear explain nothing here.

Slow noise follows an attitude by chance. How far it does is seen by shifting the residuals in time against the
attitudes: for the coefficients c on an orthonormal basis of the products, with the mean C of c cᵀ over all shifts,
cᵀC⁻¹c is Hotelling's T² of a correlated series, about their number for noise of any memory that is short against the
recording. `PROVEN` and `MUCH` come from simulated noise (``python -m benchmarks.adversary --felt``).

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

from flinders.likelihood.dip import verticals
from flinders.likelihood.magnitude import distances, information
from flinders.summary.coverage import directions_of
from flinders.summary.moments import DEGREES, EXPONENTS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.geometry.ellipsoid import Ellipsoid

FEWEST, MOST = 100, 2000
"""Readings: fewer say too little; of more some are looked at, evenly spaced."""

TRUSTED: Final = 0.1
"""Trust in a vertical below which the body was accelerated."""

POWERS: Final = EXPONENTS[DEGREES >= 3]
"""(25, 3) monomials: on the sphere all functions up to degree four."""

INDEPENDENT: Final = 1e-8
"""Of the largest eigenvalue: what is smaller is rounding."""

SEEN: Final = 0.05
"""Root mean square of a product that the direction of the field does not explain, from which it is told."""

NEAR: Final = 0.05
"""Share of the recording by which residuals are shifted at least: a smaller shift leaves much of them in place."""

PROVEN, MUCH = 40.0, 0.1
"""T², and share of the square of the residuals, from which on they follow the attitude."""


@dataclass(frozen=True, slots=True)
class AttitudeDependence:
    """A disturbance of the readings that follows the attitude."""

    # what it makes of a level heading at the attitude where it is largest, about its mean; without the part that hides
    # in offset and soft iron
    heading_deg: float
    explained: float  # share of the square of the residuals that it explains
    significance: float  # T² of up to eight coefficients: about their number by chance


def attitude_dependence_of(
    samples: Samples, ellipsoid: Ellipsoid, *, dip_deg: float, limit: float = math.inf
) -> AttitudeDependence | None:
    """Test whether residuals follow the attitude; None where they do not, or nothing tells.

    `samples`: in the order of recording; `limit`: distance from the ellipsoid beyond which readings are outliers.
    """
    some = samples[:: -(-len(samples) // MOST)]
    if some.acceleration is None:
        return None
    off = distances(some.field, ellipsoid)
    down, trust = verticals(some.acceleration)
    used = (np.abs(off) <= limit) & (trust > TRUSTED)
    off, down = off[used], down[used]
    if len(off) < FEWEST:
        return None
    products = _products(directions_of(some.field[used], ellipsoid), down, ellipsoid)
    basis = _orthonormal(products, smallest=SEEN**2 * len(off))
    if not basis.shape[1]:
        return None
    coefficients = off @ products @ basis
    significance = _significance(products @ basis, off, coefficients)
    explained, total = float(coefficients @ coefficients), float(off @ off)
    if not (significance > PROVEN and explained > MUCH * total):
        return None
    moved = down @ (basis @ coefficients).reshape(3, 3).T
    farthest = float(np.linalg.norm(moved - moved.mean(axis=0), axis=1).max())
    level = ellipsoid.radius * math.cos(math.radians(dip_deg))
    return AttitudeDependence(math.degrees(math.atan2(farthest, level)), explained / total, significance)


def _products(directions: Floats, down: Floats, ellipsoid: Ellipsoid) -> Floats:
    """(N, 9) nᵢ dⱼ less what a function of the direction alone explains."""
    jacobian = information(directions, ellipsoid)
    alone = np.concatenate([jacobian, np.prod(directions[:, np.newaxis] ** POWERS, axis=2)], axis=1)
    alone /= np.linalg.norm(alone, axis=0)
    absorbed = alone @ _orthonormal(alone, smallest=0.0)
    products = np.reshape(jacobian[:, :3, np.newaxis] * down[:, np.newaxis], (len(down), 9))
    left: Floats = products - absorbed @ (absorbed.T @ products)
    return left


def _orthonormal(columns: Floats, *, smallest: float) -> Floats:
    """(K, k) combinations of (N, K) columns that are orthonormal, of those with a square above the smallest."""
    squares, vectors = np.linalg.eigh(columns.T @ columns)
    seen: NDArray[np.bool_] = squares > max(smallest, INDEPENDENT * squares[-1])
    combinations: Floats = vectors[:, seen] / np.sqrt(squares[seen])
    return combinations


def _significance(basis: Floats, off: Floats, coefficients: Floats) -> float:
    """T² of coefficients on an orthonormal basis (N, k), against those of residuals that are shifted."""
    count, nearest = len(off), math.ceil(NEAR * len(off))
    spectrum = np.conj(np.fft.rfft(off))[:, np.newaxis] * np.fft.rfft(basis, axis=0)
    shifted = np.fft.irfft(spectrum, count, axis=0)[nearest : count - nearest]
    scatter = shifted.T @ shifted / len(shifted)
    return float(coefficients @ np.linalg.pinv(scatter, rcond=INDEPENDENT, hermitian=True) @ coefficients)
