"""Moments of many units at once: the 35 sums of `flinders.summary.moments`, unit by unit.

>>> import numpy as np
>>> from flinders.summary.moments import Moments
>>> field = np.random.default_rng(1).normal(size=(2, 50, 3)) + 3.0
>>> sums = BatchMoments.of(np.swapaxes(field, 1, 2))
>>> alone = Moments.of(field[1])
>>> np.allclose(sums.values[1], alone.sums), float(sums.unit[1]) == alone.unit, np.allclose(sums.mean[1], alone.mean)
(True, True, True)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Self

import numpy as np

from flinders.stacked.algebra import ENOUGH, POWERS, Array, in_segments, like, monomials, namespace, rows_like, turned
from flinders.summary.moments import EXPONENTS, FORMS, SMALLEST_UNIT, packing

PACKING: Final = packing()
_LARGEST: Final = 2.0**1023
"""Power of two that there is."""

_DEGREES: Final = FORMS.sum(axis=1).astype(float)

_ROWS: Final = np.concatenate([POWERS, np.zeros((1, 3), int)])
_COLUMNS: Final = np.concatenate([POWERS[ENOUGH], np.zeros((1, 3), int)])
_FROM_PRODUCTS: Final = np.array(
    [
        next(5 * row + column for row, column in np.ndindex(10, 5) if (_ROWS[row] + _COLUMNS[column] == e).all())
        for e in EXPONENTS
    ]
)
"""(35,) where each sum stands in the flat (10, 5) products of `monomials` and one with those of `ENOUGH` and one."""


@dataclass(frozen=True, eq=False)
class BatchMoments:
    """Moments about zero of U units.

    Attributes
    ----------
    values : (U, 35)
        In the order of `flinders.summary.moments.EXPONENTS`.
    unit : (U,)
        Powers of two that readings were divided by.
    """

    values: Array
    unit: Array

    @classmethod
    def of(cls, readings: Array, inside: Array | None = None, largest: Array | None = None) -> Self:
        """Add up finite readings.

        Parameters
        ----------
        readings : (U, 3, N) or (U, 4, N)
            The latter `with_ones`.
        inside : (U, N), optional
            1 for readings, 0 for what fills the rows up.
        largest : (U,), optional
            Absolute value of a coordinate, where that is known.
        """
        if largest is None:
            xp = namespace(readings)
            largest = xp.max(xp.abs(readings[:, :3, :]), axis=(1, 2))
        values, unit = in_segments(_summed, readings, inside, powers_of_two_above(largest))
        return cls(values, unit)

    def only(self, which: Array) -> Self:
        """Those units that (K,) ascending integers name."""
        if which.shape[0] == self.unit.shape[0]:
            return self
        xp = namespace(which)
        return type(self)(xp.take(self.values, which, axis=0), xp.take(self.unit, which))

    @property
    def count(self) -> Array:
        """(U,) readings."""
        return self.values[:, 0]

    @cached_property
    def mean(self) -> Array:
        """(U, 3) in the unit of the readings."""
        return self.values[:, 1:4] / self.values[:, :1] * self.unit[:, None]

    @cached_property
    def covariance(self) -> Array:
        """(U, 3, 3) about the mean, in the square of the readings' unit."""
        xp = namespace(self.values)
        centred = self.about(self.mean, self.unit)
        covariance = centred[:, 6:9, 6:9] / self.count[:, None, None] * (self.unit**2)[:, None, None]
        return xp.asarray(covariance)

    @cached_property
    def spread(self) -> Array:
        """(U,) root mean square distance of the readings from their mean."""
        xp = namespace(self.values)
        return xp.sqrt(xp.maximum(xp.linalg.trace(self.covariance), 0.0))

    def about(self, origin: Array, scale: Array) -> Array:
        """(U, 10, 10) scatter matrices seen from (U, 3) origins in (U,) scales, as `Moments.about`."""
        xp = namespace(self.values)
        shift = _shifts(origin / self.unit[:, None], scale / self.unit)
        products = xp.take(self.values, like(PACKING.product.ravel(), self.values), axis=1)
        scatter = shift @ xp.reshape(products, (-1, 10, 10)) @ xp.matrix_transpose(shift)
        return scatter * like(PACKING.doubled, self.values)


def _summed(readings: Array, inside: Array | None, unit: Array) -> tuple[Array, Array]:
    """(u, 35) sums and (u,) units of one stretch."""
    xp = namespace(readings)
    scale = (1.0 / unit)[:, None, None] * like(np.eye(3), readings)
    rows = monomials(turned(scale, readings[:, :3, :]), room=1)  # exact: units are powers of two
    rows[:, 9, :] = 1.0
    others = rows_like(readings, 5)
    others[:, :4, :] = rows[:, ENOUGH, :]
    others[:, 4, :] = 1.0
    if inside is not None:
        others *= inside[:, None, :]
    products = xp.reshape(rows @ xp.matrix_transpose(others), (-1, 50))
    return xp.take(products, like(_FROM_PRODUCTS, readings), axis=1), unit


def powers_of_two_above(values: Array) -> Array:
    """(U,) smallest powers of two that are at least (U,) values, as `flinders.summary.moments.power_of_two_above`.

    The logarithm of what is just above a power of two is rounded to a whole number, and those of other libraries may be
    a little off even at one; comparing finds both.

    >>> import numpy as np
    >>> powers_of_two_above(np.array([0.0, 4.0, np.nextafter(4.0, 5.0)])) == [2.0**-1000, 4.0, 8.0]
    array([ True,  True,  True])
    """
    xp = namespace(values)
    values = xp.clip(values, SMALLEST_UNIT, _LARGEST)
    power = 2.0 ** xp.ceil(xp.log2(values))
    power = xp.where(power < values, 2.0 * power, power)
    return xp.where(0.5 * power >= values, 0.5 * power, power)


def _shifts(origin: Array, scale: Array) -> Array:
    """(U, 10, 10) matrices that turn the monomials of x into those of (x − origin)/scale."""
    xp = namespace(origin)
    x, y, z = origin[:, 0], origin[:, 1], origin[:, 2]
    shift = xp.zeros((origin.shape[0], 10, 10), dtype=origin.dtype, device=origin.device)
    for place in range(10):
        shift[:, place, place] = 1.0
    for row, entry in enumerate((x * x, y * y, z * z, x * y, x * z, y * z, -x, -y, -z)):
        shift[:, row, 9] = entry
    for row, axis, entry in (
        (0, 6, 2 * x), (1, 7, 2 * y), (2, 8, 2 * z), (3, 6, y), (3, 7, x), (4, 6, z), (4, 8, x), (5, 7, z), (5, 8, y),
    ):  # fmt: skip
        shift[:, row, axis] = -entry
    return shift * (scale[:, None] ** -like(_DEGREES, origin)[None, :])[:, :, None]
