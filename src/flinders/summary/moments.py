"""Sums of powers of a cloud of field vectors: all that an ellipsoid fit needs, in 35 numbers.

A quadric fit needs only the sums of the readings' monomials up to degree four. Sums add, so halves
of a log, processes of a batch and units of a fleet merge in any order, and a fit takes the same time
after a minute as after a year.

>>> cloud = np.random.default_rng(1).normal(size=(100, 3))
>>> whole = Moments.of(cloud)
>>> parts = Moments.of(cloud[:40]) + Moments.of(cloud[40:])
>>> np.allclose(parts.sums, whole.sums)
True
>>> whole.count, np.allclose(whole.mean, cloud.mean(axis=0))
(100.0, True)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import Floats, check_column, check_table
from flinders.core.samples import BLOCK_ROWS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

EXPONENTS: Final = np.array(
    sorted((e for e in product(range(5), repeat=3) if sum(e) <= 4), key=lambda e: (sum(e), e[::-1]))
)
"""(35, 3) int: powers (i, j, k) of each sum: 1, x, y, z, x², xy, y², xz, yz, z², … in order of degree."""

DEGREES: Final = EXPONENTS.sum(axis=1)

QUADRIC_EXPONENTS: Final = np.array(
    [(2, 0, 0), (0, 2, 0), (0, 0, 2), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0)]
)
"""(10, 3) int: powers of the monomials of a quadric, x², y², z², xy, xz, yz, x, y, z, 1."""

MIXED_TERM_FACTORS: Final = np.array([1, 1, 1, 2, 2, 2, 1, 1, 1, 1.0])
"""(10,) factors of the monomials in xᵀQx + lᵀx + d. The mixed terms xy, xz and yz occur twice."""

SMALLEST_UNIT: Final = 2.0**-1000

_EXPONENT_INDEX: Final = {tuple(e): i for i, e in enumerate(EXPONENTS.tolist())}
_PRODUCT_INDEX: Final = np.array(
    [[_EXPONENT_INDEX[tuple(row)] for row in np.add(form, QUADRIC_EXPONENTS).tolist()] for form in QUADRIC_EXPONENTS]
)
_FACTOR_PRODUCTS: Final = np.outer(MIXED_TERM_FACTORS, MIXED_TERM_FACTORS)


@dataclass(frozen=True, eq=False)
class Moments:
    """Weighted sums of xⁱyʲzᵏ for i + j + k ≤ 4, about zero."""

    sums: Floats  #: (35,): in the order of `EXPONENTS`; the first is the total weight
    #: Divisor of the readings before powers are taken: a power of two, at least as large as any reading. Division by it
    #: is exact, no power overflows, and moments are converted to a larger unit exactly.
    unit: float = SMALLEST_UNIT

    @classmethod
    def empty(cls) -> Self:
        """Sums of no readings: the identity of ``+``."""
        return cls(np.zeros(35))

    @classmethod
    def of(cls, field: ArrayLike, *, weight: ArrayLike | None = None) -> Self:
        """Sum the monomials of readings.

        Raises `ArrayError` for a wrong shape or values that are not finite.

        Parameters
        ----------
        field : (N, 3) array-like
            Raw readings in any unit.
        weight : (N,) array-like, optional
            Relative weight of each reading, by default 1.
        """
        readings = check_table(field)
        weights = None if weight is None else check_column(weight, len(readings), "weight")
        if not len(readings):
            return cls.empty()
        unit = power_of_two_above(max(float(readings.max()), -float(readings.min())))
        sums = np.zeros(35)
        room = np.empty((10, min(len(readings), BLOCK_ROWS)))
        for start in range(0, len(readings), BLOCK_ROWS):
            rows = slice(start, start + BLOCK_ROWS)
            monomials = _monomials(readings[rows].T, unit, room)
            sums += _block_sums(monomials, None if weights is None else weights[rows])
        return cls(sums, unit)

    def __add__(self, other: Moments) -> Self:
        unit = max(self.unit, other.unit)
        return replace(self, sums=self._convert_unit(unit) + other._convert_unit(unit), unit=unit)

    def __sub__(self, other: Moments) -> Self:
        """Subtract the sums of readings that were added before."""
        return self + other * -1.0

    def __mul__(self, factor: float) -> Self:
        """Multiply the weight of all readings. A factor below 1 after each block gives exponential forgetting."""
        return replace(self, sums=self.sums * factor)

    @property
    def count(self) -> float:
        """Total weight; equal to the number of readings if these have no weights."""
        return float(self.sums[0])

    @property
    def mean(self) -> Floats:
        """(3,) mean reading."""
        mean: Floats = self.sums[1:4] / self.sums[0] * self.unit
        return mean

    @property
    def spread(self) -> float:
        """Root mean square distance of the readings from their mean."""
        centred = self.about(self.mean, self.unit)
        return float(np.sqrt(max(np.trace(centred[6:9, 6:9]), 0.0) / self.sums[0]) * self.unit)

    @cached_property
    def covariance(self) -> Floats:
        """(3, 3) covariance of the readings about their mean, in the square of their unit."""
        centred = self.about(self.mean, self.unit)
        covariance: Floats = centred[6:9, 6:9] / self.sums[0] * self.unit**2
        return covariance

    @cached_property
    def principal_variances(self) -> Floats:
        """(3,) variances of the readings along their principal axes, ascending."""
        variances: Floats = np.linalg.eigvalsh(self.covariance).clip(min=0.0)
        return variances

    def about(self, origin: ArrayLike, scale: float) -> Floats:
        """Scatter matrix of the ten monomials of a quadric, in shifted and scaled coordinates.

        With z = (x − origin)/scale and φ(z) = (z₁², z₂², z₃², 2z₁z₂, 2z₁z₃, 2z₂z₃, z₁, z₂, z₃, 1), the matrix is
        Σ w φφᵀ. φ(z) is a linear function of φ(x), so the readings are not needed again.
        The shift loses precision: an origin at m times the radius of the cloud gives a relative error of
        about m⁴ · 10⁻¹⁵ (compared with exact arithmetic in ``tests/summary/test_moments.py``).

        Parameters
        ----------
        origin : (3,) array-like
            In the unit of the readings.
        scale : float
            In the unit of the readings.

        Returns
        -------
        (10, 10) float
        """
        shift = _shift_matrix(np.asarray(origin, float) / self.unit, scale / self.unit)
        scatter: Floats = shift @ self.sums[_PRODUCT_INDEX] @ shift.T * _FACTOR_PRODUCTS
        return scatter

    def _convert_unit(self, unit: float) -> Floats:
        """(35,) sums in a larger unit; the conversion is exact."""
        return self.sums if unit == self.unit else self.sums * (self.unit / unit) ** DEGREES

    def __repr__(self) -> str:
        return (
            f"Moments({self.count:g} readings about {np.array2string(self.mean, precision=4)})"
            if self.count
            else "Moments()"
        )


def power_of_two_above(value: float) -> float:
    """Smallest power of two that is at least `value`, and at least `SMALLEST_UNIT`."""
    mantissa, exponent = math.frexp(max(value, SMALLEST_UNIT))
    return math.ldexp(1.0, min(exponent - (mantissa == 0.5), 1023))


def _monomials(axes: Floats, unit: float, room: Floats) -> Floats:
    """(10, m) monomials 1, x, y, z, x², y², z², xy, xz, yz of one block of (3, m) readings."""
    # Written into `room`, (10, m or more): allocation for each block would take a quarter more time
    # (``python -m benchmarks.kernel``).
    monomials = room[:, : axes.shape[1]]
    monomials[0] = 1.0
    scaled = np.multiply(axes, 1.0 / unit, out=monomials[1:4])  # exact: the unit is a power of two
    np.multiply(scaled, scaled, out=monomials[4:7])
    np.multiply(scaled[0], scaled[1:], out=monomials[7:9])
    np.multiply(scaled[1], scaled[2], out=monomials[9])
    return monomials


def _block_sums(monomials: Floats, weight: Floats | None) -> Floats:
    """(35,) weighted sums of one block of (10, m) monomials."""
    # The product of all ten monomials with the six quadratic ones contains all sums of degree two to four.
    weighted = monomials if weight is None else monomials * weight
    sums = np.empty(35)
    sums[:4] = weighted[:4].sum(axis=1)
    sums[4:] = (weighted @ monomials[4:].T).ravel()[_FROM_BLOCK]
    return sums


_BLOCK_FORMS: Final = QUADRIC_EXPONENTS[[9, 6, 7, 8, 0, 1, 2, 3, 4, 5]]
_FROM_BLOCK: Final = np.array(
    [
        next(
            row * 6 + col
            for row, col in product(range(10), range(6))
            if (_BLOCK_FORMS[row] + _BLOCK_FORMS[4 + col] == exponents).all()
        )
        for exponents in EXPONENTS[4:]
    ]
)


def _shift_matrix(origin: Floats, scale: float) -> Floats:
    """(10, 10) matrix from the monomials of x to those of (x − origin)/scale; mixed terms occur once."""
    x, y, z = origin
    shift = np.eye(10)
    shift[:6, 9] = x * x, y * y, z * z, x * y, x * z, y * z
    shift[0, 6], shift[1, 7], shift[2, 8] = -2 * x, -2 * y, -2 * z
    shift[3, 6], shift[3, 7] = -y, -x
    shift[4, 6], shift[4, 8] = -z, -x
    shift[5, 7], shift[5, 8] = -z, -y
    shift[6:9, 9] = -origin
    scaled: Floats = shift * (float(scale) ** -QUADRIC_EXPONENTS.sum(axis=1, dtype=float))[:, np.newaxis]
    return scaled
