"""Offsets, gains and misalignment of an accelerometer from still poses, by the length of gravity alone.

At rest (1 + Γ)(f/g − β) has length 1 at any attitude. Minimises over β and the symmetric Γ

    Σ ((1 − |(1 + Γ)(β − f/g)|) / σ)²  +  |Γ₁₂, Γ₁₃, Γ₂₃|² / 0.01²

with σ the noise of the mean of a pose. The second term is a prior: the axes of a chip are orthogonal to 1 %. Six poses
on the sides determine offsets and gains; the misalignment keeps its prior, whose uncertainty is in the claim. Poses on
edges and corners determine all nine parameters. A rotation of the whole accelerometer relative to the device cannot be
estimated, because the length of gravity does not depend on it.

When to use it: if the device can be put down on its six sides, or held still in ten or more attitudes. If it can only
be turned slowly, each reading counts as a pose, and the noise is estimated from residuals (`from_readings`).

Source: I. Frosio, F. Pedersini, N. A. Borghese, IEEE Trans. Instrum. Meas. 58 (2009), eq. 4 and 8; six sides as in
IEEE Std 1293 (2018).

>>> from flinders.estimators.still_poses import StillPoses
>>> rng = np.random.default_rng(2)
>>> sides = np.concatenate([np.eye(3), -np.eye(3)])
>>> read = sides @ np.diag([9.9, 9.7, 9.8]) + [0.2, -0.1, 0.3]
>>> acceleration = np.repeat(read, 100, axis=0) + rng.normal(scale=0.02, size=(600, 3))
>>> found = from_poses(StillPoses.of(acceleration))
>>> triad = found.triad()
>>> bool(np.all(np.abs(triad.offset - [0.2, -0.1, 0.3]) < 4.0 * triad.offset_sigma))
True
>>> triad.unit, found.has_misalignment
('m/s2', False)
>>> round(found.tilt_error.rms, 1)                                   # degrees: from the unknown misalignment
0.6
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.inertial import SI_PER_UNIT, STANDARD_GRAVITY, TiltError, Triad
from flinders.errors import FitError, MissingPose, TooFewSamples
from flinders.estimators.accelerometer import update_prior
from flinders.geometry.ellipsoid import symmetric_matrix
from flinders.geometry.rotation import lengths
from flinders.heading.tilt_error import tilt_error, tilt_gradients
from flinders.likelihood.dip import AccelerometerPrior, symmetric_derivatives

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.inertial_record import InertialUnit
    from flinders.estimators.still_poses import StillPoses

OFFSET_SIGMA: Final = 0.2
"""Prior standard deviation of an offset, relative to gravity."""
GAIN_SIGMA: Final = 0.2
"""Prior standard deviation of a gain, relative to the gain by the median length of the readings."""
ORTHOGONALITY_SIGMA: Final = 0.01
"""Prior standard deviation of half the error of the angle between two axes, rad; data sheets: 1 to 2 % cross-axis."""
MIN_UNDETERMINED_SIGMA: Final = 0.02
"""Standard deviation from which an offset, relative to gravity, or a gain is undetermined: it gives a tilt of 1°."""
MAX_DETERMINED_RATIO: Final = 0.5
"""Largest standard deviation at which the misalignment is determined, relative to `ORTHOGONALITY_SIGMA`."""
MIN_POSE_SIGMA: Final = 1e-4
"""Smallest standard deviation of the mean of a pose, relative to gravity, for drift of the offset and of the table."""
PLACEMENT_SIGMA_RAD: Final = 0.05
"""1 σ in rad of the attitude of a device that is put on a side by hand, for the choice of the next side."""
NEWTON_STEPS: Final = 20
"""Number of Gauss–Newton steps."""
MIN_POSES: Final = 6
"""Smallest number of poses that determine offsets and gains."""
MIN_READINGS: Final = 60
"""Smallest number of readings of a slowly turned device; each reading counts as a pose."""
EXCESS_PROBABILITY: Final = 0.01
"""p-value of the residuals below which the covariance is widened."""
MAX_RMS_RESIDUAL: Final = 0.05
"""Largest rms residual of the lengths of poses, relative to gravity."""
MAX_GRAVITY_DIFFERENCE: Final = 0.1
"""Largest relative difference of the median length of readings from gravity at which a unit is recognised."""

SIDES: Final = np.concatenate([np.eye(3), -np.eye(3)])
"""(6, 3) direction of the specific force in the six poses on the sides: the axis that points up."""
SIDE_WORDS: Final = tuple(f"{sign}{axis}" for sign, axis in product("+−", "xyz"))


@dataclass(frozen=True, eq=False)
class AccelerometerEstimate:
    """Errors of an accelerometer, with their covariance."""

    errors: Floats  #: (9,): β, and the upper triangle of Γ, as in `flinders.likelihood.dip.AccelerometerPrior`
    covariance: Floats  #: (9, 9)
    scale: float  #: gravity in the unit of the readings, for Γ = 0
    poses: int  #: number of poses, or of readings that count as poses
    excess: float = 1.0  #: ratio of the residuals to the noise of the poses
    gravity: float = STANDARD_GRAVITY  #: m/s²: gravity of the place

    @property
    def has_misalignment(self) -> bool:
        """Whether the poses determine the misalignment of the axes."""
        return bool(np.sqrt(np.diag(self.covariance)[6:].max()) < MAX_DETERMINED_RATIO * ORTHOGONALITY_SIGMA)

    @cached_property
    def tilt_error(self) -> TiltError:
        """Error of the vertical at rest, within the accelerometer's own axes."""
        return tilt_error(self.errors, self.covariance)

    @property
    def next_side(self) -> str:
        """Side to put up next for the most information, named by the axis that points up: ``−y``."""
        return SIDE_WORDS[int(np.argmax(self._gains(SIDES)))]

    @property
    def open_parameters(self) -> int:
        """Number of offsets and gains that the poses do not determine, 0 to 6."""
        return int(np.count_nonzero(np.sqrt(np.diag(self.covariance)[:6]) > MIN_UNDETERMINED_SIGMA))

    def triad(self) -> Triad:
        """Correction of the accelerometer, in the unit that follows from the length of gravity."""
        whole, size = np.eye(3) + symmetric_matrix(self.errors[3:]), self.gravity / self.scale
        sigma = np.sqrt(np.diag(self.covariance))
        return Triad(
            size * whole, self.scale * self.errors[:3], unit_of(self.scale), size * symmetric_matrix(sigma[3:]),
            self.scale * sigma[:3],
        )  # fmt: skip

    def _gains(self, attitudes: Floats) -> Floats:
        """(N,) reduction of the mean square tilt by one more pose in each of (N, 3) attitudes."""
        row = np.concatenate([-attitudes, symmetric_derivatives(attitudes, attitudes)], axis=1)
        moved = tilt_gradients(self.errors, np.concatenate([SIDES, attitudes]))
        tilts = np.einsum("nki,nkj->ij", moved, moved)
        seen = row @ self.covariance
        shrunk: Floats = np.einsum("ni,ij,nj->n", seen, tilts, seen) / (
            np.einsum("ni,ni->n", seen, row) + PLACEMENT_SIGMA_RAD**2
        )
        return shrunk


