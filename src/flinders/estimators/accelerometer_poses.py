"""Offsets, gains and misalignment of an accelerometer from still poses, by the length of gravity alone.

At rest (1 + Γ)(f/g − β) has length 1 however the device is held. Minimises over β and the symmetric Γ

    Σ ((1 − |(1 + Γ)(β − f/g)|) / σ)²  +  |Γ₁₂, Γ₁₃, Γ₂₃|² / 0.01²

σ is the noise of the mean of a pose. The second term is what is known of a chip before: its axes are square to 1 %. Of
six poses on the sides it decides the misalignment, so that these determine offsets and gains, and the claim has the
misalignment in it; poses on edges and corners determine all nine. A rotation of the whole accelerometer against the
device cannot be seen by gravity's length, nor by any other fit of this kind.

When to use it: a device can be put down on its six sides, or held still in ten or more attitudes. Where it can only be
turned slowly, each reading counts as a pose, and residuals tell the noise (`from_readings`).

Source: I. Frosio, F. Pedersini, N. A. Borghese, IEEE Trans. Instrum. Meas. 58 (2009), eq. 4 and 8; six sides as in
IEEE Std 1293 (2018).

>>> from flinders.estimators.still_poses import StillPoses
>>> rng = np.random.default_rng(2)
>>> sides = np.concatenate([np.eye(3), -np.eye(3)])
>>> read = sides @ np.diag([9.9, 9.7, 9.8]) + [0.2, -0.1, 0.3]
>>> felt = np.repeat(read, 100, axis=0) + rng.normal(scale=0.02, size=(600, 3))
>>> found = from_poses(StillPoses.of(felt))
>>> triad = found.triad()
>>> bool(np.all(np.abs(triad.offset - [0.2, -0.1, 0.3]) < 4.0 * triad.offset_sigma))
True
>>> triad.unit, found.sees_misalignment
('m/s2', False)
>>> round(found.tilt_error.rms, 1)                                   # degrees: misalignment that was not seen
0.6
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.inertial import SIZES, STANDARD_GRAVITY, TiltError, Triad
from flinders.errors import FitError, MissingPose, TooFewSamples
from flinders.estimators.accelerometer import known_before
from flinders.geometry.ellipsoid import symmetric
from flinders.geometry.rotation import lengths
from flinders.heading.tilt_error import tilt_error, turns
from flinders.likelihood.dip import AccelerometerPrior, by_symmetric

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.inertial_record import InertialUnit
    from flinders.estimators.still_poses import StillPoses

OFFSET_SIGMA: Final = 0.2
"""Of gravity: what an offset may be before; poses tell it a hundred times better, or it is open."""
GAIN_SIGMA: Final = 0.2
"""What gains may differ by before, from that of the median length."""
ORTHOGONALITY_SIGMA: Final = 0.01
"""rad: half of what two axes are off 90° by, 1 σ; data sheets say 1 to 2 % of cross-axis sensitivity."""
OPEN: Final = 0.02
"""Standard deviation of an offset, of gravity, or of a gain, that poses leave open: it alone makes a tilt of 1°."""
SEEN: Final = 0.5
"""Share of ORTHOGONALITY_SIGMA below which poses show the misalignment."""
FINEST: Final = 1e-4
"""Of gravity: no mean of a pose is known better, as offsets wander and tables give way."""
BY_HAND: Final = 0.05
"""rad: how exactly a side can be put up again; what a repeated side tells through its small tilt does not count."""
STEPS: Final = 20
MIN_POSES: Final = 6
MIN_READINGS: Final = 60
"""Readings, each a pose of its own, of a device that is turned slowly."""
SURE: Final = 0.01
"""Probability below which residuals are too large for the noise of the poses."""
MOST_LEFT: Final = 0.05
"""Of gravity: what poses may differ by in length after the fit, rms."""
NEARLY: Final = 0.1
"""What the median length of gravity may differ by from that of a unit, of an accelerometer that is not calibrated."""

SIDES: Final = np.concatenate([np.eye(3), -np.eye(3)])
"""(6, 3) specific force on the six sides: the axis that points up."""
SIDE_WORDS: Final = tuple(f"{sign}{axis}" for sign, axis in product("+−", "xyz"))


@dataclass(frozen=True, eq=False)
class AccelerometerEstimate:
    """Errors of an accelerometer, with their covariance."""

    errors: Floats  #: (9,): β, and the upper triangle of Γ, as in `flinders.likelihood.dip.AccelerometerPrior`
    covariance: Floats  #: (9, 9)
    scale: float  #: what gravity is in the unit of the readings, for Γ = 0
    poses: int  #: poses that were used, or readings that each count as one
    excess: float = 1.0  #: factor by which residuals are larger than the noise of the poses explains, 1 σ
    gravity: float = STANDARD_GRAVITY  #: m/s²

    @property
    def sees_misalignment(self) -> bool:
        """Whether poses show how square the axes are."""
        return bool(np.sqrt(np.diag(self.covariance)[6:].max()) < SEEN * ORTHOGONALITY_SIGMA)

    @cached_property
    def tilt_error(self) -> TiltError:
        """Error of the vertical at rest, within the accelerometer's own axes."""
        return tilt_error(self.errors, self.covariance)

    @property
    def next_side(self) -> str:
        """The side that tells most of what is open, by the axis that then points up: ``−y``."""
        return SIDE_WORDS[int(np.argmax(self._gains(SIDES)))]

    @property
    def open_parameters(self) -> int:
        """How many of the three offsets and three gains the poses leave open."""
        return int(np.count_nonzero(np.sqrt(np.diag(self.covariance)[:6]) > OPEN))

    def triad(self) -> Triad:
        """The correction, in the unit that the length of gravity tells."""
        whole, size = np.eye(3) + symmetric(self.errors[3:]), self.gravity / self.scale
        sigma = np.sqrt(np.diag(self.covariance))
        return Triad(
            size * whole, self.scale * self.errors[:3], unit_of(self.scale), size * symmetric(sigma[3:]),
            self.scale * sigma[:3],
        )  # fmt: skip

    def _gains(self, attitudes: Floats) -> Floats:
        """(N,) by how much one more pose in each of (N, 3) attitudes shrinks the mean square of tilts."""
        row = np.concatenate([-attitudes, by_symmetric(attitudes, attitudes)], axis=1)
        moved = turns(self.errors, np.concatenate([SIDES, attitudes]))
        tilts = np.einsum("nki,nkj->ij", moved, moved)
        seen = row @ self.covariance
        shrunk: Floats = np.einsum("ni,ij,nj->n", seen, tilts, seen) / (np.einsum("ni,ni->n", seen, row) + BY_HAND**2)
        return shrunk


