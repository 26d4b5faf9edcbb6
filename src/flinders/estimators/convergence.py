"""How an estimate settles while readings come in: what the sequential methods show beside their last word."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from flinders.estimators.estimate import Estimator

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators.readings import Readings


@dataclass(frozen=True, slots=True, eq=False)
class Convergence:
    """An estimate after the first readings, after more of them, and after all.

    Attributes
    ----------
    counts : (K,) int
        Readings seen at each step, ascending.
    parameters : (K, 9) float
        b₁, b₂, b₃, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃, in the unit of the readings; NaN where there was no ellipsoid yet.
    sigmas : (K, 9) float
        Standard deviation that the method claims of each.
    stages : tuple of str
        What was run at each step, where the method climbs from a simple model to richer ones; empty otherwise.
    """

    counts: NDArray[np.int64]
    parameters: Floats
    sigmas: Floats
    stages: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.counts)


class Sequential(Estimator, Protocol):
    """An estimator that takes readings one after the other, and can be watched."""

    def converge(self, readings: Readings, steps: int = 100) -> Convergence:
        """Follow the estimate at about so many steps, spread over the recording; the last is what `estimate` gives.

        Raises
        ------
        FitError
            As `estimate`.
        """
