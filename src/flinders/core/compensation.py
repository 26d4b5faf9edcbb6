"""Compensation of a recording: readings with all disturbances at their references, and with linear axes.

A calibration with `disturbances` or a `linearization` compensates readings first. The compensated readings are then
corrected by its matrix and offset alone, `Calibration.affine`. A fit, a check, headings and a filter follow these two
steps.

>>> from flinders.core.calibration import Calibration
>>> from flinders.core.disturbance import Disturbance
>>> motors = Disturbance("current", [0.5, 0.0, 0.0], highest=20.0)
>>> calibration = Calibration(np.eye(3), [10.0, 0.0, 0.0], 50.0, disturbances=(motors,))
>>> flown = Samples.of([[60.0, 0.0, 0.0], [65.0, 0.0, 0.0]], current=[0.0, 10.0])
>>> Compensator(calibration)(flown).field
array([[60.,  0.,  0.],
       [60.,  0.,  0.]])
>>> calibration.affine.apply(Compensator(calibration)(flown).field)
array([[50.,  0.,  0.],
       [50.,  0.,  0.]])
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from flinders.core.disturbance import lagged_values, reference_hint, shift_and_gain
from flinders.core.joining import Joined
from flinders.core.samples import Recording, RecordingWrapper, Samples
from flinders.errors import InputError, figures

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.disturbance import Disturbance


@dataclass(slots=True, eq=False)
class Compensator:
    """Compensation of the blocks of one recording, in the order of time."""

    calibration: Calibration  #: an affine calibration changes nothing
    #: for each disturbance: largest excess of its values over its recorded range, as a fraction of that range
    beyond: dict[str, float] = field(default_factory=dict)
    _before: dict[str, tuple[Floats, Floats]] = field(default_factory=dict)

    def __call__(self, samples: Samples) -> Samples:
        """Compensate a block.

        Raises `InputError` if a column is missing; the message states the heading error to expect without it.
        """
        disturbances = self.calibration.disturbances
        if self.calibration.is_affine or not len(samples):
            return samples
        if lacking := [disturbance for disturbance in disturbances if not _is_recorded(samples, disturbance)]:
            message = missing_columns_message(self.calibration, lacking, samples.source)
            raise InputError(message, hint=reference_hint(lacking))
        values = {disturbance.name: self._values(disturbance, samples) for disturbance in disturbances}
        shift, gain = shift_and_gain(disturbances, values)
        offset, linearization = self.calibration.offset, self.calibration.linearization
        compensated = samples.field - shift
        if linearization is not None:
            compensated = offset + linearization.apply(compensated - offset)
        if any(disturbance.gain_per_unit for disturbance in disturbances):
            compensated = offset + (compensated - offset) / gain[..., np.newaxis]
        return replace(samples, field=compensated)

    def warnings(self) -> Iterator[str]:
        """Yield a warning for each disturbance whose values exceeded its recorded range."""
        for disturbance in self.calibration.disturbances:
            share = self.beyond.get(disturbance.name, 0.0)
            if share > 0.0:
                yield range_warning(disturbance, share)

    def _values(self, disturbance: Disturbance, samples: Samples) -> Floats:
        """(N,) values of a disturbance at the time of each reading minus the lag, also from the block before."""
        column = disturbance.numbers(cast("Floats", samples.disturbance_values(disturbance.name)))
        self.beyond[disturbance.name] = max(self.beyond.get(disturbance.name, 0.0), disturbance.range_excess(column))
        if samples.time is None:
            return lagged_values(column, None, 0.0)
        time, values = samples.time, column
        if disturbance.name in self._before:
            time, values = (
                np.concatenate([old, new])
                for old, new in zip(self._before[disturbance.name], (time, values), strict=True)
            )
        recent = time >= time[-1] - 2.0 * abs(disturbance.lag_s) - 1.0
        self._before[disturbance.name] = time[recent], values[recent]
        return lagged_values(values, time, disturbance.lag_s)[-len(samples) :]


@dataclass(frozen=True, slots=True, eq=False)
class Compensated(RecordingWrapper):
    """A recording whose blocks are compensated as they are read."""

    recording: Recording
    calibration: Calibration  #: with the disturbances and the linearization to remove

    def blocks(self) -> Iterator[Samples]:
        """Yield compensated blocks."""
        compensate = Compensator(self.calibration)
        for block in self.recording.blocks():
            yield compensate(block)


def compensate_recording(recording: Recording, calibration: Calibration) -> Recording:
    """Compensate a recording; the parts of a joined recording are compensated separately."""
    if calibration.is_affine:
        return recording
    if isinstance(recording, Joined):
        return Joined(tuple(compensate_recording(part, calibration) for part in recording.recordings))
    if isinstance(recording, Samples):
        return Compensator(calibration)(recording)
    return Compensated(recording, calibration)


def _is_recorded(samples: Samples, disturbance: Disturbance) -> bool:
    """Whether a block has values of a disturbance."""
    column = samples.disturbance_values(disturbance.name)
    return column is not None and bool(np.isfinite(disturbance.numbers(column)).any())


def missing_columns_message(calibration: Calibration, lacking: Sequence[Disturbance], source: str) -> str:
    """Message about missing columns: the heading error without them, and the remedy."""
    worst = max(lacking, key=calibration.disturbance_deg)
    cost = figures(min(calibration.disturbance_deg(worst), 180.0))
    names, one = " or ".join(disturbance.name for disturbance in lacking), len(lacking) == 1
    at = worst.text_of(worst.extreme_value) + ("" if one else f" of {worst.name}")
    return (
        f"{source} has no {names}, which the calibration corrects for: without {'it' if one else 'them'} headings are "
        f"wrong by up to {cost}° at {at} (dip 60°). Record {'it' if one else 'them'} with the readings, or take the "
        "calibration at a fixed value"
    )


def range_warning(disturbance: Disturbance, share: float) -> str:
    """Warning that values of a disturbance exceed its recorded range, by `share` of that range."""
    return (
        f"{disturbance.name} exceeds the calibrated range, {disturbance.lowest:.3g} to "
        f"{disturbance.text_of(disturbance.highest)}, by {share:.0%} of it: "
        "its offset is extrapolated there; calibrate over the whole range"
    )
