"""The angle between the field and the vertical is the same whichever way the body is held.

With a unit vector d_k that points down in body axes and the field's direction q_k there,

    d_kᵀ q_k = sin I

for all readings: I the dip, found with the rest or known of the site. The vertical comes from the accelerometer, down =
−f/|f|, or from a logged attitude without its yaw, which may stem from the very compass that is to be calibrated.

An accelerometer that nobody has calibrated has a bias of 0.1 to 0.5 m/s², gains that are off by per cents, and axes
that are not quite square. They tilt its vertical by degrees, and taken for exact it would bend offset and shape by far
more than noise: these nine are found with the rest, about an `AccelerometerPrior`.

An accelerometer feels more than gravity, too. A reading is trusted the less, the farther |f| is from its usual length,

    w = 1 / (1 + ((|f| − g)/s)²)

with g the median and s three times the usual scatter of |f|, or a hundredth of g; and less again (Huber) where its
residual is large among the rest.

When to use it: the body is tilted now and then, and mostly not accelerated. It sees the rotation between magnetometer
and accelerometer, but for the part about an axis that stays vertical. Rotation about one body axis only leaves the
offset along it open.

Source: M. Kok, T. B. Schön, IEEE Sensors J. 16 (2016), for the inclination as a parameter beside the matrix; the
plain form is Σ (aᵀRm − |a||m| sin I)².

>>> down, trust = verticals(np.array([[0.0, 0.0, -9.8]] * 3 + [[5.0, 0.0, -9.8]]))
>>> down[0] + 0.0, trust.round(2)
(array([0., 0., 1.]), array([1.  , 1.  , 1.  , 0.01]))
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.geometry.ellipsoid import symmetric
from flinders.geometry.quaternions import inverse, rotated
from flinders.geometry.rotation import components, lengths, transformed, vectors_of
from flinders.likelihood.equations import NormalEquations
from flinders.likelihood.robust import robust_sigma
from flinders.likelihood.term import Block, Term

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.arrays import Floats

QUIET: Final = 0.01
"""Of gravity: scatter of an accelerometer's length that is never compared with a reading."""

LEAST_REST: Final = 0.2
"""Of gravity: what an accelerometer shows at rest at least; no bias is as large, but a step towards one may be."""

GRAVITY: Final = 9.80665
"""m/s², that biases of accelerometers are told in parts of."""

ACCELERATION_SIGMA: Final = 0.3
"""m/s²: what the bias of an accelerometer may be; small ones that nobody has calibrated have as much."""

GAIN_SIGMA: Final = 0.02
"""What its gains may be off by, and its axes from square, in rad."""

LEAST_RAISED: Final = 1e-3
"""Squared cosine of a dip below which the field is vertical, and tells nothing of a vertical's tilt."""

EXACT: Final = 1e-6
"""Standard deviation, of gravity, of what somebody states is exact."""


def verticals(acceleration: Floats) -> tuple[Floats, Floats]:
    """Take the vertical from an accelerometer.

    `acceleration`: (N, 3), specific force in body axes, any unit: at rest and level −g on z.

    Returns
    -------
    down : (N, 3) float
        Unit vectors; zero where there is none.
    trust : (N,) float
        0 to 1.
    """
    length = np.linalg.norm(acceleration, axis=1)
    observed = np.asarray(np.isfinite(length) & (length > 0.0))
    if not observed.any():
        return np.zeros_like(acceleration), np.zeros(len(acceleration))
    down = np.where(observed[:, np.newaxis], -acceleration / np.where(observed, length, 1.0)[:, np.newaxis], 0.0)
    usual = float(np.median(length[observed]))
    scatter = 3.0 * max(robust_sigma(length[observed] - usual), QUIET * usual / 3.0)
    trust = np.where(observed, 1.0 / (1.0 + ((length - usual) / scatter) ** 2), 0.0)
    return down, trust


@dataclass(frozen=True, slots=True, eq=False)
class AccelerometerPrior:
    """What is known of an accelerometer's errors before the magnetometer is looked at."""

    # (9,): bias β of gravity, and the upper triangle of Γ in the order of `flinders.geometry.ellipsoid.symmetric`: at
    # rest (1 + Γ)(gβ − f) is down, and as long as gravity
    mean: Floats
    precision: Floats  # (9, 9)
    scale: float = 1.0  # what gravity is long in the recorded unit, for Γ = 0

    @classmethod
    def of(cls, *, bias: float = ACCELERATION_SIGMA, gain: float = GAIN_SIGMA) -> Self:
        """Errors about zero: a bias in m/s², gains, and axes from square in rad, 1 σ.

        The unit of gravity is the median of |f|, in which the bias is: all gains are off by as much together.

        >>> (1.0 / np.sqrt(np.diag(AccelerometerPrior.of(bias=0.0).precision))).round(6)[[0, 3, 6]]
        array([1.e-06, 2.e-02, 1.e-02])
        """
        sigmas = np.repeat([bias / GRAVITY, gain, 0.5 * gain], 3)
        covariance = np.diag(np.maximum(sigmas, EXACT) ** 2)
        covariance[3:6, 3:6] += (bias / GRAVITY) ** 2
        return cls(np.zeros(9), np.linalg.inv(covariance))

    def equations(self, errors: Floats) -> NormalEquations:
        """Normal equations at (9,) errors, in standard deviations."""
        left = self.mean - errors
        return NormalEquations(self.precision, self.precision @ left, float(left @ self.precision @ left), 0)


