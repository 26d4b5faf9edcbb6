"""Readings as they would be with all drivers at their reference: what is left of a recording for a plain calibration.

A calibration with `drivers` is a plain one, `Calibration.at()`, of settled readings. Everything that works on
readings (a fit, a check, headings, a filter) settles them first, and needs to know of drivers no more.

>>> from flinders.core.calibration import Calibration
>>> from flinders.core.disturbance import Driver
>>> motors = Driver("current", [0.5, 0.0, 0.0], highest=20.0)
>>> driven = Calibration(np.eye(3), [10.0, 0.0, 0.0], 50.0, drivers=(motors,))
>>> flown = Samples.of([[60.0, 0.0, 0.0], [65.0, 0.0, 0.0]], current=[0.0, 10.0])
>>> Settler(driven)(flown).field
array([[60.,  0.,  0.],
       [60.,  0.,  0.]])
>>> driven.at().apply(Settler(driven)(flown).field)
array([[50.,  0.,  0.],
       [50.,  0.,  0.]])
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from flinders.core.disturbance import effect, lagged
from flinders.core.samples import Joined, Recording, Samples, Wrapped
from flinders.errors import InputError, figures

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.disturbance import Driver


@dataclass(slots=True, eq=False)
class Settler:
    """Takes what drives the offset off the blocks of one recording, in their order.

    Attributes
    ----------
    calibration : Calibration
        With the drivers; without any, readings stay as they are.
    beyond : dict of str to float
        Of each driver, how far it was seen outside the range that it was found in, as a share of it.
    """

    calibration: Calibration
    beyond: dict[str, float] = field(default_factory=dict)
    _before: dict[str, tuple[Floats, Floats]] = field(default_factory=dict)

    def __call__(self, samples: Samples) -> Samples:
        """Settle a block.

        Raises
        ------
        InputError
            Where it lacks a column that the calibration corrects for; says what that costs.
        """
        drivers = self.calibration.drivers
        if not drivers or not len(samples):
            return samples
        if lacking := [driver for driver in drivers if not _is_told(samples, driver)]:
            raise InputError(lacking_words(self.calibration, lacking, samples.source))
        values = {driver.name: self._values(driver, samples) for driver in drivers}
        shift, gain = effect(drivers, values)
        offset = self.calibration.offset
        settled = samples.field - shift
        if any(driver.gain_per_unit for driver in drivers):
            settled = offset + (settled - offset) / gain[:, np.newaxis]
        return replace(samples, field=settled)

    def words(self) -> Iterator[str]:
        """Tell what lay outside the range that a driver was found in."""
        for driver in self.calibration.drivers:
            share = self.beyond.get(driver.name, 0.0)
            if share > 0.0:
                yield beyond_words(driver, share)

    def _values(self, driver: Driver, samples: Samples) -> Floats:
        """(N,) what drives each reading: as much before it as the lag says, also where a block before has it."""
        column = cast("Floats", samples.driving(driver.name))
        self.beyond[driver.name] = max(self.beyond.get(driver.name, 0.0), driver.beyond(column))
        if samples.time is None:
            return lagged(column, None, 0.0)
        time, values = samples.time, column
        if driver.name in self._before:
            time, values = (
                np.concatenate([old, new]) for old, new in zip(self._before[driver.name], (time, values), strict=True)
            )
        recent = time >= time[-1] - 2.0 * abs(driver.lag_s) - 1.0
        self._before[driver.name] = time[recent], values[recent]
        return lagged(values, time, driver.lag_s)[-len(samples) :]


@dataclass(frozen=True, slots=True, eq=False)
class Settled(Wrapped):
    """A recording without what drives its offset.

    Attributes
    ----------
    recording : Recording
    calibration : Calibration
        With the drivers.
    """

    recording: Recording
    calibration: Calibration

    def blocks(self) -> Iterator[Samples]:
        """Yield settled blocks."""
        settle = Settler(self.calibration)
        for block in self.recording.blocks():
            yield settle(block)


def settled(recording: Recording, calibration: Calibration) -> Recording:
    """A recording without what drives its offset; of several joined ones, each on its own.

    Parameters
    ----------
    recording : Recording
    calibration : Calibration
        A recording of one without drivers comes back as it is.
    """
    if not calibration.drivers:
        return recording
    if isinstance(recording, Joined):
        return Joined(tuple(settled(part, calibration) for part in recording.recordings))
    if isinstance(recording, Samples):
        return Settler(calibration)(recording)
    return Settled(recording, calibration)


def _is_told(samples: Samples, driver: Driver) -> bool:
    """Whether a driver was recorded beside readings."""
    column = samples.driving(driver.name)
    return column is not None and bool(np.isfinite(column).any())


def lacking_words(calibration: Calibration, lacking: Sequence[Driver], source: str) -> str:
    """Say what it costs that a recording lacks columns, and what can be done."""
    worst = max(lacking, key=calibration.driven_deg)
    cost = figures(min(calibration.driven_deg(worst), 180.0))
    names, one = " and ".join(driver.name for driver in lacking), len(lacking) == 1
    at = worst.amount(worst.farthest) + ("" if one else f" of {worst.name}")
    held = " ".join(f"--hold {driver.name}={driver.reference:g}" for driver in lacking)
    return (
        f"{source} has no {names}, which the calibration corrects for: without {'it' if one else 'them'} headings are "
        f"off by up to {cost}° at {at} (dip 60°). Record {'it' if one else 'them'} beside the readings, or take the "
        f"calibration at one value with {held}"
    )


def beyond_words(driver: Driver, share: float) -> str:
    """Say that a driver was seen outside the range that it was found in."""
    return (
        f"{driver.name} goes {share:.0%} of its range beyond {driver.lowest:.3g} to {driver.amount(driver.highest)}, "
        "at which the calibration was made: its offset is extrapolated there; calibrate over the whole range"
    )
