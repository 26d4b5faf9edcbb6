"""Known headings from a drive: the course over ground on straight stretches, of a vehicle that points where it goes.

While a vehicle moves straight and fast enough, its course is its heading but for crab: wind, current, a slope. Crab by
a steady wind is e(h) = a sin h + b cos h over the heading h, the same a and b on all stretches, and moves the offset
as hard iron does; it counts with its prior on all of them together (`PoseSigmas.crab_deg`).

>>> from types import SimpleNamespace
>>> from flinders.core.samples import Samples
>>> time = np.arange(0.0, 60.0, 0.1)
>>> along = np.where(time < 30.0, 0.0, np.pi / 2.0)
>>> velocity = SimpleNamespace(time=time, values=10.0 * np.column_stack([np.cos(along), np.sin(along)]))
>>> samples = Samples.of(np.zeros((600, 3)), unit="uT", time=time)
>>> [(round(stretch.course_deg) % 360, len(stretch.samples)) for stretch in stretches(samples, velocity)]
[(0, 288), (90, 288)]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.errors import FitError, UsageError
from flinders.fitting.known_heading import SIGMAS, is_still, refresh_at_headings
from flinders.fitting.refreshing import known_shape, samples_of
from flinders.geometry.angles import wrapped
from flinders.geometry.ellipsoid import symmetric
from flinders.heading.stationary import rests

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.core.samples import Samples
    from flinders.fitting.calibrate import AnyReadings
    from flinders.fitting.result import Fit
    from flinders.readers._resample import TimeSeries

SLOWEST: Final = 3.0
"""Speed over ground below which a course is no heading, m/s."""
STRAIGHT_S: Final = 5.0
"""Shortest straight stretch."""
CRAB_DEG: Final = 2.0
"""1 σ of what wind, current or a slope turn the course from the heading."""
LEAST_READINGS: Final = 20
"""In a stretch."""
MOST: Final = 100
"""Stretches that are used, the longest."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """A straight stretch of a drive: its readings, true course, and the scatter of that, 1 σ of a fix, in degrees."""

    samples: Samples
    course_deg: float
    scatter_deg: float


def stretches(samples: Samples, velocity: TimeSeries, *, slowest: float = SLOWEST) -> list[Stretch]:
    """Find where a vehicle went straight, at least so fast.

    Parameters
    ----------
    samples : Samples
        With times.
    velocity : TimeSeries
        (M,) times by the same clock and (M, 2) m/s over ground, north and east.
    slowest : float, m/s

    Raises
    ------
    UsageError
        For readings without times.
    """
    if samples.time is None:
        raise UsageError(f"{samples.source} has no times: courses go with a log")
    north, east = velocity.values.T
    course = np.where(np.hypot(north, east) >= slowest, wrapped(np.rad2deg(np.arctan2(east, north))), np.nan)
    step = float(np.median(np.diff(velocity.time))) if len(velocity.time) > 1 else np.inf
    least = max(round(STRAIGHT_S / step), 8) if step > 0.0 else 8
    straight = []
    for rest in rests(course, least_readings=least):
        begin, end = velocity.time[rest.start], velocity.time[rest.stop - 1]
        part = samples[(samples.time >= begin) & (samples.time <= end)]
        if len(part) >= LEAST_READINGS:
            straight.append(Stretch(part, rest.heading_deg, max(rest.spread_deg, rest.sigma_deg)))
    return sorted(straight, key=lambda stretch: -len(stretch.samples))[:MOST]


def refresh_on_courses(
    recording: AnyReadings,
    previous: Fit,
    velocity: TimeSeries,
    *,
    declination_deg: float,
    slowest: float = SLOWEST,
    crab_deg: float = CRAB_DEG,
    **judged: Any,
) -> Fit:
    """Renew the hard iron of a calibration from the straight stretches of a drive.

    For cars, boats and aircraft with wings; a multirotor may point anywhere.

    Parameters
    ----------
    recording, previous, **judged
        As for `refresh_at_headings`: dip, site, target.
    velocity : TimeSeries
        As for `stretches`, such as `Instrument.velocity`.
    declination_deg : float
        Of the place.
    slowest : float, m/s
        Speed below which a course is not used.
    crab_deg : float, degrees
        1 σ of what the course and the heading differ by.

    Raises
    ------
    FitError
        Where the vehicle never went straight and fast enough in a steady field.
    """
    samples = replace(samples_of(recording, previous), frame=previous.calibration.frame)
    straight = stretches(samples, velocity, slowest=slowest)
    steady = _steady(straight, previous)
    if not steady:
        raise FitError(
            f"no stretch of {STRAIGHT_S:g} s at {slowest:g} m/s or more with a steady field (of {len(straight)} "
            "straight ones): drive straight on several headings, on level ground and away from iron"
        )
    headings = [stretch.course_deg - declination_deg for stretch in steady]
    scatter = float(np.median([stretch.scatter_deg for stretch in steady]))
    sigmas = replace(SIGMAS, heading_deg=min(max(scatter, SIGMAS.heading_deg), 45.0), crab_deg=crab_deg)
    return refresh_at_headings([stretch.samples for stretch in steady], previous, headings, sigmas=sigmas, **judged)


def _steady(straight: Sequence[Stretch], previous: Fit) -> list[Stretch]:
    """Those during which the field was steady, as on a vehicle that neither rolls nor passes iron."""
    shape = symmetric(known_shape(previous, None).entries)
    return [stretch for stretch in straight if is_still(stretch.samples.field, shape)]
