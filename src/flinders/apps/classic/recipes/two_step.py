"""Two-step in the magnetic-field domain: intermediate coefficients by a linear fit, then parameters from them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final, Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from flinders.errors import NotAnEllipsoid, UsageError
from flinders.estimators.base import Method
from flinders.estimators.covariance import ALIGNED_BASIS, FULL_BASIS
from flinders.estimators.quadric_fit import Frame, least_squares, make_estimate

if TYPE_CHECKING:
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings
    from flinders.geometry.ellipsoid import Ellipsoid

Model: TypeAlias = Literal["orthogonal", "non-orthogonal"]

FREE_COEFFICIENTS: Final[dict[Model, tuple[int, ...]]] = {
    "orthogonal": (1, 2, 6, 7, 8, 9),
    "non-orthogonal": (1, 2, 3, 4, 5, 6, 7, 8, 9),
}
"""Indices of the unknown coefficients: of y², z², x, y, z and 1; and of the mixed products."""


@dataclass(frozen=True, slots=True)
class TwoStep:
    """Offset, gains and angles of three axes by a linear fit relative to the x axis.

    Step 1 divides the quadric by its coefficient of x² and finds the others by least squares,

        −x² = f₁ x + f₂ y² + f₃ y + f₄ z² + f₅ z + f₆

    Step 2 computes offsets bᵢ and gains gᵢ of ``|B|² = Σ ((xᵢ − bᵢ)/gᵢ)²`` from them: b_x = −f₁/2, b_y = −f₃/2f₂,
    b_z = −f₅/2f₄, g_x² = (b_x² + f₂b_y² + f₄b_z² − f₆)/|B|², g_y = g_x/√f₂, g_z = g_x/√f₄ [1]_. With
    ``model="non-orthogonal"`` step 1 includes the products xy, xz and yz, and step 2 gives the triangular model of
    Foster and Elkaim [2]_, see `triangular_model`.

    Moving or scaling the readings moves or scales the solution in the same way; with noise, rotating readings or
    exchanging axes gives another solution, as the x axis is treated as free of error. Noise in the regressors biases it
    in the same way as `Algebraic`.

    Use it for parity with those papers. Do not use it for accuracy or with partial coverage; f₂ or f₄ of the wrong
    sign, from much noise or poor coverage, is refused.

    Parameters
    ----------
    model : str
        ``"orthogonal"`` or ``"non-orthogonal"``.

    Notes
    -----
    |B| is constant, and needed for the scale only (``field_strength``). The matrix is the symmetric root, as for all
    methods; the papers' triangular one rotates the axes relative to x. The iterated batch fit of the 2006 paper is not
    included, as `Likelihood` is such a fit. Equations from the literature; the papers' own tables were not read.

    References
    ----------
    .. [1] D. Gebre-Egziabher, G. H. Elkaim, J. D. Powell, B. W. Parkinson, "A Non-linear, Two-step Estimation Algorithm
       for Calibrating Solid-state Strapdown Magnetometers" (2001); "Calibration of Strapdown Magnetometers in Magnetic
       Field Domain", J. Aerosp. Eng. 19 (2006) 87–102.
    .. [2] C. C. Foster, G. H. Elkaim, "Extension of a Two-step Calibration Methodology to Include Nonorthogonal Sensor
       Axes", IEEE Trans. Aerosp. Electron. Syst. 44 (2008) 1070–1078.

    Examples
    --------
    >>> from flinders.estimators.data import Readings
    >>> rng = np.random.default_rng(1)
    >>> directions = rng.normal(size=(100, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> ellipsoid = TwoStep().estimate(Readings.of(directions * [45, 50, 60] + [20, 120, 90])).ellipsoid
    >>> ellipsoid.centre.round(6), ellipsoid.shape.diagonal().round(6)
    (array([ 20., 120.,  90.]), array([45., 50., 60.]))
    >>> skewed = directions @ (50.0 * np.array([[1.0, 0, 0], [0.1, 1.1, 0], [0.02, -0.05, 0.9]])).T
    >>> triangular_model(TwoStep("non-orthogonal").estimate(Readings.of(skewed)).ellipsoid, 50.0).rho_deg
    5.1944
    """

    model: Model = "orthogonal"

    name: ClassVar[str] = "two-step"
    unknowns: ClassVar[int] = 7
    is_biased: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Refuse an unknown model."""
        if self.model not in get_args(Model):
            raise UsageError(f"model is {self.model!r}: need {', '.join(get_args(Model))}")

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`, with ten readings for
        ``"non-orthogonal"``; `NotAnEllipsoid` if f₂ or f₄ is not positive, or the quadric is open for another reason.
        """
        free = FREE_COEFFICIENTS[self.model]
        readings.require(len(free) + 1, self.name)
        frame = Frame.of(readings)
        coefficients = least_squares(frame.scatter, np.eye(10)[0], np.eye(10)[:, list(free)])
        if not min(coefficients[1], coefficients[2]) > 0.0:
            largest = float(np.abs(coefficients[:3]).max())
            raise NotAnEllipsoid(tuple(float(value) / largest for value in coefficients[:3]), self.name)
        basis = ALIGNED_BASIS if self.model == "orthogonal" else FULL_BASIS
        named = self.name if self.model == "orthogonal" else f"{self.name} {self.model}"
        return replace(
            make_estimate(readings, frame.to_ellipsoid(coefficients, self.name), named, basis), estimator=self.name
        )


class Triangular(NamedTuple):
    """Gains and angles of the model of Foster and Elkaim, in which the x axis is the reference.

        x = a Bx + x₀
        y = b (Bx sin ρ + By cos ρ) + y₀
        z = c (Bx sin λ + By cos λ sin φ + Bz cos λ cos φ) + z₀

    The y axis is tilted towards x by ρ, the z axis towards x by λ and towards y by φ.

    >>> Triangular(1.0, 1.1, 0.9, 5.2, 1.1, -3.2).b
    1.1
    """

    a: float
    b: float
    c: float
    rho_deg: float
    lambda_deg: float
    phi_deg: float


def triangular_model(ellipsoid: Ellipsoid, field_strength: float) -> Triangular:
    """The six gains and angles of an ellipsoid, for a field of known strength.

    `field_strength`: in the unit of the readings.
    """
    root = np.linalg.cholesky(ellipsoid.shape @ ellipsoid.shape) / field_strength
    across = np.hypot(root[2, 1], root[2, 2])
    angles = np.rad2deg(
        [np.arctan2(root[1, 0], root[1, 1]), np.arctan2(root[2, 0], across), np.arctan2(root[2, 1], root[2, 2])]
    )
    a, b, c = (float(np.linalg.norm(row)) for row in root)
    return Triangular(a, b, c, *(float(angle) for angle in angles))


METHOD: Final = Method(
    TwoStep,
    use="numbers of Gebre-Egziabher and Elkaim, or of Foster and Elkaim; relative to the x axis",
    source="Gebre-Egziabher and others (2001, 2006); Foster and Elkaim (2008)",
    is_recipe=True,
)
