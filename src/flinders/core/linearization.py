"""Axes that answer the field along a curve: quadratic and cubic terms that are taken off a reading.

An axis that reads d from its offset takes the field for ``d - (quadratic + cubic d) d²``: a nonlinearity correction by
a polynomial of third order.

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

from flinders.arrays import Floats, Value, frozen, triple, vectors
from flinders.errors import ArrayError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

HALVINGS: Final = 60
"""Of an interval, until a departure is known to the last bit."""

STEEPEST: Final = 5.0
"""How many times as steep an axis may answer as at its offset, or as flat: beyond that it tells little of the field."""


@dataclass(frozen=True, eq=False)
class Linearization(Value):
    """Terms of the three axes, by departure from the offset.

    Departures beyond `limit` are corrected by as much as those at it: no disturbed reading folds back to a likely one.

    Raises
    ------
    ArrayError
        For any but three finite numbers each, a limit that is not positive, or an axis that answers too steeply, too
        flatly or not in one direction alone within it.
    """

    quadratic: Floats  #: (3,), one over the unit of the readings; read-only
    cubic: Floats  #: (3,), one over its square; read-only
    limit: Floats  #: (3,), in the unit of the readings: how far from the offset the terms hold; read-only

    def __post_init__(self) -> None:
        """Check the numbers and keep read-only copies of them."""
        for name in ("quadratic", "cubic", "limit"):
            object.__setattr__(self, name, frozen(triple(getattr(self, name), name)))
        if not self.limit.min() > 0.0:
            raise ArrayError(f"limit of the linearization is {self.limit.tolist()}: need three positive departures")
        with np.errstate(over="ignore", invalid="ignore"):
            read = np.linspace(-1.0, 1.0, 49)[:, np.newaxis] * self.limit
            slopes = 1.0 - (2.0 * self.quadratic + 3.0 * self.cubic * read) * read
            is_straight = ((slopes > 1.0 / STEEPEST) & (slopes < STEEPEST)).all(axis=0)
        if not is_straight.all():
            axis = "xyz"[int(np.argmin(is_straight))]
            raise ArrayError(
                f"the linearization bends axis {axis} too much within {self.limit.max():.4g} of the offset: its slope "
                f"has to stay between {1.0 / STEEPEST:g} and {STEEPEST:g} of that at the offset"
            )

    def as_dict(self) -> dict[str, list[float]]:
        """The terms and their limit by name, ready for JSON."""
        return {name: getattr(self, name).tolist() for name in ("quadratic", "cubic", "limit")}

    def apply(self, departures: ArrayLike) -> Floats:
        """(..., 3) linear departures from the offset of (..., 3) that were read."""
        read = vectors(departures, "departures", finite=False)
        held = read.clip(-self.limit, self.limit)
        linear: Floats = read - (self.quadratic + self.cubic * held) * held**2
        return linear

    def invert(self, linear: ArrayLike) -> Floats:
        """(..., 3) departures that are read where they are linear: by bisection, since one grows with the other."""
        wanted = vectors(linear, "linear", finite=False)
        most = (np.abs(self.quadratic) + np.abs(self.cubic) * self.limit) * self.limit**2
        low, high = wanted - most, wanted + most
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            is_below = self.apply(middle) < wanted
            low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
        return np.asarray(0.5 * (low + high))


def bend_alike(one: Linearization | None, other: Linearization | None, shape: Floats, tolerance: float) -> bool:
    """Whether both linearize axes alike, to within `tolerance` where the field of a (3, 3) shape lies along them."""
    if one is None or other is None:
        return one is other
    reach = np.linalg.norm(shape, axis=1) * np.array([[-1.0], [1.0]])
    return bool(np.abs(one.apply(reach) - other.apply(reach)).max() <= tolerance)
