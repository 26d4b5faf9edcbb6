"""Whether readings have the soft iron of an earlier calibration.

A fit whose prior allows the shape to change by a share moves it by d, of which chance makes

    var d = (1 − A Π) P (1 − A Π)ᵀ + C − A Π A,        χ² = dᵀ (var d)⁻¹ d

with P the covariance of the earlier shape, Π the inverse of that of the prior, A and C the covariances of the posterior
for independent residuals and as claimed. Only directions count of which the readings tell more than a tenth.

>>> known = KnownShape(np.array([50.0, 50.0, 50.0, 0.0, 0.0, 0.0]), 1e-4 * np.eye(6))
>>> freer = changeable(known, 0.05)
>>> posterior = Posterior(known.entries + [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.01 * np.eye(6), 0.01 * np.eye(6))
>>> by_chance(posterior, known, freer) < 1e-9, round(by_chance(posterior._replace(entries=known.entries), known, freer))
(True, 1)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flinders.geometry.ellipsoid import symmetric
from flinders.likelihood.prior import KnownShape
from flinders.summary.pooling import chance_of

if TYPE_CHECKING:
    from flinders.arrays import Floats

TOLD: Final = 0.1
"""Of a direction of the shape: what readings have to tell of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Refreshed:
    """A fit whose soft iron is that of an earlier calibration."""

    previous: str  # name of the earlier calibration
    offset_change: Floats  # (3,): from its offset to that of the fit, in the unit of the calibration
    # heading error at the worst heading of a level vehicle that goes on with the earlier calibration
    heading_change_deg: float
    soft_iron_p_value: float  # how often chance alone makes as much of a change of the soft iron as the readings show
    distortion: float = 0.0  # `Residuals.distortion` of the earlier calibration: it belongs to the sensor

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "previous": self.previous,
            "offset_change": self.offset_change.tolist(),
            "heading_change_deg": self.heading_change_deg,
            "soft_iron_p_value": self.soft_iron_p_value,
        }


class Posterior(NamedTuple):
    """Shape of a fit: (6,) entries, (6, 6) covariance for independent residuals, and as it is claimed."""

    entries: Floats
    textbook: Floats
    covariance: Floats


def changeable(known: KnownShape, share: float) -> KnownShape:
    """The shape of an earlier calibration, of which the soft iron may have changed by a share, 1 σ."""
    radius = float(np.cbrt(np.linalg.det(symmetric(known.entries))))
    spread = np.square(share * radius) * np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
    return KnownShape(known.entries, known.covariance + np.diag(spread))


def by_chance(posterior: Posterior, known: KnownShape, prior: KnownShape) -> float:
    """How often chance makes as much of a change of the soft iron.

    Parameters
    ----------
    posterior : Posterior
        Of a fit with `prior`.
    known : KnownShape
        Of the earlier calibration.
    prior : KnownShape
        The same with the change that was allowed.
    """
    finer = np.linalg.inv(np.linalg.cholesky(prior.covariance))
    precision = finer.T @ finer
    left = np.eye(6) - posterior.textbook @ precision
    spread = left @ known.covariance @ left.T
    spread += posterior.covariance - posterior.textbook @ precision @ posterior.textbook
    shares, directions = np.linalg.eigh(np.eye(6) - finer @ posterior.textbook @ finer.T)
    onto = directions[:, shares > TOLD].T @ finer
    if not len(onto):
        return 1.0
    moved = onto @ (posterior.entries - prior.entries)
    return chance_of(float(moved @ np.linalg.solve(onto @ spread @ onto.T, moved)), len(onto))
