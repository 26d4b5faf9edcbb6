"""Recordings with known truth: a sensor and its iron, a motion, noise, disturbances, all from one seed.

One line gives a recording, and what a perfect fit would find in it:

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

Truth is ``raw = A h + b + n`` of DESIGN.md §2. World axes are north, east, down; body axes forward,
right, down; an attitude turns body axes into world axes.

Which motion when:

============== =============================================== ============ ====
``hand``       tumbled by hand for a minute, smooth in time    acceleration rate
``eight``      waved in figures of eight for a minute          acceleration rate
``uniform``    all directions alike: the best there is
``tilted``     all headings, tilted by up to 35°: a vehicle    acceleration
``level``      all headings, level: no 3-D fit can be right    acceleration
``drive``      bends and hills for five minutes, 6° at most    acceleration rate
``flight``     banked turns for five minutes, 35° at most      acceleration rate
``swayed``     all headings in a minute, leaning by up to 35°  acceleration rate
``rocked``     sines in roll, pitch, heading: MAGYC's          acceleration rate
``sweeps``     around in the plane xy, then in yz, then in zx  acceleration rate
``sweep-xy``   around in one plane, and so ``-yz`` and ``-zx`` acceleration rate
``hemisphere`` the field never comes from above: a robot
``clumped``    held still for most of the time
============== =============================================== ============ ====

Anything can be put together:

>>> rough = tumble(
...     seed=2, motion="flight", n=2000, stationary=0.2, outliers=0.01,
...     sensor=Sensor(offset=[10, 0, 0], noise=0.3, resolution=0.15, limit=80.0),
...     imu=Imu(gyro_bias=[0.01, 0.0, 0.0]),
...     disturbances=[MotorCurrent(0.2), ThermalDrift(0.1), Step(4.0, at=0.7), PassingMagnet(100.0, at=0.3)],
... )
>>> rough.disturbances, rough.samples.current.shape, rough.samples.temperature.shape
(('motor', 'drift', 'step', 'magnet'), (2000,), (2000,))

A two-axis compass is `TwoAxis`, and `swing` turns it around; `truth.Truth` keeps what is true in a file; `fleet` makes
any number of units, some of them with a fault.
"""

from __future__ import annotations

import numpy as np  # noqa: F401  for the examples above

from flinders.geometry.rotation import rotation_vectors as rotation_vectors
from flinders.geometry.sphere import clump as clump
from flinders.geometry.sphere import clumped as clumped
from flinders.geometry.sphere import fibonacci as fibonacci
from flinders.geometry.sphere import hemisphere as hemisphere
from flinders.geometry.sphere import uniform as uniform
from flinders.simulate import fleet as fleet
from flinders.simulate import truth as truth
from flinders.simulate.disturbances import Effect as Effect
from flinders.simulate.disturbances import FieldStep as FieldStep
from flinders.simulate.disturbances import GaussMarkov as GaussMarkov
from flinders.simulate.disturbances import MotorCurrent as MotorCurrent
from flinders.simulate.disturbances import Motors as Motors
from flinders.simulate.disturbances import PassingMagnet as PassingMagnet
from flinders.simulate.disturbances import Perturbation as Perturbation
from flinders.simulate.disturbances import Step as Step
from flinders.simulate.disturbances import ThermalDrift as ThermalDrift
from flinders.simulate.disturbances import stray_fields as stray_fields
from flinders.simulate.motions import GRAVITY as GRAVITY
from flinders.simulate.motions import MOTIONS as MOTIONS
from flinders.simulate.motions import RATE_HZ as RATE_HZ
from flinders.simulate.motions import SETTLING as SETTLING
from flinders.simulate.motions import Course as Course
from flinders.simulate.motions import Motion as Motion
from flinders.simulate.motions import Path as Path
from flinders.simulate.motions import Trajectory as Trajectory
from flinders.simulate.motions import drive as drive
from flinders.simulate.motions import figure_eight as figure_eight
from flinders.simulate.motions import flight as flight
from flinders.simulate.motions import hand_tumble as hand_tumble
from flinders.simulate.motions import level_turn as level_turn
from flinders.simulate.motions import north_and_down as north_and_down
from flinders.simulate.motions import planar_sweeps as planar_sweeps
from flinders.simulate.motions import posed as posed
from flinders.simulate.motions import rocked as rocked
from flinders.simulate.motions import seen_from as seen_from
from flinders.simulate.motions import swayed as swayed
from flinders.simulate.motions import tilted as tilted
from flinders.simulate.motions import turns as turns
from flinders.simulate.recording import ACCELERATION_NOISE as ACCELERATION_NOISE
from flinders.simulate.recording import RATE_NOISE as RATE_NOISE
from flinders.simulate.recording import Imu as Imu
from flinders.simulate.recording import Simulated as Simulated
from flinders.simulate.recording import angle_error_deg as angle_error_deg
from flinders.simulate.recording import specific_force as specific_force
from flinders.simulate.recording import tumble as tumble
from flinders.simulate.sensor import Sensor as Sensor
from flinders.simulate.sensor import soft_iron as soft_iron
from flinders.simulate.table import write_csv as write_csv
from flinders.simulate.two_axis import TwoAxis as TwoAxis
from flinders.simulate.two_axis import swing as swing
