"""Noise of the corrected readings of a fit for a filter, and limits for firmware to detect disturbed readings.

A reading x of the field's direction q has the error S⁻¹(δb + δS q + n) in the corrected direction, from the parameters
with their covariance C and from noise n with the standard deviation σ on each axis,

    M(q) = G C Gᵀ + σ² S⁻¹S⁻ᵀ

with the derivative G of the reading by the parameters. The first part is the same in every reading of a direction, the
second part is white: `noise_of` gives both. Firmware detects a disturbed reading by limits (`gates_of`). They follow
from 1 σ of the length, F √(qᵀ M q), and of the direction, which is at most the root of the largest eigenvalue of M. The
limits are those of the worst direction, so that clean readings exceed them no more often than stated.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.geometry.ellipsoid import parameter_derivatives
from flinders.geometry.plane import down_direction
from flinders.geometry.sphere import fibonacci
from flinders.heading.error_propagation import level_fields
from flinders.targets._measurement_noise import MeasurementNoise
from flinders.targets._target import GATE_SIGMAS, TILT_DEG, Gates

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.fitting.aiding import Aiding
    from flinders.fitting.result import Fit

DIRECTIONS: Final = fibonacci(400)
"""(N, 3) directions at which the error of a reading is computed, to find the worst for the limits of `gates_of`."""


def noise_of(fit: Fit) -> MeasurementNoise | None:
    """White noise and constant error of corrected readings; None if the fit states no noise or no uncertainty.

    >>> from flinders import fit, simulate
    >>> noise = noise_of(fit(simulate.tumble(seed=1).samples))
    >>> round(noise.reading, 2), round(noise.calibration, 3)
    (0.53, 0.026)
    >>> round(noise.heading_reading_deg, 2), round(noise.heading_calibration_deg, 2)
    (1.24, 0.06)
    """
    if not _is_stated(fit) or math.isnan(fit.heading_error_deg.rms):
        return None
    claim, strength = fit.claim, fit.calibration.field_strength
    dip_deg, turn, down = claim.known_dip_deg, fit.calibration.rotation_matrix, down_direction(claim.plane)
    across, directions = level_fields(dip_deg, down)
    systematic, white = _errors(fit, (turn.T @ directions).T, claim.claimed_covariance)
    systematic, white = (turn @ part @ turn.T for part in (systematic.mean(axis=0), white))
    of_reading = float(np.sqrt(np.einsum("in,ij,jn->n", across, white, across).mean()))
    return MeasurementNoise(
        reading=strength * _horizontal_sigma(white, down),
        calibration=strength * _horizontal_sigma(systematic, down),
        heading_reading_deg=math.degrees(of_reading),
        heading_calibration_deg=math.hypot(fit.heading_error_deg.rms, claim.alignment_error_deg or 0.0),
        horizontal=strength * math.cos(math.radians(dip_deg)),
        dip_deg=dip_deg,
        dip_assumed=claim.dip_assumed,
        field_covariance=strength**2 * (systematic + white),
    )


def field_covariance(fit: Fit, fields: Floats) -> Floats:
    """(N, 3, 3) covariance of (N, 3) corrected readings, in the square of their unit; zero if unknown.

    It is the sum of the constant and the white part at the direction of each reading, in the axes of the calibration.
    """
    if not _is_stated(fit):
        return np.zeros((len(fields), 3, 3))
    turn = fit.calibration.rotation_matrix
    systematic, white = _errors(
        fit, fields @ turn / np.linalg.norm(fields, axis=1, keepdims=True), fit.claim.claimed_covariance
    )
    covariance: Floats = fit.calibration.field_strength**2 * turn @ (systematic + white) @ turn.T
    return covariance


def _horizontal_sigma(covariance: Floats, down: Floats | None) -> float:
    """Standard deviation along a horizontal axis, as rms of the two horizontal axes, by a (3, 3) covariance."""
    vertical = np.array([0.0, 0.0, 1.0]) if down is None else down / np.linalg.norm(down)
    return math.sqrt(max(float(np.trace(covariance) - vertical @ covariance @ vertical), 0.0) / 2.0)


def gates_of(fit: Fit) -> Gates | None:
    """Limits that clean readings of a fit seldom exceed, for length, change and dip.

    None if the noise or the uncertainty of the fit is unknown, or if no reading could exceed the limits. There is a
    limit of the dip if the fit found the dip, and the rotation against an accelerometer or attitude.

    >>> from flinders import fit, simulate
    >>> gates = gates_of(fit(simulate.tumble(seed=1).samples))
    >>> round(gates.strength_limit, 1), gates.has_dip
    (2.4, False)
    """
    if not _is_stated(fit):
        return None
    systematic, white = _errors(fit, DIRECTIONS, fit.claim.covariance)
    errors = systematic + white
    along = np.einsum("ni,nij,nj->n", DIRECTIONS, errors, DIRECTIONS)
    strength = GATE_SIGMAS * fit.calibration.field_strength * float(np.sqrt(along.max()))
    if not strength < fit.calibration.field_strength:
        return None
    aiding = fit.evidence.aiding
    if fit.calibration.rotation != "estimated" or aiding is None or aiding.dip_deg is None:
        return Gates(strength)
    across = float(np.linalg.eigvalsh(errors)[:, -1].max()) + _mounting_variance(aiding)
    limit = GATE_SIGMAS * math.hypot(math.degrees(math.sqrt(across)), aiding.dip_sigma_deg or 0.0, TILT_DEG)
    return Gates(strength, aiding.dip_deg, limit)


def _is_stated(fit: Fit) -> bool:
    """Whether the fit states its noise and its uncertainty."""
    return math.isfinite(fit.evidence.noise) and fit.claim.states_uncertainty


def _errors(fit: Fit, directions: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Both parts of M, for unit fields: (N, 3, 3) G C Gᵀ in (N, 3) directions, and (3, 3) σ² S⁻¹S⁻ᵀ."""
    inverse = np.linalg.inv(fit.calibration.ellipsoid.shape)
    rows = np.stack(
        [parameter_derivatives(np.tile(row, (len(directions), 1)).T, directions.T) for row in inverse], axis=1
    )
    carried: Floats = rows @ np.asarray(covariance) @ np.swapaxes(rows, 1, 2)
    carried = (carried + np.swapaxes(carried, 1, 2)) / 2.0
    return carried, fit.evidence.noise**2 * inverse @ inverse.T


def _mounting_variance(aiding: Aiding) -> float:
    """Variance of the rotation against the body about its least certain axis, in rad²."""
    covariance = aiding.rotation_covariance
    return 0.0 if covariance is None else float(np.linalg.eigvalsh(covariance)[-1])
