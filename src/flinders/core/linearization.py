"""Linearization of nonlinear axes: quadratic and cubic terms that are subtracted from a reading.

A reading d of an axis, relative to its offset, is corrected to ``d - (quadratic + cubic d) d²``, a polynomial of third
order.

>>> curve = Linearization([0.001, 0, 0], [0, 1e-5, 0], [60, 60, 60])
>>> curve.apply([50.0, 50.0, 50.0])
array([47.5 , 48.75, 50.  ])
>>> curve.invert(curve.apply([50.0, -50.0, 50.0])).round(9)
array([ 50., -50.,  50.])
>>> curve.apply([90.0, 90.0, 90.0]) - 90.0                            # as at 60
array([-3.6 , -2.16,  0.  ])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import Floats, Value, check_triple, check_vectors, read_only_copy
from flinders.errors import ArrayError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

BISECTIONS: Final = 60
"""Count of bisections after which a departure is known to the last bit."""

MAX_SLOPE_RATIO: Final = 5.0
"""Largest ratio of two slopes of an axis, one at the offset and the other anywhere within the limit."""


@dataclass(frozen=True, eq=False)
class Linearization(Value):
    """Quadratic and cubic terms of the three axes, as functions of the departure: a reading minus the offset.

    A departure beyond `limit` is corrected by the same amount as at the limit. Otherwise the polynomial could turn back
    and map a strongly disturbed reading to a plausible one.

    Raises
    ------
    ArrayError
        Unless `quadratic`, `cubic` and `limit` are three finite numbers each, the limits are positive, and each axis is
        monotonic within its limit with a slope within `MAX_SLOPE_RATIO`.
    """

    quadratic: Floats  #: (3,), one over the unit of the readings; read-only
    cubic: Floats  #: (3,), one over the square of the unit; read-only
    limit: Floats  #: (3,), in the unit of the readings: largest departure at which the terms hold; read-only

    def __post_init__(self) -> None:
        """Check the numbers and keep read-only copies of them."""
        for name in ("quadratic", "cubic", "limit"):
            object.__setattr__(self, name, read_only_copy(check_triple(getattr(self, name), name)))
        if not self.limit.min() > 0.0:
            raise ArrayError(f"limit of the linearization is {self.limit.tolist()}: need three positive numbers")
        with np.errstate(over="ignore", invalid="ignore"):
            read = np.linspace(-1.0, 1.0, 49)[:, np.newaxis] * self.limit
            slopes = 1.0 - (2.0 * self.quadratic + 3.0 * self.cubic * read) * read
            is_straight = ((slopes > 1.0 / MAX_SLOPE_RATIO) & (slopes < MAX_SLOPE_RATIO)).all(axis=0)
        if not is_straight.all():
            axis = "xyz"[int(np.argmin(is_straight))]
            raise ArrayError(
                f"the linearization bends axis {axis} too much within {self.limit.max():.4g} of the offset: need a "
                f"slope between {1.0 / MAX_SLOPE_RATIO:g} and {MAX_SLOPE_RATIO:g} times that at the offset"
            )

    def as_dict(self) -> dict[str, list[float]]:
        """The terms and their limit by name, JSON-ready."""
        return {name: getattr(self, name).tolist() for name in ("quadratic", "cubic", "limit")}

    def apply(self, departures: ArrayLike) -> Floats:
        """Linearize (..., 3) departures from the offset."""
        read = check_vectors(departures, "departures", finite=False)
        held = read.clip(-self.limit, self.limit)
        linear: Floats = read - (self.quadratic + self.cubic * held) * held**2
        return linear

    def invert(self, linear: ArrayLike) -> Floats:
        """(..., 3) departures that `apply` maps to (..., 3) linearized ones, by bisection."""
        wanted = check_vectors(linear, "linear", finite=False)
        most = (np.abs(self.quadratic) + np.abs(self.cubic) * self.limit) * self.limit**2
        low, high = wanted - most, wanted + most
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            is_below = self.apply(middle) < wanted
            low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
        return np.asarray(0.5 * (low + high))


def have_equal_linearization(
    one: Linearization | None, other: Linearization | None, shape: Floats, tolerance: float
) -> bool:
    """Whether two linearizations agree within `tolerance`, in the unit of the readings.

    They are compared at the largest reading of each axis, by the (3, 3) `shape` of the ellipsoid of readings.
    """
    if one is None or other is None:
        return one is other
    reach = np.linalg.norm(shape, axis=1) * np.array([[-1.0], [1.0]])
    return bool(np.abs(one.apply(reach) - other.apply(reach)).max() <= tolerance)
