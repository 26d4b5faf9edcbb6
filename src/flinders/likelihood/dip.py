"""The angle between the field and the vertical is the same whichever way the body is held.

With a unit vector d_k that points down in body axes and the field's direction q_k there,

    d_kᵀ q_k = sin I

for all readings: I the dip, found with the rest or known of the site. The vertical comes from the accelerometer, down =
−f/|f|, or from a logged attitude without its yaw, which may stem from the very compass that is to be calibrated.

An accelerometer has a bias, 0.1 to 0.5 m/s² where nobody has calibrated it, that tilts its vertical by degrees. Taken
for the truth it would bend offset and shape by far more than noise; it is found with the rest, see
`flinders.likelihood.observations`.

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

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.geometry.quaternions import inverse, rotated
from flinders.geometry.rotation import lengths
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

HUBER: Final = 2.5
"""Standard deviations beyond which a residual counts less than its square."""

MAD: Final = 1.4826
"""Standard deviation of Gaussian noise in median absolute deviations."""


def verticals(acceleration: Floats) -> tuple[Floats, Floats]:
    """Take the vertical from an accelerometer.

    Parameters
    ----------
    acceleration : (N, 3) float
        Specific force in body axes, any unit: at rest and level −g on z.

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
    scatter = 3.0 * max(MAD * float(np.median(np.abs(length[observed] - usual))), QUIET * usual / 3.0)
    trust = np.where(observed, 1.0 / (1.0 + ((length - usual) / scatter) ** 2), 0.0)
    return down, trust


def upright(down: Floats, bias: Floats) -> tuple[Floats, Floats]:
    """Take an accelerometer's bias off its verticals.

    At rest f = f₀ + gβ with |f₀| = g puts the vertical where ρd + β points, with ρ = |f|/g from |ρd + β| = 1. What is
    given is d + β/ρ, which is not quite of unit length and has the noise of d, whatever β.

    Parameters
    ----------
    down : (..., 3) float
        Unit vectors d.
    bias : (3,) float, of gravity
        β.

    Returns
    -------
    vertical : (..., 3) float
        d + β/ρ.
    rest : (...,) float
        ρ.

    Examples
    --------
    >>> felt = np.array([0.0, 0.6, 0.8]) - np.array([0.0, 0.0, 0.03])               # of an accelerometer that is off
    >>> vertical, rest = upright(felt / np.linalg.norm(felt), np.array([0.0, 0.0, 0.03]))
    >>> (vertical * rest).round(12), bool(np.isclose(rest, np.linalg.norm(felt)))
    (array([0. , 0.6, 0.8]), True)
    """
    along = down @ bias
    rest = np.maximum(np.sqrt(np.maximum(1.0 - bias @ bias + along**2, LEAST_REST**2)) - along, LEAST_REST)
    return down + bias / rest[..., np.newaxis], rest


def by_bias(down: Floats, bias: Floats) -> Floats:
    """(..., 3, 3) how the vertical of `upright` moves with the bias."""
    along = down @ bias
    root = np.sqrt(np.maximum(1.0 - bias @ bias + along**2, LEAST_REST**2))
    rest = np.maximum(root - along, LEAST_REST)[..., np.newaxis]
    slope = down + (bias - along[..., np.newaxis] * down) / root[..., np.newaxis]  # −∂ρ/∂β
    moved: Floats = np.eye(3) / rest[..., np.newaxis] + bias[:, np.newaxis] * (slope / rest**2)[..., np.newaxis, :]
    return moved


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


def huber(residuals: Floats, *, beyond: float = HUBER) -> Floats:
    """Weights of residuals in standard deviations.

    >>> huber(np.array([0.5, -5.0]))
    array([1. , 0.5])
    """
    weights: Floats = beyond / np.maximum(np.abs(residuals), beyond)
    return weights


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
    bias: Floats,
    of_gyro: slice,
    moved: Floats | None,
) -> None:
    """Write the Jacobian of vᵀq − |v| sin I.

    Parameters
    ----------
    jacobian : (W, n, P) float
    columns : mapping of str to slice
    recorded : (W, n, 3) float
        Unit vectors d.
    q : (W, n, 3) float
        The field's direction.
    sine : float
    bias : (3,) float, of gravity
    of_gyro : slice
        Columns that go with `moved`.
    moved : (W, n, 3, m) float, optional
        How q goes with a gyro.
    """
    down, _ = upright(recorded, bias)
    length = lengths(down)
    if "sine" in columns:
        jacobian[..., columns["sine"].start] = -length
    if "acceleration_bias" in columns:
        height = sine / np.maximum(length, 1e-300)
        raised = q - height[..., np.newaxis] * down
        jacobian[..., columns["acceleration_bias"]] = np.einsum("wni,wnij->wnj", raised, by_bias(recorded, bias))
    if moved is not None:
        jacobian[..., of_gyro] = np.einsum("wni,wnij->wnj", down, moved)


TERM: Final = Term(
    "dip",
    "accelerometer",
    "the accelerometer: the field's angle to the vertical stays the same",
    ("acceleration",),
    (Block("acceleration_bias", 3, ACCELERATION_SIGMA / GRAVITY), Block("sine", 1)),
)
TILT: Final = Term("tilt", "logged tilt", "the logged attitude without its yaw, as `dip`", ("attitude",))
"""The same from a logged attitude, which has no bias."""