def from_poses(poses: StillPoses, *, gravity: float = STANDARD_GRAVITY) -> AccelerometerEstimate:
    """Estimate an accelerometer's errors from still poses.

    Parameters
    ----------
    poses : StillPoses
        Means of the still spans.
    gravity : float, m/s²
        Gravity of the place. An error of this value changes all gains equally, but no tilt.

    Raises
    ------
    MissingPose
        If the poses do not determine an offset or a gain; the message names the side to put up next.
    """
    if not len(poses):
        raise MissingPose("no still pose was found: put the device down on each of its six sides for 2 s")
    scale, before = poses.scale, _prior()
    force, sigma = poses.mean / scale, np.hypot(poses.noise / scale, MIN_POSE_SIGMA)
    errors = before.mean
    for _ in range(NEWTON_STEPS):
        residuals, jacobian = _equations(force, errors)
        weighted = jacobian.T / sigma**2
        precision = before.precision + weighted @ jacobian
        gradient = before.precision @ (before.mean - errors) + weighted @ residuals
        errors = errors + np.linalg.solve(precision, gradient)
    residuals, jacobian = _equations(force, errors)
    _refuse_residuals(residuals)
    covariance = np.linalg.inv(before.precision + (jacobian.T / sigma**2) @ jacobian)
    found = AccelerometerEstimate(errors, covariance, scale, len(poses), gravity=gravity)
    _refuse_undetermined(found)
    return _widen(found, residuals, jacobian, sigma)