def from_poses(poses: StillPoses, *, gravity: float = STANDARD_GRAVITY) -> AccelerometerEstimate:
    """Estimate from still poses.

    Parameters
    ----------
    gravity : float, m/s²
        That of the place. An error of it goes into all gains alike, and into no tilt.

    Raises
    ------
    MissingPose
        Where the poses leave an offset or a gain open; it says which side to put up next.
    """
    if not len(poses):
        raise MissingPose("no still pose was found: put the device down on each of its six sides for 2 s")
    scale, before = poses.scale, _prior()
    force, sigma = poses.mean / scale, np.hypot(poses.noise / scale, FINEST)
    errors = before.mean
    for _ in range(STEPS):
        residuals, jacobian = _equations(force, errors)
        weighted = jacobian.T / sigma**2
        precision = before.precision + weighted @ jacobian
        gradient = before.precision @ (before.mean - errors) + weighted @ residuals
        errors = errors + np.linalg.solve(precision, gradient)
    residuals, jacobian = _equations(force, errors)
    _refuse_far(residuals)
    covariance = np.linalg.inv(before.precision + (jacobian.T / sigma**2) @ jacobian)
    found = AccelerometerEstimate(errors, covariance, scale, len(poses), gravity=gravity)
    _refuse_open(found)
    return _widened(found, residuals, jacobian, sigma)


