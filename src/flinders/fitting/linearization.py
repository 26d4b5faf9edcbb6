"""Axes that are not linear, linearized: quadratic and cubic terms that are taken off their readings.

Readings are linearized by the terms that the engine finds, and fitted again, until it finds nothing more to take off
(Gauss-Newton, with the offset about which they hold). What is not known of the terms changes offset and shape in the
mean over all directions, which is in their covariance; the rest, and what terms of higher order may be, is an error of
the direction at any attitude (`nonlinearity.c`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.core.linearization import Linearization
from flinders.diagnostics.systematic import Nonlinearity

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.native.layouts import Records

ROUNDS: Final = 12
"""Fits, at most: each takes nine tenths of what is left off, or more."""

BEYOND: Final = 1.2
"""Over what the field makes of an axis: no sensor that is turned reads more, and what it would read is not known."""

CONVERGED: Final = 1e-6
"""Change of terms and offset from one to the next, as a share of the field: 0.0001° of heading."""


@dataclass(frozen=True, slots=True)
class AxisTerms:
    """Terms of the axes, and the surface about whose centre they hold.

    What a linear reading t from the centre leaves is ``d - radius (quadratic (d / radius)² + cubic (d / radius)³)``.
    """

    quadratic: Floats  # (3,), shares of the field
    cubic: Floats  # (3,)
    p_value: float  # how often chance alone makes as much
    surface: Ellipsoid

    @classmethod
    def of(cls, found: Nonlinearity, surface: Ellipsoid) -> Self:
        """Those that the engine found."""
        return cls(np.array(found.quadratic), np.array(found.cubic), found.p_value, surface)

    @property
    def linearization(self) -> Linearization:
        """The same as a calibration holds them."""
        radius, reach = self.surface.radius, np.linalg.norm(self.surface.shape, axis=1)
        return Linearization(self.quadratic / radius, self.cubic / radius**2, BEYOND * reach)

    def linear(self, field: Floats) -> Floats:
        """(N, 3) linear readings."""
        return self.surface.centre + self.linearization.apply(field - self.surface.centre)

    def refined(self, left: Nonlinearity | None, surface: Ellipsoid) -> AxisTerms:
        """These and what was found beside them, about the surface of the linear readings."""
        if left is None:
            return replace(self, surface=surface)
        quadratic, cubic = self.quadratic + left.quadratic, self.cubic + left.cubic
        return replace(self, quadratic=quadratic, cubic=cubic, surface=surface)

    def is_close(self, other: AxisTerms) -> bool:
        """Whether both are the same to within `CONVERGED`."""
        terms = np.concatenate([self.quadratic - other.quadratic, self.cubic - other.cubic])
        moved = (self.surface.centre - other.surface.centre) / self.surface.radius
        return bool(np.abs(np.concatenate([terms, moved])).max() < CONVERGED)

    def corrected(self, record: Records) -> Nonlinearity:
        """What was corrected, and what is not known of it beside offset and shape, by the record of linear readings."""
        sigma, level = float(record["nonlinear_sigma_deg"]), math.cos(math.radians(record["dip_deg"]))
        left = math.hypot(sigma, math.degrees(self.beyond_cubic / level))
        return Nonlinearity(
            quadratic=tuple(self.quadratic.tolist()),
            cubic=tuple(self.cubic.tolist()),
            heading_deg=math.inf if math.isnan(left) else left,
            p_value=self.p_value,
            is_corrected=True,
        )

    @property
    def beyond_cubic(self) -> float:
        """What terms of higher order may do to a corrected reading, as a share of the field.

        Cubic terms of the reading and cubic terms of the field differ by 5 q c u⁴ + 3 c² u⁵ and smaller ones. In all
        directions an axis has each u as often, so that lower orders take all of them but 8/35 P₄ and 8/63 P₅
        (Legendre's polynomials).
        """
        each = 8.0 / 7.0 * np.abs(self.quadratic * self.cubic) + 8.0 / 21.0 * self.cubic**2
        return float(np.linalg.norm(each))


def unchanged(fit: Fit) -> str:
    """Why a fit that was asked to linearize its axes did not."""
    found, lag = fit.evidence.diagnosis.nonlinearity, fit.evidence.diagnosis.axis_lag
    if found is None or not found.is_likely:
        return "the axes are linear as far as the readings tell, or not linear in the same way throughout"
    if lag is not None and lag.is_proven and lag.p_value < found.p_value:
        return "the axes are read at different moments, which looks like curves: read them at once first"
    return "linearized axes would not make the heading error smaller, as far as the readings tell"
