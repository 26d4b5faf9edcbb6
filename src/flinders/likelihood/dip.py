"""Term of the dip: the angle between field and vertical is the same at every attitude.

With a unit vector d_k that points down in body axes and the field's direction q_k in these axes,

    d_kᵀ q_k = sin I

for all readings, with the dip I, which is estimated or known from the site. The vertical is that of the accelerometer,
down = −f/|f|, or that of a logged attitude, without its yaw, which may depend on the compass to be calibrated.

An uncalibrated accelerometer has a bias of 0.1 to 0.5 m/s², gain errors of per cents, and axes that are not exactly
orthogonal. These errors tilt its vertical by degrees and would change offset and shape by much more than noise.
Therefore these nine parameters are estimated as well, with an `AccelerometerPrior`.

An accelerometer also measures motion. The weight of a vertical decreases with the difference of |f| from its median g,

    w = 1 / (1 + ((|f| − g)/s)²)

where s is three times the scatter of |f|, at least a hundredth of g. Large residuals reduce the weight further (Huber).

When to use it: if the body is tilted during the recording and mostly not accelerated. The term determines the rotation
between magnetometer and accelerometer, except about an axis that stays vertical. If the body turns about only one of
its axes, the offset along that axis is not determined.

Source: M. Kok, T. B. Schön, IEEE Sensors J. 16 (2016), for the inclination as a parameter; the plain form is
Σ (aᵀRm − |a||m| sin I)².

>>> down, trust = accelerometer_verticals(np.array([[0.0, 0.0, -9.8]] * 3 + [[5.0, 0.0, -9.8]]))
>>> down[0] + 0.0, trust.round(2)
(array([0., 0., 1.]), array([1.  , 1.  , 1.  , 0.01]))
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.geometry.ellipsoid import symmetric_matrix
from flinders.geometry.quaternions import inverse, rotate_vectors
from flinders.geometry.rotation import components, lengths, transform_vectors, vectors_of
from flinders.likelihood.equations import NormalEquations
from flinders.likelihood.robust import robust_sigma
from flinders.likelihood.term import Block, Term

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.arrays import Floats

MIN_LENGTH_SCATTER: Final = 0.01
"""Smallest s in the weight of verticals, relative to gravity."""

MIN_REST_LENGTH: Final = 0.2
"""Smallest length of an accelerometer's reading at rest, relative to gravity; it limits steps of the solver."""

GRAVITY: Final = 9.80665
"""Standard gravity in m/s², the unit of an accelerometer's bias."""

ACCELERATION_SIGMA: Final = 0.3
"""Prior standard deviation of an accelerometer's bias in m/s², as for small uncalibrated sensors."""

GAIN_SIGMA: Final = 0.02
"""Prior standard deviation of an accelerometer's gains, and of its misalignment angles in rad."""

MIN_COSINE_SQUARED: Final = 1e-3
"""Smallest squared cosine of the dip; a vertical field gives no information on the tilt of a vertical."""

EXACT_SIGMA: Final = 1e-6
"""Standard deviation of a bias that is stated to be exact, relative to gravity."""


def accelerometer_verticals(acceleration: Floats) -> tuple[Floats, Floats]:
    """Verticals from an accelerometer, with their weights.

    `acceleration`: (N, 3) specific force in body axes, in any unit; −g on z at rest and level.

    Returns
    -------
    down : (N, 3) float
        Unit vectors; zero if not known.
    trust : (N,) float
        Weights, 0 to 1.
    """
    length = np.linalg.norm(acceleration, axis=1)
    observed = np.asarray(np.isfinite(length) & (length > 0.0))
    if not observed.any():
        return np.zeros_like(acceleration), np.zeros(len(acceleration))
    down = np.where(observed[:, np.newaxis], -acceleration / np.where(observed, length, 1.0)[:, np.newaxis], 0.0)
    usual = float(np.median(length[observed]))
    scatter = 3.0 * max(robust_sigma(length[observed] - usual), MIN_LENGTH_SCATTER * usual / 3.0)
    trust = np.where(observed, 1.0 / (1.0 + ((length - usual) / scatter) ** 2), 0.0)
    return down, trust


