"""Simulated recordings with known truth: a sensor and its iron, a motion, noise and disturbances, from one seed.

One line gives a recording, and the result of a perfect fit of it:

>>> recording = tumble(seed=1)
>>> len(recording.samples), recording.samples.unit.inside, recording.field_strength
(3000, 'uT', 50.0)
>>> matrix, offset = recording.sensor.correction
>>> corrected = (recording.samples.field - offset) @ matrix.T
>>> float(np.linalg.norm(corrected, axis=1).std())      # only the noise is left
0.5
>>> angle_error_deg(matrix, offset, recording)
0.0
>>> angle_error_deg(matrix, offset + [1, 0, 0], recording)
0.9

The true model is ``raw = A h + b + n``. World axes are north, east, down; body axes forward, right, down; an attitude
rotates body axes into world axes.

Motions:

============== =============================================== ============ ====
``hand``       tumbled by hand for a minute, smooth in time    acceleration rate
``eight``      waved in figures of eight for a minute          acceleration rate
``uniform``    all directions equally: the best possible
``tilted``     all headings, tilted by up to 35°: a vehicle    acceleration
``level``      all headings, level: not enough for a 3-D fit   acceleration
``drive``      bends and hills for five minutes, 6° at most    acceleration rate
``flight``     banked turns for five minutes, 35° at most      acceleration rate
``swayed``     all headings in a minute, leaning by up to 35°  acceleration rate
``wobble``     to and fro about each axis by 30°, in ten s     acceleration rate
``rocked``     sines in roll, pitch, heading: MAGYC's          acceleration rate
``sweeps``     around in the plane xy, then in yz, then in zx  acceleration rate
``sweep-xy``   around in one plane, and so ``-yz`` and ``-zx`` acceleration rate
``hemisphere`` the field never comes from above: a robot
``clumped``    held still for most of the time
============== =============================================== ============ ====

All parts can be combined:

>>> rough = tumble(
...     seed=2, motion="flight", n=2000, stationary=0.2, outliers=0.01,
...     sensor=Sensor(offset=[10, 0, 0], noise=0.3, resolution=0.15, saturation=80.0),
...     imu=Imu(gyro_bias=[0.01, 0.0, 0.0]),
...     disturbances=[MotorCurrent(0.2), ThermalDrift(0.1), Step(4.0, at=0.7), PassingMagnet(100.0, at=0.3)],
... )
>>> rough.disturbances, rough.samples.current.shape, rough.samples.temperature.shape
(('motor', 'drift', 'step', 'magnet'), (2000,), (2000,))

`truth.Truth` writes the truth to a file.
"""

from __future__ import annotations

import numpy as np  # noqa: F401  for the examples above

from flinders.geometry.rotation import rotation_vectors
from flinders.geometry.sphere import clump, clumped_directions, fibonacci, hemisphere, uniform_directions
from flinders.simulate import truth
from flinders.simulate.attitudes import attitudes_of, in_body_axes, north_and_down, turns  # fmt: skip
from flinders.simulate.disturbances import (
    FieldStep,
    GaussMarkov,
    MotorCurrent,
    Motors,
    NamedColumn,
    PassingMagnet,
    Perturbation,
    Step,
    ThermalDrift,
    stray_fields,
)  # fmt: skip
from flinders.simulate.motions import (
    MOTIONS,
    RATE_HZ,
    Trajectory,
    drive,
    figure_eight,
    flight,
    hand_tumble,
    level_turn,
    planar_sweeps,
    rocked,
    swayed,
    tilted,
)
from flinders.simulate.recording import RATE_NOISE, Imu, Simulated, angle_error_deg, specific_force, tumble, write_csv
from flinders.simulate.sensor import Sensor, soft_iron

__all__ = [
    "MOTIONS",
    "RATE_HZ",
    "RATE_NOISE",
    "FieldStep",
    "GaussMarkov",
    "Imu",
    "MotorCurrent",
    "Motors",
    "NamedColumn",
    "PassingMagnet",
    "Perturbation",
    "Sensor",
    "Simulated",
    "Step",
    "ThermalDrift",
    "Trajectory",
    "angle_error_deg",
    "attitudes_of",
    "clump",
    "clumped_directions",
    "drive",
    "fibonacci",
    "figure_eight",
    "flight",
    "hand_tumble",
    "hemisphere",
    "in_body_axes",
    "level_turn",
    "north_and_down",
    "planar_sweeps",
    "rocked",
    "rotation_vectors",
    "soft_iron",
    "specific_force",
    "stray_fields",
    "swayed",
    "tilted",
    "truth",
    "tumble",
    "turns",
    "uniform_directions",
    "write_csv",
]  # fmt: skip
