"""The heading error that is not exceeded at any heading of a level turn, with a probability of 95 %.

The error at the worst heading, 1 σ, belongs to one heading; the largest error of a whole turn is mostly larger. To
first order the heading errs by B sin ζ + C cos ζ + D sin 2ζ + E cos 2ζ, where (B, C, D, E) = L z, z of four independent
normal numbers. With z = r θ, r its length and θ its direction, the largest error is r m(θ), m = max over ζ, and

    P(largest ≤ u) = mean over θ of F(u / m(θ)),      F(x) = 1 − (1 + x²/2) exp(−x²/2)

F the distribution of r. The mean is taken over 128 even directions (I. Deák, Numer. Math. 35 (1980) 369;
A. Genz and F. Bretz, "Computation of Multivariate Normal and t Probabilities", Springer (2009), sect. 4.1).
`tests/truth/test_confidence.py` compares it with simulated errors.

>>> one_circle = np.diag([1.0, 1.0, 0.0, 0.0])           # an amplitude that Rayleigh's law gives: √(2 ln 20)
>>> bounds_deg(np.stack([one_circle, 4.0 * one_circle])).round(2).tolist()
[2.44, 4.88]
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.geometry.ellipsoid import GATHER
from flinders.heading.error_propagation import deviation_covariance

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.geometry.ellipsoid import Ellipsoid

PROBABILITY: Final = 0.95
HEADINGS: Final = 36
DIRECTIONS: Final = 128
FEW: Final = 8
"""Headings that determine a deviation of two harmonics."""
LEAST, MOST, START = 1.9599, 3.0803, 2.4
"""Bound over the worst 1 σ: of one heading alone, of the length of four independent numbers, and first guess."""
STEPS: Final = 3
NEGLIGIBLE: Final = 0.1
"""Largest error over the worst 1 σ of directions that lie outside the bound with a probability below 1e-80."""
CHUNK: Final = 32
"""Units of which the errors are in memory at a time: 1.2 MB."""
TINY: Final = np.finfo(float).tiny


def level_bound_deg(
    ellipsoid: Ellipsoid, covariance: Floats, *, dip_deg: float = 60.0, down: Floats | None = None
) -> float:
    """Bound the heading error of a level vehicle, degrees; parameters as those of `level_error`."""
    deviation = deviation_covariance(ellipsoid, covariance, dip_deg=dip_deg, down=down)
    return float(bounds_deg(deviation[np.newaxis])[0])


def bounds_deg(covariances: Floats) -> Floats:
    """Bound the heading errors of U level turns.

    Parameters
    ----------
    covariances : (U, 4, 4) degrees²
        Of B, C, D and E, as `flinders.heading.error_propagation.deviation_covariance`.

    Returns
    -------
    (U,) degrees
        That the error exceeds at no heading with a probability of 95 %; NaN where the covariance is not known.
    """
    parts = [_bounds(covariances[at : at + CHUNK]) for at in range(0, len(covariances), CHUNK)]
    return np.concatenate([*parts, np.empty(0)])


def deviation_covariances(shapes: Floats, covariances: Floats, dips_deg: Floats) -> Floats:
    """Carry covariances of (b, S) over to the deviations of level vehicles, z down.

    Parameters
    ----------
    shapes : (U, 3, 3) float
    covariances : (U, 9, 9) float
        In the square of the unit of the shapes.
    dips_deg : (U,) degrees

    Returns
    -------
    (U, 4, 4) degrees²
        Of B, C, D and E, as `flinders.heading.error_propagation.deviation_covariance` of each.
    """
    dip = np.deg2rad(dips_deg)[:, np.newaxis]
    heading = np.arange(FEW) * (2.0 * np.pi / FEW)
    sine, cosine, level = np.sin(heading), np.cos(heading), np.cos(dip)
    fields = np.stack([level * cosine, -level * sine, np.sin(dip) + 0.0 * sine], axis=1)  # (U, 3, 8)
    across = np.stack([sine / level, cosine / level, 0.0 * fields[:, 2]], axis=1)
    vectors = np.linalg.solve(shapes, across)
    products = (vectors[:, :, np.newaxis] * fields[:, np.newaxis]).reshape(len(shapes), 9, FEW)
    gradients = GATHER.T @ np.concatenate([vectors, products], axis=1)  # (U, 9, 8)
    jacobian = np.rad2deg(2.0 / FEW * gradients @ _harmonics(FEW))
    carried: Floats = np.swapaxes(jacobian, 1, 2) @ covariances @ jacobian
    return carried


def _bounds(covariances: Floats) -> Floats:
    """The same for as many units as fit into memory."""
    sums: Floats = covariances.sum(axis=(1, 2))
    is_known = np.isfinite(sums)
    variances, axes = np.linalg.eigh(np.where(is_known[:, np.newaxis, np.newaxis], covariances, 0.0))
    roots = axes * np.sqrt(variances.clip(min=0.0))[:, np.newaxis, :]
    courses = _harmonics() @ roots  # (U, 36, 4): error at each heading per unit of z
    worst = np.sqrt(np.sum(courses**2, axis=2).max(axis=1))
    errors = courses @ _even_directions()  # (U, 36, 128)
    largest = np.abs(errors, out=errors).max(axis=1)
    return np.where(is_known, worst * _quantiles(largest / np.maximum(worst, TINY)[:, np.newaxis]), np.nan)


def _quantiles(largest: Floats) -> Floats:
    """(U,) bounds from (U, 128) largest errors per unit length of z, both over the worst 1 σ, by Newton's method."""
    inverse = 0.5 / np.maximum(largest, NEGLIGIBLE) ** 2
    square = np.full((len(largest), 1), START**2)
    for _ in range(STEPS):  # the logarithm of the probability outside is nearly linear in the square of the bound
        half = square * inverse
        tail = np.exp(-half)
        outside = ((1.0 + half) * tail).mean(axis=1, keepdims=True)
        slope = (half * half * tail).mean(axis=1, keepdims=True)
        square *= 1.0 + outside * np.log(outside / (1.0 - PROBABILITY)) / slope
        square = square.clip(LEAST**2, MOST**2)
    quantiles: Floats = np.sqrt(square[:, 0])
    return quantiles


@lru_cache(maxsize=2)
def _harmonics(headings: int = HEADINGS) -> Floats:
    """(K, 4) sine and cosine of K headings and of their doubles."""
    heading = np.arange(headings) * (2.0 * np.pi / headings)
    return np.stack([np.sin(heading), np.cos(heading), np.sin(2.0 * heading), np.cos(2.0 * heading)], axis=1)


@lru_cache(maxsize=1)
def _even_directions() -> Floats:
    """(4, 128) even directions in four dimensions, up to their sign: a super-Fibonacci spiral (M. Alexa, CVPR 2022)."""
    place = (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    turns = 2.0 * np.pi * DIRECTIONS * place
    first, second = turns / np.sqrt(2.0), turns / 1.533751168755204288118041
    inner, outer = np.sqrt(place), np.sqrt(1.0 - place)
    return np.stack([inner * np.sin(first), inner * np.cos(first), outer * np.sin(second), outer * np.cos(second)])