def upright(down: Floats, errors: Floats) -> tuple[Floats, Floats]:
    """Take an accelerometer's errors off its verticals.

    At rest w = (1 + Γ)(ρd + β) with ρ = |f|/g points down, and ρ makes it of unit length. What is given is w/ρ, which
    is not quite of unit length and has the noise of d, whatever the errors.

    `down`: (..., 3), unit vectors d; `errors`: (9,), β and Γ, as in `AccelerometerPrior`.

    Returns
    -------
    vertical : (..., 3) float
    rest : (...,) float
        ρ.

    >>> felt = np.array([0.0, 0.6, 0.8]) - np.array([0.0, 0.0, 0.03])               # of an accelerometer that is off
    >>> bias = np.array([0.0, 0.0, 0.03, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    >>> vertical, rest = upright(felt / np.linalg.norm(felt), bias)
    >>> (vertical * rest).round(12), bool(np.isclose(rest, np.linalg.norm(felt)))
    (array([0. , 0.6, 0.8]), True)
    """
    whole = np.eye(3) + symmetric(errors[3:])
    scaled, bias = transformed(whole, down), whole @ errors[:3]
    along = np.einsum("...i,i->...", scaled, bias)
    square = np.maximum(np.einsum("...i,...i->...", scaled, scaled), LEAST_REST**2)
    root = np.sqrt(np.maximum(along**2 + square * (1.0 - bias @ bias), LEAST_REST**2))
    rest = np.maximum((root - along) / square, LEAST_REST)
    return scaled + vectors_of(np.divide.outer(bias, rest)), rest


def by_errors(rows: Floats, down: Floats, errors: Floats) -> Floats:
    """(..., 9) how rᵀv moves with the errors, of (..., 3) rows r and the verticals v of `upright`."""
    vertical, rest = upright(down, errors)
    whole = np.eye(3) + symmetric(errors[3:])
    lengthened = np.einsum("...i,...i->...", vertical, transformed(whole, down))
    share = np.einsum("...i,i->...", rows, whole @ errors[:3]) / (rest * np.maximum(lengthened, LEAST_REST))
    rows = rows + share[..., np.newaxis] * vertical  # ρ moves with the errors, too
    felt = down + vectors_of(np.divide.outer(errors[:3], rest))
    parts = transformed(whole, rows) / rest[..., np.newaxis], by_symmetric(rows, felt)
    return vectors_of(np.concatenate([components(part) for part in parts]))


def by_symmetric(rows: Floats, vectors: Floats) -> Floats:
    """(..., 6) how rᵀΓx moves with the upper triangle of Γ, of (..., 3) rows r and vectors x.

    >>> by_symmetric(np.array([1.0, 2.0, 3.0]), np.array([1.0, 1.0, 0.0]))
    array([1., 2., 0., 3., 3., 3.])
    """
    first, second = components(rows), components(vectors)
    crossed = [first[i] * second[j] + first[j] * second[i] for i, j in ((0, 1), (0, 2), (1, 2))]
    return vectors_of(np.stack([*(first * second), *crossed]))


def verticals_of(attitude: Floats) -> tuple[Floats, Floats]:
    """Take the vertical from (N, 4) logged attitudes, which turns it into body axes without regard to yaw.

    >>> from flinders.geometry.quaternions import of_angles
    >>> down, _ = verticals_of(of_angles([[0.0, 0.0, 0.5], [0.0, 0.0, 2.5]]))       # level, on two headings
    >>> down.round(9) + 0.0
    array([[0., 0., 1.],
           [0., 0., 1.]])
    """
    observed = np.asarray(np.isfinite(attitude).all(axis=1))
    safe = np.where(observed[:, np.newaxis], attitude, [1.0, 0.0, 0.0, 0.0])
    down = rotated(inverse(safe), np.broadcast_to([0.0, 0.0, 1.0], (len(attitude), 3)))
    return down * observed[:, np.newaxis], observed.astype(float)


def heights(down: Floats, q: Floats) -> Floats:
    """(W, n) vᵀq, of verticals v and the field's direction q at each reading, both (W, n, 3)."""
    height: Floats = np.einsum("wni,wni->wn", down, q)
    return height


def residuals(down: Floats, q: Floats, sine: float) -> Floats:
    """(W, n) |v| sin I − vᵀq."""
    left: Floats = sine * lengths(down) - heights(down, q)
    return left


def fill(
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
    """Write the Jacobian of vᵀq − |v| sin I.

    That of an accelerometer's errors is taken at the vertical on which residual and field agree: the noise that stands
    in the residual would else be in it, and gains would follow that noise.

    Parameters
    ----------
    jacobian : (W, n, P) float
    recorded : (W, n, 3) float
        Unit vectors d.
    q : (W, n, 3) float
        The field's direction.
    errors : (9,) float
        Of the accelerometer.
    of_gyro : slice
        Columns that go with `moved`.
    moved : (W, n, 3, m) float, optional
        How q goes with a gyro.
    """
    down, _ = upright(recorded, errors)
    length = lengths(down)
    if "sine" in columns:
        jacobian[..., columns["sine"].start] = -length
    if "accelerometer" in columns:
        height = sine / np.maximum(length, 1e-300)
        raised = q - height[..., np.newaxis] * down
        off = residuals(down, q, sine) / np.maximum(np.einsum("wni,wni->wn", raised, raised), LEAST_RAISED)
        agreed = recorded + off[..., np.newaxis] * raised
        jacobian[..., columns["accelerometer"]] = by_errors(raised, agreed, errors)
    if moved is not None:
        jacobian[..., of_gyro] = np.einsum("wni,wnij->wnj", down, moved)


TERM: Final = Term(
    "dip",
    "accelerometer",
    "the accelerometer: the field's angle to the vertical stays the same",
    ("acceleration",),
    (Block("accelerometer", 9), Block("sine", 1)),
)
TILT: Final = Term("tilt", "logged tilt", "the logged attitude without its yaw, as `dip`", ("attitude",))
"""The same from a logged attitude, which has no such errors."""
