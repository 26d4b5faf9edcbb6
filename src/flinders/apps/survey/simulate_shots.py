"""Simulated shots of a survey instrument: gains, axes and offsets of both sensors, noise and errors of aim.

>>> simulated = survey_shots(seed=1, shots=24)
>>> simulated.shots.magnetic.shape, simulated.angles.inclination_deg[:9].round()
((24, 3), array([-2., -3., -3., -3., -8., -8., -8., -8., 89.]))
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.apps.survey.instrument import PROCEDURE, ROLLS_DEG, Angles, Shots
from flinders.errors import UsageError
from flinders.simulate._checks import not_negative
from flinders.simulate.attitudes import attitudes_of, in_body_axes, north_and_down
from flinders.simulate.sensor import Sensor

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import NDArray

    from flinders.arrays import Floats

MAX_OFFSET: Final = 0.1
"""Largest offset of an axis, as a share of the field and of gravity."""

HAND_ERROR_DEG: Final = 5.0
"""Error of roll and direction of an instrument that is held by hand, 1 σ in degrees."""


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedSurvey:
    """Simulated shots, with the true angles and sensors."""

    shots: Shots
    angles: Angles  #: true angles of each shot
    magnetometer: Sensor  #: in units of the field
    accelerometer: Sensor  #: in units of gravity
    dip_deg: float

    def read(self, attitudes: Floats) -> tuple[Floats, Floats]:
        """(N, 3) readings of field and gravity without noise, in (N, 3, 3) attitudes of the instrument."""
        exact = np.random.default_rng(0)
        worlds = ((self.magnetometer, north_and_down(self.dip_deg)), (self.accelerometer, np.eye(3)[2]))
        field, gravity = (
            Sensor(own.matrix, own.offset).read(in_body_axes(attitudes, world), exact) for own, world in worlds
        )
        return field, gravity


def survey_shots(
    seed: int | Generator = 0,
    *,
    shots: int = 56,
    gain: float = 0.02,
    misalignment_deg: float = 1.0,
    noise: float = 0.002,
    aim_deg: float = 0.1,
    dip_deg: float = 63.0,
) -> SimulatedSurvey:
    """Simulate an instrument and its shots in the first directions of the procedure, four rolls to each.

    Raises `UsageError` for another number of shots, or a negative number of the others.

    Parameters
    ----------
    shots : int
        Number of shots: a multiple of four, 56 at most.
    gain : float
        Largest error of each gain.
    misalignment_deg : float
        Largest tilt of each axis of each sensor towards each other axis.
    noise : float
        Noise of one axis of a reading, as a share of the field and of gravity, 1 σ.
    aim_deg : float
        Error of aim about each axis, 1 σ.
    """
    if shots % 4 or not 0 < shots <= 4 * len(PROCEDURE):
        raise UsageError(f"{shots} shots: need a multiple of four, {4 * len(PROCEDURE)} at most")
    for value, name in ((gain, "gain"), (misalignment_deg, "misalignment"), (aim_deg, "error of aim")):
        not_negative(value, name, "")
    rng = np.random.default_rng(seed)
    magnetometer, accelerometer = (_sensor(rng, gain, math.radians(misalignment_deg), noise) for _ in range(2))
    attitudes, groups = _attitudes(rng, shots // 4, math.radians(aim_deg))
    worlds = ((magnetometer, north_and_down(dip_deg)), (accelerometer, np.eye(3)[2]))
    field, gravity = (sensor.read(in_body_axes(attitudes, world), rng) for sensor, world in worlds)
    return SimulatedSurvey(Shots(field, gravity, groups), true_angles(attitudes), magnetometer, accelerometer, dip_deg)


def true_angles(attitudes: Floats) -> Angles:
    """Angles of the x axis in (N, 3, 3) attitudes of an instrument."""
    north, east, down = np.moveaxis(attitudes[:, :, 0], -1, 0)
    return Angles(
        np.degrees(np.arctan2(east, north)) % 360.0,
        np.degrees(np.arctan2(-down, np.hypot(north, east))),
        np.degrees(np.arctan2(attitudes[:, 2, 1], attitudes[:, 2, 2])),
    )


def _sensor(rng: Generator, gain: float, lean: float, noise: float) -> Sensor:
    """Draw a sensor with wrong gains and axes, and an offset."""
    gains = np.diag(rng.uniform(-gain, gain, 3))
    leaning = rng.uniform(-lean, lean, (3, 3)) * (1.0 - np.eye(3))
    return Sensor(np.eye(3) + gains + leaning, rng.uniform(-MAX_OFFSET, MAX_OFFSET, 3), noise)


def _attitudes(rng: Generator, directions: int, aim: float) -> tuple[Floats, NDArray[np.intp]]:
    """(N, 3, 3) attitudes and (N,) group numbers: directions with random aiming errors, four rolls each."""
    azimuth, inclination = np.radians(PROCEDURE[:directions]).T
    sigma = math.radians(HAND_ERROR_DEG)
    north = rng.uniform(0.0, 2.0 * np.pi)
    about = rng.normal(0.0, sigma, (2, directions))
    headings, pitches = np.repeat(np.stack([north + azimuth, inclination]) + about, len(ROLLS_DEG), axis=1)
    rolls = np.tile(np.radians(ROLLS_DEG), directions) + rng.normal(0.0, sigma, len(headings))
    return _add_aim_errors(rng, attitudes_of(headings, pitches, rolls), aim), np.repeat(
        np.arange(directions), len(ROLLS_DEG)
    )


def _add_aim_errors(rng: Generator, attitudes: Floats, aim: float) -> Floats:
    """Attitudes with errors of aim, about the axes across the laser."""
    yaw, pitch = rng.normal(0.0, aim, (2, len(attitudes)))
    aimed: Floats = attitudes @ attitudes_of(yaw, pitch, np.zeros(len(attitudes)))
    return aimed
