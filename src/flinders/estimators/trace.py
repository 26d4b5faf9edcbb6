"""How an estimate settles while readings come in: what the sequential methods show beside their last word."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, Self, runtime_checkable

import numpy as np

from flinders.geometry.ellipsoid import Ellipsoid

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings


@dataclass(frozen=True, slots=True, eq=False)
class Convergence:
    """An estimate after the first readings, after more of them, and after all."""

    counts: NDArray[np.int64]  # (K,): readings seen at each step, ascending
    # (K, 9): b₁, b₂, b₃, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃, in the unit of the readings; NaN where there was no ellipsoid
    # yet
    parameters: Floats
    sigmas: Floats  # (K, 9): standard deviation that the method claims of each

    @classmethod
    def of(cls, counts: Sequence[int], estimates: Sequence[Estimate | None]) -> Self:
        """Put together what was found after so many readings; None where there was no ellipsoid yet.

        >>> from flinders.estimators import Estimate
        >>> sphere = Ellipsoid(np.ones(3), 50.0 * np.eye(3))
        >>> settling = Convergence.of([5, 10], [None, Estimate(sphere, np.eye(9), 1.0, "sphere")])
        >>> settling.counts, settling.parameters[:, 0], settling.ellipsoid(1).radius
        (array([ 5, 10]), array([nan,  1.]), 50.0)
        """
        unknown = np.full(9, np.nan)
        parameters = [unknown if estimate is None else estimate.ellipsoid.parameters for estimate in estimates]
        sigmas = [unknown if estimate is None else np.sqrt(np.diag(estimate.covariance)) for estimate in estimates]
        return cls(
            np.array(counts, dtype=np.int64).reshape(-1),
            np.array(parameters).reshape(-1, 9),
            np.array(sigmas).reshape(-1, 9),
        )

    @property
    def is_known(self) -> NDArray[np.bool_]:
        """(K,) where there was an ellipsoid."""
        return np.asarray(np.isfinite(self.parameters).all(axis=1), dtype=np.bool_)

    @property
    def last(self) -> int | None:
        """The last step that has an ellipsoid; None where none has."""
        known = np.flatnonzero(self.is_known)
        return int(known[-1]) if len(known) else None

    def ellipsoid(self, step: int) -> Ellipsoid:
        """What was found at a step."""
        return Ellipsoid.of_parameters(self.parameters[step])

    def __len__(self) -> int:
        return len(self.counts)


def spread_counts(readings: int, steps: int) -> list[int]:
    """About so many counts from the first readings to all, closer together at the beginning, where most happens.

    >>> spread_counts(1000, 5)
    [40, 160, 360, 640, 1000]
    """
    shares = (np.arange(1, steps + 1) / steps) ** 2
    return sorted({max(1, round(share * readings)) for share in shares.tolist()}) if readings else []


@runtime_checkable
class Watched(Protocol):
    """An estimator that takes readings one after the other, and can be watched.

    >>> from flinders.estimators import METHODS
    >>> issubclass(METHODS["auto"], Watched)
    False
    """

    def converge(self, readings: Readings, steps: int = 100) -> Convergence:
        """Follow the estimate at about so many steps, spread over the recording; the last is what `estimate` gives.

        Where a method loses its way, what it gave until then is followed, and nothing after it.

        Raises `FitError` as `estimate`, where there is nothing to follow.
        """
