"""The simulated sensor of `flinders live --simulate`, as readings that a page can play.

>>> played = simulated_sensor()
>>> played["rate_hz"], len(played["centi_ut"]) // 3, [at for at, _ in played["said"]]
(50.0, 3800, [4.0, 16.0])
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np

from flinders.live.simulated import DIP_DEG, FIELD_UT, RATE_HZ, SAID, rocked_and_turned
from flinders.simulate import Sensor, north_and_down, seen_from

SEED: Final = 1


def simulated_sensor() -> dict[str, Any]:
    """Readings without noise in 0.01 µT, one after the other; the noise to be added; and what is said when."""
    of_sensor, of_motion, unused = np.random.default_rng(SEED).spawn(3)
    sensor = Sensor.random(of_sensor)
    path = rocked_and_turned(of_motion)
    field = FIELD_UT * seen_from(path.attitudes, north_and_down(DIP_DEG))
    still = replace(sensor, noise=0.0)
    return {
        "rate_hz": RATE_HZ,
        "noise_ut": sensor.noise,
        "centi_ut": (100.0 * still.read(field, unused)).round().astype(int).ravel().tolist(),
        "said": [list(each) for each in SAID],
    }