def from_readings(acceleration: Floats, *, gravity: float = STANDARD_GRAVITY) -> AccelerometerEstimate:
    """Estimate an accelerometer's errors from (N, 3) readings of a slowly turned device; each counts as a pose.

    Raises as `from_poses`, and `TooFewSamples`.
    """
    known = acceleration[np.isfinite(acceleration).all(axis=1) & acceleration.any(axis=1)]
    if len(known) < MIN_READINGS:
        raise TooFewSamples(found=len(known), needed=MIN_READINGS, method="accelerometer")
    after = update_prior(known, _prior())
    scale = float(np.median(lengths(known)))
    found = AccelerometerEstimate(after.mean, np.linalg.inv(after.precision), scale, len(known), gravity=gravity)
    _refuse_undetermined(found)
    return found


def unit_of(scale: float) -> InertialUnit:
    """Unit in which gravity has about the length `scale`; counts if there is none.

    >>> unit_of(9.7), unit_of(1.02), unit_of(990.0), unit_of(4130.0)
    ('m/s2', 'g', 'mg', 'counts')
    """
    names: tuple[InertialUnit, ...] = ("m/s2", "g", "mg")
    return next(
        (name for name in names if abs(scale * SI_PER_UNIT[name] / STANDARD_GRAVITY - 1.0) < MAX_GRAVITY_DIFFERENCE),
        "counts",
    )


def _prior() -> AccelerometerPrior:
    """Prior of the errors of any accelerometer."""
    sigmas = np.repeat([OFFSET_SIGMA, GAIN_SIGMA, ORTHOGONALITY_SIGMA], 3)
    return AccelerometerPrior(np.zeros(9), np.diag(sigmas**-2.0))


def _equations(force: Floats, errors: Floats) -> tuple[Floats, Floats]:
    """(P,) residuals 1 − |(1 + Γ)(β − f)|, and their negative (P, 9) derivatives by the errors."""
    whole = np.eye(3) + symmetric_matrix(errors[3:])
    felt = errors[:3] - force
    corrected = felt @ whole
    length = lengths(corrected)
    along = corrected / length[:, np.newaxis]
    return 1.0 - length, np.concatenate([along @ whole, symmetric_derivatives(along, felt)], axis=1)


def _refuse_undetermined(found: AccelerometerEstimate) -> None:
    """Raise `MissingPose` if an offset or a gain is not determined."""
    if found.open_parameters:
        side = found.next_side
        opposite = ("−" if side[0] == "+" else "+") + side[1]
        raise MissingPose(
            f"the poses do not determine {found.open_parameters} of the 6 offsets and gains: turn the device so that "
            f"{side} points up ({opposite} down), hold it still for 2 s, and record all poses again",
            side=side.replace("−", "-"),
            poses=found.poses,
            open=found.open_parameters,
        )


def _refuse_residuals(residuals: Floats) -> None:
    """Raise `FitError` if the lengths of the poses still differ after the fit: the sensor is no accelerometer."""
    left = float(np.sqrt(np.mean(residuals**2)))
    if not left < MAX_RMS_RESIDUAL:
        raise FitError(
            f"lengths of the still poses differ by {left:.0%} for any offsets and gains: give the columns of an "
            "accelerometer, and for an analog accelerometer subtract its reading at zero acceleration",
            hint={"columns": None},
            left=left,
        )


def _widen(found: AccelerometerEstimate, residuals: Floats, jacobian: Floats, sigma: Floats) -> AccelerometerEstimate:
    """Widen the covariance of an estimate if the residuals are larger than the noise of the poses explains."""
    used = np.einsum("pi,ij,pj->", jacobian / sigma[:, np.newaxis], found.covariance, jacobian / sigma[:, np.newaxis])
    freedom = len(residuals) - float(used)
    if freedom < 1.0:
        return found
    excess = float(np.sum((residuals / sigma) ** 2)) / freedom
    if excess <= _chi_square_limit(freedom) / freedom:
        return found
    student = 1.0 + 2.0 / freedom  # few residuals can underestimate the excess
    is_known = np.diag(found.covariance) < 0.25 * np.repeat([OFFSET_SIGMA, GAIN_SIGMA, ORTHOGONALITY_SIGMA], 3) ** 2
    factor = np.where(is_known, math.sqrt(excess * student), 1.0)
    covariance = found.covariance * np.outer(factor, factor)
    return replace(found, covariance=covariance, excess=math.sqrt(excess))


def _chi_square_limit(freedom: float) -> float:
    """χ² exceeded by chance with `EXCESS_PROBABILITY` (E. B. Wilson, M. M. Hilferty, PNAS 17 (1931) 684)."""
    part = 2.0 / (9.0 * freedom)
    return freedom * (1.0 - part + 2.326 * math.sqrt(part)) ** 3