@dataclass(frozen=True, slots=True, eq=False)
class AccelerometerPrior:
    """Prior of an accelerometer's errors."""

    # (9,): mean of the bias β relative to gravity, and of the upper triangle of Γ in the order of
    # `flinders.geometry.ellipsoid.symmetric_matrix`. At rest (1 + Γ)(gβ − f) points down and has the length g.
    mean: Floats
    precision: Floats  # (9, 9): inverse covariance
    scale: float = 1.0  # length of gravity in the recorded unit, for Γ = 0

    @classmethod
    def of(cls, *, bias: float = ACCELERATION_SIGMA, gain: float = GAIN_SIGMA) -> Self:
        """Prior with mean zero: 1 σ of the bias in m/s², and 1 σ of gains and of misalignment angles in rad.

        Gravity is estimated by the median of |f|, which contains the bias. All gains therefore have a common error of
        the size of the bias.

        >>> (1.0 / np.sqrt(np.diag(AccelerometerPrior.of(bias=0.0).precision))).round(6)[[0, 3, 6]]
        array([1.e-06, 2.e-02, 1.e-02])
        """
        sigmas = np.repeat([bias / GRAVITY, gain, 0.5 * gain], 3)
        covariance = np.diag(np.maximum(sigmas, EXACT_SIGMA) ** 2)
        covariance[3:6, 3:6] += (bias / GRAVITY) ** 2
        return cls(np.zeros(9), np.linalg.inv(covariance))

    def equations(self, errors: Floats) -> NormalEquations:
        """Normal equations of the prior at (9,) errors."""
        left = self.mean - errors
        return NormalEquations(self.precision, self.precision @ left, float(left @ self.precision @ left), 0)


def correct_verticals(down: Floats, errors: Floats) -> tuple[Floats, Floats]:
    """Correct verticals for the errors of an accelerometer.

    At rest w = (1 + Γ)(ρd + β) points down, with ρ = |f|/g such that w has unit length. The result is w/ρ, which has
    nearly unit length. Its noise is that of d, regardless of the errors.

    `down` are (..., 3) unit vectors d; `errors` are (9,) β and Γ, as in `AccelerometerPrior`.

    Returns
    -------
    vertical : (..., 3) float
        Corrected verticals w/ρ.
    rest : (...,) float
        ρ, the length of the reading at rest relative to gravity.

    >>> reading = np.array([0.0, 0.6, 0.8]) - np.array([0.0, 0.0, 0.03])            # of an accelerometer with a bias
    >>> bias = np.array([0.0, 0.0, 0.03, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    >>> vertical, rest = correct_verticals(reading / np.linalg.norm(reading), bias)
    >>> (vertical * rest).round(12), bool(np.isclose(rest, np.linalg.norm(reading)))
    (array([0. , 0.6, 0.8]), True)
    """
    whole = np.eye(3) + symmetric_matrix(errors[3:])
    scaled, bias = transform_vectors(whole, down), whole @ errors[:3]
    along = np.einsum("...i,i->...", scaled, bias)
    square = np.maximum(np.einsum("...i,...i->...", scaled, scaled), MIN_REST_LENGTH**2)
    root = np.sqrt(np.maximum(along**2 + square * (1.0 - bias @ bias), MIN_REST_LENGTH**2))
    rest = np.maximum((root - along) / square, MIN_REST_LENGTH)
    return scaled + vectors_of(np.divide.outer(bias, rest)), rest


def error_derivatives(rows: Floats, down: Floats, errors: Floats) -> Floats:
    """(..., 9) derivative of rᵀv by the errors of the accelerometer, with v the result of `correct_verticals`.

    `rows` are (..., 3) vectors r; `down` and `errors` are those of `correct_verticals`.
    """
    vertical, rest = correct_verticals(down, errors)
    whole = np.eye(3) + symmetric_matrix(errors[3:])
    lengthened = np.einsum("...i,...i->...", vertical, transform_vectors(whole, down))
    share = np.einsum("...i,i->...", rows, whole @ errors[:3]) / (rest * np.maximum(lengthened, MIN_REST_LENGTH))
    rows = rows + share[..., np.newaxis] * vertical  # ρ depends on the errors, too
    felt = down + vectors_of(np.divide.outer(errors[:3], rest))
    parts = transform_vectors(whole, rows) / rest[..., np.newaxis], symmetric_derivatives(rows, felt)
    return vectors_of(np.concatenate([components(part) for part in parts]))


