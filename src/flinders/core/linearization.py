"""Axes that answer the field along a curve: quadratic and cubic terms that are taken off a reading.

An axis that reads d from its offset takes the field for ``d - (quadratic + cubic d) d²``.

>>> curve = Linearization([0.001, 0, 0], [0, 1e-5, 0])
>>> curve.apply([50.0, 50.0, 50.0])
array([47.5 , 48.75, 50.  ])
>>> curve.invert(curve.apply([50.0, -50.0, 50.0])).round(9)
array([ 50., -50.,  50.])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import Floats, Value, floats, frozen, triple, vectors
from flinders.errors import ArrayError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

STEPS: Final = 20
"""Newton's; three are enough where the terms are a few percent."""

LEAST_SLOPE: Final = 0.2
"""Of what is left of a reading, where the axis answers with 1 at its offset: less of it tells no field."""

MARGIN: Final = 1.2
"""Readings are this much farther from the offset than the field alone makes them, at most."""


@dataclass(frozen=True, eq=False)
class Linearization(Value):
    """Terms of the three axes, by departure from the offset: raises `ArrayError` for any but three finite numbers."""

    quadratic: Floats  #: (3,), one over the unit of the readings; read-only
    cubic: Floats  #: (3,), one over its square; read-only

    def __post_init__(self) -> None:
        """Check the numbers and keep read-only copies of them."""
        object.__setattr__(self, "quadratic", frozen(triple(self.quadratic, "quadratic")))
        object.__setattr__(self, "cubic", frozen(triple(self.cubic, "cubic")))

    def apply(self, departures: ArrayLike) -> Floats:
        """(..., 3) linear departures from the offset of (..., 3) that were read."""
        read = vectors(departures, "departures", finite=False)
        linear: Floats = read - (self.quadratic + self.cubic * read) * read**2
        return linear

    def invert(self, linear: ArrayLike) -> Floats:
        """(..., 3) departures that are read where they are linear: by Newton's method, from the linear ones on."""
        wanted = vectors(linear, "linear", finite=False)
        read = wanted.copy()
        with np.errstate(all="ignore"):
            for _ in range(STEPS):
                read -= (self.apply(read) - wanted) / self.slope(read)
        return read

    def slope(self, departures: ArrayLike) -> Floats:
        """(..., 3) by how much a linear departure grows with one that is read."""
        read = floats(departures, "departures")
        return floats(1.0 - (2.0 * self.quadratic + 3.0 * self.cubic * read) * read)

    def refuse_folded(self, reach: Floats) -> None:
        """Raise `ArrayError` where two readings within (3,) `reach` of the offset, and a margin, may be one field."""
        least = self.slope(np.linspace(-MARGIN, MARGIN, 49)[:, np.newaxis] * reach).min(axis=0)
        if not least.min() >= LEAST_SLOPE:
            axis = "xyz"[int(np.argmin(least))]
            raise ArrayError(
                f"the linearization of axis {axis} takes {1.0 - least.min():.0%} of a change of the field off: need at "
                f"most {1.0 - LEAST_SLOPE:.0%}, or readings tell no field"
            )
