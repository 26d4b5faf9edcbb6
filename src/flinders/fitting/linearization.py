"""Linearization of nonlinear axes: quadratic and cubic terms that are subtracted from their readings.

Readings are linearized by the terms that the engine finds, and fitted again, until the engine finds no further terms.
This is a Gauss–Newton iteration over the terms and the offset about which they apply. The uncertainty of the terms has
two effects. Its mean over all directions changes offset and shape, and is in their covariance. The rest, with possible
terms of higher order, is an error of the direction at any attitude (`nonlinearity.c`).
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

MAX_ROUNDS: Final = 12
"""Largest count of fits; each fit removes at least nine tenths of the remaining nonlinearity."""

MAX_READING_RATIO: Final = 1.2
"""Largest reading of an axis, relative to the field strength, to which the linearization applies."""

MAX_CHANGE: Final = 1e-6
"""Change of terms and offset between rounds at convergence, as a share of the field: 0.0001° of heading."""


@dataclass(frozen=True, slots=True)
class AxisTerms:
    """Nonlinear terms of the axes, and the surface about whose centre they apply.

    A reading d from the centre has the linear value ``d - radius (quadratic (d / radius)² + cubic (d / radius)³)``.
    """

    quadratic: Floats  # (3,): quadratic terms, as shares of the field
    cubic: Floats  # (3,): cubic terms, as shares of the field
    p_value: float  # probability of terms as large by chance
    surface: Ellipsoid  # ellipsoid of the readings from whose centre d is counted

    @classmethod
    def of(cls, found: Nonlinearity, surface: Ellipsoid) -> Self:
        """Create terms from a nonlinearity that the engine found."""
        return cls(np.array(found.quadratic), np.array(found.cubic), found.p_value, surface)

    @property
    def linearization(self) -> Linearization:
        """The terms in the form of a calibration."""
        radius, reach = self.surface.radius, np.linalg.norm(self.surface.shape, axis=1)
        return Linearization(self.quadratic / radius, self.cubic / radius**2, MAX_READING_RATIO * reach)

    def linear(self, field: Floats) -> Floats:
        """(N, 3) linearized readings of (N, 3) readings."""
        return self.surface.centre + self.linearization.apply(field - self.surface.centre)

    def refine(self, left: Nonlinearity | None, surface: Ellipsoid) -> AxisTerms:
        """Add further terms found in the linearized readings, about their surface."""
        if left is None:
            return replace(self, surface=surface)
        quadratic, cubic = self.quadratic + left.quadratic, self.cubic + left.cubic
        return replace(self, quadratic=quadratic, cubic=cubic, surface=surface)

    def is_close(self, other: AxisTerms) -> bool:
        """Whether the terms agree to within `MAX_CHANGE`."""
        terms = np.concatenate([self.quadratic - other.quadratic, self.cubic - other.cubic])
        moved = (self.surface.centre - other.surface.centre) / self.surface.radius
        return bool(np.abs(np.concatenate([terms, moved])).max() < MAX_CHANGE)

    def corrected_nonlinearity(self, record: Records) -> Nonlinearity:
        """The nonlinearity that was corrected, with its remaining error from the record of the linearized readings."""
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
        """Possible effect of terms of higher order on a corrected reading, as a share of the field.

        A polynomial of third order in the reading, and one in the field, with terms q and c differ by 5 q c u⁴ + 3 c²
        u⁵ and smaller terms, where u is the component of the field's direction. Over all directions u is distributed
        uniformly, so that lower orders absorb all but the parts 8/35 P₄ and 8/63 P₅ (Legendre polynomials).
        """
        each = 8.0 / 7.0 * np.abs(self.quadratic * self.cubic) + 8.0 / 21.0 * self.cubic**2
        return float(np.linalg.norm(each))


def unchanged_reason(fit: Fit) -> str:
    """Reason why a fit with `linearize` did not linearize its axes, in words."""
    found, lag = fit.evidence.diagnosis.nonlinearity, fit.evidence.diagnosis.axis_lag
    if found is None or not found.is_likely:
        return "the axes are linear as far as the readings show, or their nonlinearity changes within the recording"
    if lag is not None and lag.is_proven and lag.p_value < found.p_value:
        return "the axes are read at different times, which resembles nonlinear axes: read them at the same time first"
    return "linearized axes would not reduce the heading error, as far as the readings show"
