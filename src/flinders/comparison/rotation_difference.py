"""Difference of the rotations of two calibrations into the body."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.comparison.results import json_attributes
from flinders.geometry.rotation import rotation_vectors
from flinders.heading.error_propagation import HEADINGS
from flinders.native.engine import engine
from flinders.summary.pooling import chi_square_of, p_value_of

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.fitting.result import Fit
    from flinders.native.faults import Answer

SIGMAS_95_OF_3: Final = 2.7955
"""95 % bound of the length of a vector of three independent normal numbers, in their standard deviations."""


@dataclass(frozen=True, slots=True, eq=False)
class RotationDifference:
    """Difference of two rotations from the magnetometer's axes to those of the body: rotation b after the inverse of a.

    Examples
    --------
    >>> apart = RotationDifference(np.array([0.0, 0.0, 3.0]), np.eye(3))
    >>> apart.angle_deg, apart.heading_deg(60.0), round(apart.p_value, 3)
    (3.0, 3.0, 0.029)
    """

    vector_deg: Floats  #: (3,): rotation vector from the first to the second rotation, in body axes
    covariance: Floats | None = None  #: (3, 3), degrees²: sum of both covariances; None unless both are stated

    @classmethod
    def of(cls, a: Fit, b: Fit) -> Self | None:
        """Difference of the rotations of two fits; None unless both have one."""
        if "symmetric" in (a.calibration.rotation, b.calibration.rotation):
            return None
        both = [rotation_covariance(fit) for fit in (a, b)]
        covariance = None if both[0] is None or both[1] is None else both[0] + both[1]
        return cls.between(a.calibration, b.calibration, covariance)

    @classmethod
    def between(cls, a: Calibration, b: Calibration, covariance: Floats | None = None) -> Self:
        """Difference of the rotations of two calibrations, with a (3, 3) covariance in rad²."""
        turn = b.rotation_matrix @ a.rotation_matrix.T
        return cls(
            np.rad2deg(rotation_vectors(turn)), None if covariance is None else np.rad2deg(np.rad2deg(covariance))
        )

    @property
    def angle_deg(self) -> float:
        """Angle between both rotations."""
        return math.hypot(*self.vector_deg)

    @property
    def sigma_deg(self) -> Floats | None:
        """(3,) 1 σ about each axis of the body; None without a covariance."""
        if self.covariance is None:
            return None
        sigma: Floats = np.sqrt(np.diag(self.covariance))
        return sigma

    @property
    def angle_sigma_deg(self) -> float | None:
        """1 σ of the angle about the axis of the difference; without a difference about the least certain axis."""
        if self.covariance is None:
            return None
        if not self.angle_deg > 0.0:
            return math.sqrt(float(np.trace(self.covariance)) / 3.0)
        along = self.vector_deg / self.angle_deg
        return math.sqrt(max(float(along @ self.covariance @ along), 0.0))

    @property
    def p_value(self) -> float | None:
        """Probability of a difference as large by chance; None without a covariance."""
        return None if self.covariance is None else p_value_of(*self.chi_square)

    @property
    def chi_square(self) -> tuple[float, int]:
        """χ² of the difference against its covariance, and the degrees of freedom, 0 without a covariance."""
        return (0.0, 0) if self.covariance is None else chi_square_of(self.vector_deg, self.covariance)

    def heading_deg(self, dip_deg: float) -> float:
        """Worst heading difference of a level vehicle: the rotation about z plus tan I times the tilt."""
        x, y, z = (abs(part) for part in self.vector_deg.tolist())
        return float(z + abs(math.tan(math.radians(dip_deg))) * math.hypot(x, y))

    def heading_sigma_deg(self, dip_deg: float) -> float:
        """1 σ of the worst level heading difference; NaN without a covariance."""
        if self.covariance is None:
            return math.nan
        headings = np.linspace(0.0, 2.0 * math.pi, HEADINGS, endpoint=False)
        tilt = math.tan(math.radians(dip_deg))
        gradient = np.stack([tilt * np.cos(headings), tilt * np.sin(headings), np.ones(HEADINGS)])
        return math.sqrt(float(np.einsum("ik,ij,jk->k", gradient, self.covariance, gradient).max()))

    def answer_to(self, target_deg: float, dip_deg: float) -> Answer:
        """Whether heading differences of the body are within a target, by the rotations alone."""
        sigma_deg, p_value = self.heading_sigma_deg(dip_deg), self.p_value
        return engine().answer(
            self.heading_deg(dip_deg),
            sigma_deg=sigma_deg,
            bound_deg=SIGMAS_95_OF_3 * sigma_deg,
            p_value=math.nan if p_value is None else p_value,
            target_deg=target_deg,
        )

    def as_dict(self) -> dict[str, Any]:
        """Values for JSON, by name."""
        return json_attributes(self, "vector_deg", "sigma_deg", "angle_deg", "p_value")


def rotation_covariance(fit: Fit) -> Floats | None:
    """(3, 3) covariance in rad² of the rotation of a fit into the body, about the axes of the body; None if unknown."""
    covariance = None if fit.evidence.aiding is None else fit.evidence.aiding.rotation_covariance
    return covariance if covariance is not None and np.isfinite(covariance).all() else None
