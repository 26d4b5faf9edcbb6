"""Readings within the range of the sensor.

At its limit a sensor reads the limit, whatever the field: such a reading says only that the field was stronger.

>>> from flinders.summary.quality import Rail
>>> samples = Samples(np.array([[50.0, 0, 0], [40.0, 9, 0], [50.0, 3, 2]]))
>>> [block.field.tolist() for block in WithinRange(samples, (Rail(0, "highest", 50.0, 0.66),)).blocks()]
[[[40.0, 9.0, 0.0]]]
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flinders.core.samples import Recording, Samples, Wrapped

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.estimators.data import Readings
    from flinders.summary.quality import Rail


@dataclass(frozen=True, slots=True, eq=False)
class WithinRange(Wrapped):
    """A recording without the readings at a rail.

    Attributes
    ----------
    recording : Recording
    rails : tuple of Rail
    """

    recording: Recording
    rails: tuple[Rail, ...]

    def blocks(self) -> Iterator[Samples]:
        """Go through the recording."""
        for block in self.recording.blocks():
            free = np.ones(len(block), dtype=bool)
            for rail in self.rails:
                free &= block.field[:, rail.axis] != rail.value
            yield block[free]


def within_range(readings: Readings) -> Readings:
    """Those readings that are at no rail, with the sums of all."""
    rails = readings.summary.health.rails
    return readings.through(lambda recording: WithinRange(recording, rails)) if rails else readings
