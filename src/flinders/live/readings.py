"""What a running sensor says: readings, and what happens to it in between.

>>> samples = Samples.of([[217, 4, -586]], unit="mG", time=[0.1], acceleration=[[0, 0, 9.8]])
>>> readings_of(samples)
[Reading(time=0.1, field=(21.7, 0.4, -58.6), unit='uT', acceleration=(0.0, 0.0, 9.8), rate=None, temperature=None)]
>>> samples_of(readings_of(samples)).field
array([[ 21.7,   0.4, -58.6]])
>>> print(FeedEvent("gone", 12.5, "/dev/ttyACM0 is gone: check the cable"))
12.5 s: /dev/ttyACM0 is gone: check the cable
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np

from flinders.core.samples import Samples
from flinders.core.units import MICROTESLA, Unit
from flinders.errors import UnitError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats

Vector: TypeAlias = tuple[float, float, float]

Kind: TypeAlias = Literal["connected", "settled", "nothing", "garbage", "lost", "gone", "back", "ended"]
"""It is there; how its lines are written is known; nothing usable has come for a while; lines that are not like the
first ones; this machine was too busy to take all; it went away; it is there again; nothing more will come."""


class Reading(NamedTuple):
    """One reading.

    Attributes
    ----------
    time : float, s
        By the sensor's clock where it has one, else since the start.
    field : (3,) float, in `unit`
        As measured, in the axes of the sensor; finite.
    unit : str
        ``uT``, or ``counts`` where no scale is known.
    acceleration : (3,) float, optional
        Specific force in any unit.
    rate : (3,) float, rad/s, optional
    temperature : float, °C, optional
    """

    time: float
    field: Vector
    unit: str
    acceleration: Vector | None = None
    rate: Vector | None = None
    temperature: float | None = None


@dataclass(frozen=True, slots=True)
class FeedEvent:
    """Something that happened to a source of readings.

    Attributes
    ----------
    kind : str
        As `Kind`.
    at : float, s
        Since the start.
    words : str
        For people.
    """

    kind: Kind
    at: float
    words: str

    def __str__(self) -> str:
        return f"{self.at:.1f} s: {self.words}"


def readings_of(samples: Samples) -> list[Reading]:
    """Take samples apart; without a time they are 0 s apart, and auxiliary values that are not finite become None."""
    times = np.zeros(len(samples)) if samples.time is None else samples.time
    auxiliary = zip(
        _vectors(samples.acceleration, len(samples)),
        _vectors(samples.rate, len(samples)),
        [None] * len(samples) if samples.temperature is None else samples.temperature.tolist(),
        strict=True,
    )
    return [
        Reading(time, (x, y, z), samples.unit.inside, acceleration, rate, _finite(temperature))
        for time, (x, y, z), (acceleration, rate, temperature) in zip(
            times.tolist(), samples.field.tolist(), auxiliary, strict=True
        )
    ]


def samples_of(readings: Sequence[Reading], source: str = "live") -> Samples:
    """Put readings together, ready for a fit; what only some of them have is NaN in the others.

    Raises
    ------
    UnitError
        For readings in more than one unit.
    """
    inside = {reading.unit for reading in readings} or {MICROTESLA}
    unit = Unit.of(inside.pop())
    if inside:
        raise UnitError(f"{source} has readings in {unit.inside} and in {inside.pop()}: take those in one unit")
    return Samples.of(
        [reading.field for reading in readings] or np.empty((0, 3)),
        unit=unit,
        time=[reading.time for reading in readings],
        acceleration=_column([reading.acceleration for reading in readings]),
        rate=_column([reading.rate for reading in readings]),
        temperature=_alone([reading.temperature for reading in readings]),
        source=source,
    )


def _vectors(rows: Floats | None, count: int) -> list[Vector | None]:
    if rows is None:
        return [None] * count
    return [(x, y, z) if math.isfinite(x + y + z) else None for x, y, z in rows.tolist()]


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _column(rows: list[Vector | None]) -> list[Vector] | None:
    nothing = (math.nan, math.nan, math.nan)
    return [row or nothing for row in rows] if any(row is not None for row in rows) else None


def _alone(values: list[float | None]) -> list[float] | None:
    there = any(value is not None for value in values)
    return [math.nan if value is None else value for value in values] if there else None