def from_readings(acceleration: Floats, *, gravity: float = STANDARD_GRAVITY) -> AccelerometerEstimate:
    """Estimate from (N, 3) readings of a device that is turned slowly, each a pose; residuals tell the noise.

    Raises as `from_poses`, and `TooFewSamples`.
    """
    known = acceleration[np.isfinite(acceleration).all(axis=1) & acceleration.any(axis=1)]
    if len(known) < MIN_READINGS:
        raise TooFewSamples(found=len(known), needed=MIN_READINGS, method="accelerometer")
    after = known_before(known, _prior())
    scale = float(np.median(lengths(known)))
    found = AccelerometerEstimate(after.mean, np.linalg.inv(after.precision), scale, len(known), gravity=gravity)
    _refuse_open(found)
    return found


def unit_of(scale: float) -> InertialUnit:
    """The unit in which gravity has about this length; counts where it has in none.

    >>> unit_of(9.7), unit_of(1.02), unit_of(990.0), unit_of(4130.0)
    ('m/s2', 'g', 'mg', 'counts')
    """
    names: tuple[InertialUnit, ...] = ("m/s2", "g", "mg")
    return next((name for name in names if abs(scale * SIZES[name] / STANDARD_GRAVITY - 1.0) < NEARLY), "counts")


def _prior() -> AccelerometerPrior:
    """What is known of any accelerometer."""
    sigmas = np.repeat([OFFSET_SIGMA, GAIN_SIGMA, ORTHOGONALITY_SIGMA], 3)
    return AccelerometerPrior(np.zeros(9), np.diag(sigmas**-2.0))


def _equations(force: Floats, errors: Floats) -> tuple[Floats, Floats]:
    """(P,) residuals 1 − |(1 + Γ)(β − f)|, and (P, 9) how their negative moves with the errors."""
    whole = np.eye(3) + symmetric(errors[3:])
    felt = errors[:3] - force
    corrected = felt @ whole
    length = lengths(corrected)
    along = corrected / length[:, np.newaxis]
    return 1.0 - length, np.concatenate([along @ whole, by_symmetric(along, felt)], axis=1)


def _refuse_open(found: AccelerometerEstimate) -> None:
    """Raise `MissingPose` where an offset or a gain is open."""
    if found.open_parameters:
        side = found.next_side
        opposite = ("−" if side[0] == "+" else "+") + side[1]
        raise MissingPose(
            f"the poses leave {found.open_parameters} of the 6 offsets and gains open: turn the box so that "
            f"{side} points up ({opposite} down), hold it still for 2 s, and record all poses again",
            side=side.replace("−", "-"),
            poses=found.poses,
            open=found.open_parameters,
        )


def _refuse_far(residuals: Floats) -> None:
    """Raise `FitError` where no offsets and gains make the poses as long as gravity."""
    left = float(np.sqrt(np.mean(residuals**2)))
    if not left < MOST_LEFT:
        raise FitError(
            f"lengths of the still poses differ by {left:.0%} whatever offsets and gains are taken off: give the "
            "columns of an accelerometer, and of an analog one less the reading of its middle",
            hint={"columns": None},
            left=left,
        )


def _widened(found: AccelerometerEstimate, residuals: Floats, jacobian: Floats, sigma: Floats) -> AccelerometerEstimate:
    """The estimate with a wider covariance where residuals are larger than the noise of the poses explains."""
    used = np.einsum("pi,ij,pj->", jacobian / sigma[:, np.newaxis], found.covariance, jacobian / sigma[:, np.newaxis])
    freedom = len(residuals) - float(used)
    if freedom < 1.0:
        return found
    excess = float(np.sum((residuals / sigma) ** 2)) / freedom
    if excess <= _chi_square_limit(freedom) / freedom:
        return found
    student = 1.0 + 2.0 / freedom  # few residuals may show it too small
    is_known = np.diag(found.covariance) < 0.25 * np.repeat([OFFSET_SIGMA, GAIN_SIGMA, ORTHOGONALITY_SIGMA], 3) ** 2
    factor = np.where(is_known, math.sqrt(excess * student), 1.0)
    covariance = found.covariance * np.outer(factor, factor)
    return replace(found, covariance=covariance, excess=math.sqrt(excess))


def _chi_square_limit(freedom: float) -> float:
    """χ² that chance exceeds with the probability `SURE` (E. B. Wilson, M. M. Hilferty, PNAS 17 (1931) 684)."""
    part = 2.0 / (9.0 * freedom)
    return freedom * (1.0 - part + 2.326 * math.sqrt(part)) ** 3