def symmetric_derivatives(rows: Floats, vectors: Floats) -> Floats:
    """(..., 6) derivative of rᵀΓx by the upper triangle of Γ, for (..., 3) rows r and vectors x.

    >>> symmetric_derivatives(np.array([1.0, 2.0, 3.0]), np.array([1.0, 1.0, 0.0]))
    array([1., 2., 0., 3., 3., 3.])
    """
    first, second = components(rows), components(vectors)
    crossed = [first[i] * second[j] + first[j] * second[i] for i, j in ((0, 1), (0, 2), (1, 2))]
    return vectors_of(np.stack([*(first * second), *crossed]))


def attitude_verticals(attitude: Floats) -> tuple[Floats, Floats]:
    """(N, 3) verticals in body axes from (N, 4) logged attitudes, and their (N,) weights 0 or 1; yaw has no effect.

    >>> from flinders.geometry.quaternions import from_angles
    >>> down, _ = attitude_verticals(from_angles([[0.0, 0.0, 0.5], [0.0, 0.0, 2.5]]))       # level, on two headings
    >>> down.round(9) + 0.0
    array([[0., 0., 1.],
           [0., 0., 1.]])
    """
    observed = np.asarray(np.isfinite(attitude).all(axis=1))
    safe = np.where(observed[:, np.newaxis], attitude, [1.0, 0.0, 0.0, 0.0])
    down = rotate_vectors(inverse(safe), np.broadcast_to([0.0, 0.0, 1.0], (len(attitude), 3)))
    return down * observed[:, np.newaxis], observed.astype(float)


def heights(down: Floats, q: Floats) -> Floats:
    """(W, n) sines of the field's angle to the horizon: vᵀq with (W, n, 3) verticals v and field directions q."""
    height: Floats = np.einsum("wni,wni->wn", down, q)
    return height


def dip_residuals(down: Floats, q: Floats, sine: float) -> Floats:
    """(W, n) residuals |v| sin I − vᵀq, with `sine` = sin I."""
    left: Floats = sine * lengths(down) - heights(down, q)
    return left


def fill_dip(
    jacobian: Floats,
    columns: Mapping[str, slice],
    recorded: Floats,
    q: Floats,
    *,
    sine: float,
    errors: Floats,
    of_gyro: slice,
    moved: Floats | None,
) -> None:
    """Write the Jacobian of the residuals vᵀq − |v| sin I of verticals.

    The derivatives by an accelerometer's errors are evaluated at the vertical for which the residual is zero. Otherwise
    they would contain the noise of the residual, and the estimated gains would follow that noise.

    Parameters
    ----------
    jacobian : (W, n, P) float
        Written in place.
    columns : mapping of str to slice
        Columns of the free blocks of parameters.
    recorded : (W, n, 3) float
        Unit vectors d.
    q : (W, n, 3) float
        Direction of the field.
    sine : float
        sin I.
    errors : (9,) float
        Errors of the accelerometer.
    of_gyro : slice
        Columns of the gyro's parameters.
    moved : (W, n, 3, m) float, optional
        Derivative of q by the gyro's parameters.
    """
    down, _ = correct_verticals(recorded, errors)
    length = lengths(down)
    if "sine" in columns:
        jacobian[..., columns["sine"].start] = -length
    if "accelerometer" in columns:
        height = sine / np.maximum(length, 1e-300)
        raised = q - height[..., np.newaxis] * down
        off = dip_residuals(down, q, sine) / np.maximum(np.einsum("wni,wni->wn", raised, raised), MIN_COSINE_SQUARED)
        agreed = recorded + off[..., np.newaxis] * raised
        jacobian[..., columns["accelerometer"]] = error_derivatives(raised, agreed, errors)
    if moved is not None:
        jacobian[..., of_gyro] = np.einsum("wni,wnij->wnj", down, moved)


TERM: Final = Term(
    "dip",
    "accelerometer",
    "the accelerometer: the angle between field and vertical is constant",
    ("acceleration",),
    (Block("accelerometer", 9), Block("sine", 1)),
)
TILT: Final = Term("tilt", "logged tilt", "the logged attitude without its yaw, as `dip`", ("attitude",))
"""Term of the dip with the vertical of a logged attitude, to which errors of an accelerometer do not apply."""
