"""Two-axis: the recipe for points equally spaced in heading, a mean and the eigenvectors of a 2 × 2 scatter."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.estimators.base import Method
from flinders.estimators.covariance import unexplained_part
from flinders.estimators.data import project_to_plane
from flinders.estimators.in_plane import NotAnEllipse, equator_ellipsoid, fit_projected, lift_estimate, require_turn
from flinders.estimators.likelihood import MAX_ITERATED_READINGS
from flinders.geometry.plane import PLANE_PARAMETERS, Plane, PlaneEllipse, axis_order
from flinders.likelihood import magnitude, prior
from flinders.likelihood.equations import MIN_NOISE

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings
    from flinders.geometry.ellipsoid import Ellipsoid


@dataclass(frozen=True, slots=True)
class TwoAxisRecipe:
    """Hard iron as the mean of the points, soft iron from the eigenvectors of their centred scatter.

    Of N points p equally spaced in heading, with their mean m and the scatter C = Σ (p − m)(p − m)ᵀ / N = V Λ Vᵀ,

        H = m,     semi-axes √(2λ),     S = r V (2Λ)^(−½) Vᵀ,     r² = 2 √det C

    so that S (p − H) is a circle of the ellipse's area: the recipe of the frequently asked questions about the
    ADIS16480 and ADIS16488, with its 36 points 10° apart. S₁₁, S₁₂, S₂₁, S₂₂, H₁ and H₂ are extended to three axes with
    a 1 for the axis of rotation.

    Use it for such points, and for parity with the spreadsheet. Do not use it if the turn stopped, had an uneven rate,
    or was not a whole number of turns: then the mean is not the centre, and `Ellipse` is right. The two are compared
    here, and their difference is added to the covariance.

    Parameters
    ----------
    plane : str
        ``"xy"``, ``"yz"`` or ``"zx"``: the third axis is the axis of rotation.
    dip_deg : float
        Inclination of the field, towards the axis of rotation.
    field_strength : float, optional
        Field strength of the site.

    Notes
    -----
    With white noise σ and N points on a circle of radius H, the standard deviation of the offset is σ/√N, less than the
    σ √(2/N) of least squares, since equal spacing is assumed; that of a scale is (σ/H) √(2/N) instead of (σ/H) √(3/N),
    and that of the skew 2σ/(H√N) instead of 2√2 σ/(H√N). Noise also widens the ellipse by σ²/H, however many the
    points. The claimed covariance is that of `Ellipse` for these points plus d dᵀ, where d is the difference of the two
    ellipses beyond their uncertainty: with χ² = dᵀP⁻¹d over five parameters, the share max(0, 1 − 5/χ²) of it.

    References
    ----------
    .. [1] Analog Devices, ADIS16480 and ADIS16488 frequently asked questions, two-axis hard and soft iron. We know only
       descriptions of it.

    Examples
    --------
    >>> from flinders.estimators.data import Readings
    >>> heading = np.radians(np.arange(0, 360, 10))
    >>> turn = np.stack([30 * np.cos(heading) + 10, -20 * np.sin(heading) - 5, np.full(36, 40.0)], axis=1)
    >>> ellipsoid = TwoAxisRecipe(dip_deg=0.0).estimate(Readings.of(turn)).ellipsoid
    >>> ellipsoid.centre.round(9) + 0.0, ellipsoid.shape.diagonal().round(3)
    (array([10., -5.,  0.]), array([30.   , 20.   , 24.495]))
    """

    plane: Plane = "xy"
    dip_deg: float = 60.0
    field_strength: float | None = None

    name: ClassVar[str] = "two-axis"
    unknowns: ClassVar[int] = 6
    needs_even_turn: ClassVar[bool] = True
    is_biased: ClassVar[bool] = False  # uneven points bias it, which is found here and already in the covariance

    def __post_init__(self) -> None:
        """Refuse a name that is no plane."""
        axis_order(self.plane)

    def estimate(self, readings: Readings) -> Estimate:
        """Estimate from mean and scatter, with a comparison with the ellipse of least squares.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `require_turn`; `NotAnEllipse` if half of
        the readings are in one place, or all on a line; `NeedsSamples` if only sums were given, which do not contain
        the spacing of the points.
        """
        require_turn(readings, self.unknowns, self.name, self.plane)
        flat = project_to_plane(readings, self.plane)
        reference = fit_projected(flat, prior.SOFT_IRON_SPREAD)
        ellipse = PlaneEllipse.of_blocks(block[:, :2] for block in flat.blocks(self.name))
        long, short = ellipse.semi_axes.tolist()
        if not short > MIN_NOISE * long:
            raise NotAnEllipse(self.name)
        ellipsoid = equator_ellipsoid(ellipse)
        bias = _bias(ellipsoid, reference)
        estimate = replace(
            reference,
            ellipsoid=ellipsoid,
            covariance=reference.covariance + np.outer(bias, bias),
            noise=_noise(flat.thin(MAX_ITERATED_READINGS, self.name), ellipsoid),
            bias=bias if bias.any() else None,
            used=len(flat),
            rejected_beyond=np.inf,
            outliers=(),
        )
        return lift_estimate(
            estimate,
            readings,
            self.plane,
            name=self.name,
            dip_deg=self.dip_deg,
            field_strength=self.field_strength,
        )


def _bias(ellipsoid: Ellipsoid, reference: Estimate) -> Floats:
    """(9,) difference of an ellipse from the least-squares ellipse, beyond the uncertainty of least squares."""
    apart = ellipsoid.parameters - reference.ellipsoid.parameters
    bias = np.zeros(9)
    bias[PLANE_PARAMETERS] = unexplained_part(
        apart[PLANE_PARAMETERS], reference.covariance[np.ix_(PLANE_PARAMETERS, PLANE_PARAMETERS)]
    )
    return bias


def _noise(points: Floats, ellipsoid: Ellipsoid) -> float:
    """Standard deviation of the points' distance from the ellipse, in their unit, after a fit of five parameters."""
    distances = magnitude.distances(points, ellipsoid)
    return float(np.sqrt(distances @ distances / max(len(distances) - 5, 1)))


METHOD: Final = Method(
    TwoAxisRecipe,
    use="mean and scatter of points equally spaced in heading, in one plane: the ADIS recipe",
    source="the recipe for the ADIS16480 and ADIS16488",
)
