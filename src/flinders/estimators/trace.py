"""Convergence of the estimate of a sequential method with the number of readings."""

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
    """Estimates after increasing numbers of readings, up to all."""

    counts: NDArray[np.int64]  # (K,): number of readings at each step, ascending
    # (K, 9): b₁, b₂, b₃, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃, in the unit of the readings; NaN before the first ellipsoid
    parameters: Floats
    sigmas: Floats  # (K, 9): claimed standard deviation of each parameter

    @classmethod
    def of(cls, counts: Sequence[int], estimates: Sequence[Estimate | None]) -> Self:
        """Make the convergence of estimates after `counts` readings; None stands for no ellipsoid.

        >>> from flinders.estimators import Estimate
        >>> sphere = Ellipsoid(np.ones(3), 50.0 * np.eye(3))
        >>> convergence = Convergence.of([5, 10], [None, Estimate(sphere, np.eye(9), 1.0, "sphere")])
        >>> convergence.counts, convergence.parameters[:, 0], convergence.ellipsoid(1).radius
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
        """(K,) whether there is an ellipsoid at each step."""
        return np.asarray(np.isfinite(self.parameters).all(axis=1), dtype=np.bool_)

    @property
    def last(self) -> int | None:
        """Index of the last step with an ellipsoid; None if there is none."""
        known = np.flatnonzero(self.is_known)
        return int(known[-1]) if len(known) else None

    def ellipsoid(self, step: int) -> Ellipsoid:
        """Ellipsoid at a step."""
        return Ellipsoid.of_parameters(self.parameters[step])

    def __len__(self) -> int:
        return len(self.counts)


def spread_counts(readings: int, steps: int) -> list[int]:
    """About `steps` increasing numbers of readings, denser at the beginning, where estimates change most.

    >>> spread_counts(1000, 5)
    [40, 160, 360, 640, 1000]
    """
    shares = (np.arange(1, steps + 1) / steps) ** 2
    return sorted({max(1, round(share * readings)) for share in shares.tolist()}) if readings else []


@runtime_checkable
class SequentialEstimator(Protocol):
    """A sequential estimator whose convergence can be followed.

    >>> from flinders.estimators import METHODS
    >>> issubclass(METHODS["auto"], SequentialEstimator)
    False
    """

    def converge(self, readings: Readings, steps: int = 100) -> Convergence:
        """Estimates at about `steps` steps over the recording; the last one is that of `estimate`.

        If a method diverges, only the estimates before are returned.

        Raises `FitError` as `estimate`, if there is no estimate.
        """
