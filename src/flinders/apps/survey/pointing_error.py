"""Errors of azimuth and inclination from the uncertainty of a calibration, and the best directions to shoot next.

The errors are those of shots within 30° of level, at all azimuths and rolls: from the covariance of the 24 parameters
of `flinders.likelihood.pointing` and the Jacobian of both angles. The Fisher information of a further direction with
four rolls is calculated with the same observation terms.

>>> level = attitudes_of(np.array([90.0]), np.array([0.0]), np.array([0.0]))  # the first axis points to the east
>>> level[0].round(9)[:, 0] + 0.0
array([0., 1., 0.])
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.apps.survey.instrument import PROCEDURE, ROLLS_DEG
from flinders.geometry.quaternions import from_angles
from flinders.likelihood.attitude import body_to_world
from flinders.likelihood.pointing import DOWN, ShotGroup, SurveyLayout, SurveyParameters

if TYPE_CHECKING:
    from flinders.arrays import Floats

AZIMUTHS_DEG, INCLINATIONS_DEG = np.arange(0.0, 360.0, 30.0), np.array([-30.0, 0.0, 30.0])

NEXT_COUNT: Final = 3
"""Number of directions that are proposed."""
RELATIVE_STEP: Final = 1e-6
"""Step of a numerical derivative, as a share of the size of a parameter."""


class PointingError(NamedTuple):
    """Error of an angle in degrees, 1 σ, for shots within 30° of level."""

    rms: float  #: rms over all azimuths, rolls and inclinations
    worst: float  #: at the worst azimuth, roll and inclination


class NextDirection(NamedTuple):
    """A direction for four shots, rolled by a quarter turn each, in degrees."""

    azimuth_deg: float  #: from magnetic north
    inclination_deg: float
    azimuth_error_deg: float  #: expected rms after shots in this direction and the previous ones
    inclination_error_deg: float  #: expected rms after shots in this direction and the previous ones


def attitudes_of(azimuth_deg: Floats, inclination_deg: Floats, roll_deg: Floats) -> Floats:
    """(N, 3, 3) rotations from an instrument's axes to north, east and down, from (N,) angles of its first axis."""
    roll, pitch, yaw = np.radians(np.stack([roll_deg, inclination_deg, azimuth_deg]))
    return body_to_world(from_angles(np.stack([roll, pitch, yaw], axis=-1)))


def predict_readings(at: SurveyParameters, attitudes: Floats) -> tuple[Floats, Floats]:
    """(N, 3) readings of field and gravity without noise, in (N, 3, 3) attitudes of the accelerometer's axes."""
    back = np.swapaxes(attitudes, 1, 2)
    magnetic = at.magnetometer.offset + back @ at.field @ at.magnetometer.rotated_shape.T
    return magnetic, invert_quadratic(at.accelerometer.offset + back @ DOWN @ at.accelerometer.shape, at.quadratic)


def invert_quadratic(straight: Floats, quadratic: Floats) -> Floats:
    """(..., 3) readings g of an accelerometer with quadratic terms q, from (..., 3) corrected g + q g².

    >>> g = invert_quadratic(np.array([-1.0, 0.0, 1.0]), np.array([0.04, 0.04, -0.04]))
    >>> (g + np.array([0.04, 0.04, -0.04]) * g**2).round(12)
    array([-1.,  0.,  1.])
    """
    readings: Floats = 2.0 * straight / (1.0 + np.sqrt(1.0 + 4.0 * quadratic * straight))
    return readings


def angle_gradients(at: SurveyParameters, gravity: float = 0.0) -> Floats:
    """(2, M, P) derivatives of azimuth and inclination in rad by P parameters, at M attitudes.

    P is 24, or 27 with quadratic terms; `gravity` is then that of `SurveyLayout`.
    """
    grid = np.meshgrid(AZIMUTHS_DEG, INCLINATIONS_DEG, ROLLS_DEG, indexing="ij")
    readings = predict_readings(at, attitudes_of(*(axis.ravel() for axis in grid)) @ at.to_instrument)
    here, layout, bare = at.angles(*readings), SurveyLayout(0, gravity), at.without_attitudes
    sizes = np.repeat([at.magnetometer.radius, 1.0, at.accelerometer.radius, 1.0], [9, 3, 9, layout.size - 21])
    moved = [bare.take_step(step, layout).angles(*readings) for step in np.diag(RELATIVE_STEP * sizes)]
    change = np.stack(moved, axis=-1) - here[..., np.newaxis]
    gradients: Floats = ((change + np.pi) % (2.0 * np.pi) - np.pi) / (RELATIVE_STEP * sizes)
    return gradients


def pointing_errors(gradients: Floats, covariance: Floats) -> tuple[PointingError, PointingError]:
    """Errors of azimuth and inclination, from (2, M, P) gradients and the (P, P) covariance of the parameters."""
    variances = np.sum(gradients @ covariance * gradients, axis=2)
    sigmas = np.degrees(np.sqrt(variances))
    azimuth, inclination = (PointingError(float(np.sqrt(np.mean(own**2))), float(own.max())) for own in sigmas)
    return azimuth, inclination


def next_directions(
    at: SurveyParameters, covariance: Floats, noises: Floats, *, gravity: float = 0.0
) -> tuple[NextDirection, ...]:
    """Directions of the procedure to shoot next, each chosen for the smallest expected errors after it.

    Parameters
    ----------
    covariance : (P, P) float
        Covariance of the parameters from the present shots.
    noises : (3,) float
        Standard deviations of a reading of field and gravity, and of aim.
    gravity : float
        As for `angle_gradients`.
    """
    gradients, information = angle_gradients(at, gravity), np.linalg.inv(covariance)
    added = [_information(at, azimuth, inclination, noises, gravity) for azimuth, inclination in PROCEDURE.tolist()]
    chosen = []
    for _ in range(NEXT_COUNT):
        errors = [pointing_errors(gradients, np.linalg.inv(information + own)) for own in added]
        best = int(np.argmin([math.hypot(azimuth.rms, inclination.rms) for azimuth, inclination in errors]))
        information = information + added[best]
        chosen.append(NextDirection(*PROCEDURE[best].tolist(), *(error.rms for error in errors[best])))
    return tuple(chosen)


def _information(
    at: SurveyParameters, azimuth_deg: float, inclination_deg: float, noises: Floats, gravity: float
) -> Floats:
    """(P, P) Fisher information of additional shots in one direction with four rolls."""
    angles = np.broadcast_arrays(azimuth_deg, inclination_deg, ROLLS_DEG)
    attitudes = attitudes_of(*angles) @ at.to_instrument
    there = at.with_attitudes(attitudes)
    group = ShotGroup.of(*predict_readings(at, attitudes), np.zeros(len(attitudes), np.intp))
    layout = SurveyLayout(len(attitudes), gravity)
    matrix = group.linearise(there, group.guess(there), layout, noises).matrix
    own, other = layout.instrument, layout.attitudes
    added: Floats = matrix[own, own] - matrix[own, other] @ np.linalg.solve(matrix[other, other], matrix[other, own])
    return added
