"""Readings of several magnetometers at common times, and detection of sensors that repeat those of another.

>>> import numpy as np
>>> fields = np.random.default_rng(1).normal(size=(2, 100, 3))
>>> find_copies(np.stack([fields[0], fields[1], 2.0 * fields[0]]), [None, None, None], 0)
{2: 0}
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, cast

import numpy as np

from flinders.core.joining import read_into_memory
from flinders.core.time_alignment import AlignedReadings, affine_residuals, align_readings
from flinders.errors import InputError, UsageError
from flinders.estimators import Readings, remove_saturated
from flinders.estimators.multi_sensor import MIN_TIMES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.estimators import Estimate

MAX_COPY_NOISE_RATIO: Final = 0.1
"""Largest residual of an affine map between two sensors, relative to the noise, if one repeats the other."""


def require_reference(sources: Mapping[str, Recording], reference: str | None, field_strength: float | None) -> str:
    """Name of the reference, after a check that the sensors can be combined."""
    names = list(sources)
    if len(names) < 2:
        raise UsageError(f"{len(names)} magnetometer: need two or more of one body; use flinders.fit for one")
    if reference is not None and reference not in names:
        raise UsageError(f"reference {reference!r} is none of {', '.join(names)}: name one of them")
    units = {source.unit.inside for source in sources.values()}
    if field_strength is not None and len(units) > 1:
        raise UsageError(
            f"one field strength cannot fit readings in {' and '.join(sorted(units))}: leave the strength out"
        )
    return names[0] if reference is None else reference


def sorted_readings(source: Recording) -> Samples:
    """All readings that are not at a rail, in the order of time."""
    readings = remove_saturated(Readings.of(source))
    readings.require(MIN_TIMES, "together")
    recording = cast("Recording", readings.recording)
    samples = read_into_memory(recording)
    if samples.time is None:
        return samples
    known = np.flatnonzero(np.isfinite(samples.time))
    order = known[np.argsort(samples.time[known], kind="stable")]
    return samples[order.tolist()] if len(order) < len(samples) or np.any(np.diff(order) < 0) else samples


def pair_readings(samples: Sequence[Samples], reference: int) -> AlignedReadings:
    """Readings of all sensors at common times."""
    times = [each.time for each in samples if each.time is not None]
    fields = [each.field for each in samples]
    if len(times) == len(samples):
        common = align_readings(times, fields, reference=reference)
        if len(common.time) < MIN_TIMES:
            spans = "; ".join(f"{each.source}: {time[0]:.1f} to {time[-1]:.1f} s" for each, time in
                              zip(samples, times, strict=True) if len(time))  # fmt: skip
            raise InputError(
                f"two magnetometers have readings at {len(common.time)} common moments, and {MIN_TIMES} are needed "
                f"({spans}): record both at the same time, with one clock"
            )
        return common
    lengths = {len(field) for field in fields}
    if times or len(lengths) > 1:
        lack = "some have time and some have none" if times else f"without time they have {sorted(lengths)} readings"
        raise UsageError(
            f"readings of several magnetometers are matched by time: {lack}. Record the time of each reading"
        )
    zero = np.zeros(len(fields))
    return AlignedReadings(np.arange(lengths.pop(), dtype=float), np.stack(fields), zero, zero)


def find_copies(fields: Floats, starts: Sequence[Estimate | None], reference: int) -> dict[int, int]:
    """Find sensors that repeat the readings of another sensor, rotated and scaled: index of the original by index.

    The reference is never regarded as a copy.
    """
    order = [reference, *(place for place in range(len(fields)) if place != reference)]
    copies: dict[int, int] = {}
    for rank, place in enumerate(order):
        for other in order[:rank]:
            if other not in copies and place not in copies and _is_copy(fields[other], fields[place], starts[place]):
                copies[place] = other
    return copies


def _is_copy(first: Floats, second: Floats, start: Estimate | None) -> bool:
    """Whether an affine map of one sensor's readings gives the other's far better than its noise allows."""
    left = affine_residuals(first, second)
    if len(left) < MIN_TIMES:
        return False
    there = second[np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1)]
    width = float(np.sqrt(np.mean(np.var(there, axis=0))))
    noise = 1e-6 * width if start is None else max(start.noise, 1e-6 * width)
    return float(np.sqrt(np.mean(left**2))) < MAX_COPY_NOISE_RATIO * noise
