"""Ellipse: least squares in one plane, for uneven or partial turns about any axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

from flinders.errors import UsageError
from flinders.estimators.base import Method, check_prior
from flinders.estimators.data import project_to_plane
from flinders.estimators.in_plane import fit_projected, lift_estimate, require_turn
from flinders.geometry.plane import Plane, axis_order
from flinders.likelihood import prior

if TYPE_CHECKING:
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings


@dataclass(frozen=True, slots=True)
class Ellipse:
    """Ellipse of the readings in one plane: two offsets, two scales and their skew.

    Minimises Σ s²/σ² as `Likelihood`, with s the distance of a reading from the ellipse to first order, with a
    correction of the bias by curvature, and robustly if residuals show outliers. The result is independent of the
    spacing of the readings: an arc, a turn that stops or 1.2 turns give the same ellipse, with different uncertainties.

    Use it instead of `TwoAxisRecipe` if headings were not equally spaced, and for a sweep about x or y. `Level`
    estimates the same ellipse for a turn about z, and sets the offset along z by the dip; this method leaves the third
    axis unchanged.

    Parameters
    ----------
    plane : str
        ``"xy"``, ``"yz"`` or ``"zx"``: the third axis is the axis of the turn.
    prior : float
        See `Likelihood`; it matters only for less than a full turn.
    dip_deg : float
        Inclination of the field towards the axis of the turn, in degrees.
    field_strength : float, optional
        Strength of the site.

    Notes
    -----
    The centre includes the effect of soft iron in the vertical field, b + sin I · F (S₁₃, S₂₃) for the plane xy. It is
    valid while the vehicle stays level, at this dip.

    References
    ----------
    .. [1] P. D. Sampson, "Fitting conic sections to very scattered data", CGIP 18 (1982) 97–108.

    Examples
    --------
    A third of a turn in y and z:

    >>> import numpy as np
    >>> from flinders.estimators.data import Readings
    >>> angle = np.linspace(0.0, 2.1, 60)
    >>> arc = np.stack([np.full(60, 7.0), 30 * np.cos(angle) + 10, 20 * np.sin(angle) - 5], axis=1)
    >>> ellipsoid = Ellipse("yz").estimate(Readings.of(arc)).ellipsoid
    >>> ellipsoid.centre.round(3), (ellipsoid.shape[1:, 1:] / 2).round(3).tolist()      # half, at a dip of 60°
    (array([ 0., 10., -5.]), [[30.0, 0.0], [0.0, 20.0]])
    """

    plane: Plane = "xy"
    prior: float = prior.SOFT_IRON_SPREAD
    dip_deg: float = 60.0
    field_strength: float | None = None

    name: ClassVar[str] = "ellipse"
    unknowns: ClassVar[int] = 6
    is_biased: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse an unknown plane or an invalid prior.

        Raises `UsageError` for either.
        """
        axis_order(self.plane)
        check_prior(self.prior)
        if self.prior is None:
            raise UsageError("ellipse needs a prior across the plane: give one", hint={"prior": prior.SOFT_IRON_SPREAD})

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipse to the readings of the plane.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `require_turn`; `NotAnEllipse` if half of
        the readings are in one place, or all on a line; `NeedsSamples` if only sums were given.
        """
        require_turn(readings, self.unknowns, self.name, self.plane)
        return lift_estimate(
            fit_projected(project_to_plane(readings, self.plane), self.prior),
            readings,
            self.plane,
            name=self.name,
            dip_deg=self.dip_deg,
            field_strength=self.field_strength,
        )


METHOD: Final = Method(
    Ellipse,
    use="least-squares ellipse of one plane, for uneven turns and arcs about any axis",
    source="the likelihood in a plane",
)
