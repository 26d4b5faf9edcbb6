"""A calibration renewed by courses over ground: a drive in a steady wind, its log, and what is no drive."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from tests.sentences import assert_raises

import flinders
from flinders import simulate
from flinders.core.geomag import site_field
from flinders.core.samples import Samples
from flinders.errors import FitError, UsageError
from flinders.fitting.known_heading import refresh_on_courses, stretches
from flinders.fitting.result import Fit, Refused
from flinders.geometry.ellipsoid import Ellipsoid, upper_entries
from flinders.heading.error_propagation import level_error
from flinders.readers._resample import TimeSeries

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.simulate.sensor import Sensor

SITE = site_field(47.4, 8.5, 400.0, year=2026.4)
DIP_DEG, FIELD_UT = SITE.inclination_deg, SITE.strength


def drive(
    sensor: Sensor, rng: np.random.Generator, *, crab_deg: float = 2.0, sides: int = 4
) -> tuple[Samples, TimeSeries]:
    """Straight stretches of 12 s at 10 m/s, with turns between; courses are off by crab of a steady wind."""
    begin, corner = rng.uniform(0.0, 360.0), 360.0 / sides
    true = np.concatenate(
        [np.append(np.full(120, begin + side * corner), begin + corner * (side + np.arange(30.0) / 30.0))
         for side in range(sides)]
    )  # fmt: skip
    time = 0.1 * np.arange(len(true))
    magnetic = np.deg2rad(true - SITE.declination_deg)
    flat, down = FIELD_UT * math.cos(math.radians(DIP_DEG)), FIELD_UT * math.sin(math.radians(DIP_DEG))
    tilt = np.deg2rad(rng.normal(size=(2, sides)))[:, np.minimum(np.arange(len(true)) // 150, sides - 1)]
    level = np.column_stack([flat * np.cos(magnetic), -flat * np.sin(magnetic), np.full(len(true), down)])
    turned = level + np.cross(np.column_stack([tilt[0], tilt[1], np.zeros(len(true))]), level)
    wind = rng.normal(0.0, crab_deg, 2)
    heading = np.deg2rad(true)
    course = heading + np.deg2rad(wind[0] * np.sin(heading) + wind[1] * np.cos(heading))
    velocity = 10.0 * np.column_stack([np.cos(course), np.sin(course)]) + rng.normal(0.0, 0.05, (len(true), 2))
    samples = Samples.of(sensor.read(turned, rng), unit="uT", time=time)
    return samples, TimeSeries(time[::2], velocity[::2])


def vehicle(seed: int) -> tuple[Fit, Sensor]:
    """A calibration, and the sensor after something magnetic was moved."""
    first = simulate.tumble(seed=seed, field_strength=FIELD_UT, dip_deg=DIP_DEG)
    earlier = flinders.fit(first.samples, site=flinders.Site(strength=FIELD_UT))
    moved = np.random.default_rng([seed, 7]).normal(0.0, 10.0, 3)
    return earlier, replace(first.sensor, offset=first.sensor.offset + moved)


def error_deg(fit: Fit, sensor: Sensor) -> float:
    """Error of a level heading, rms over all headings."""
    truth = Ellipsoid(sensor.offset, FIELD_UT * sensor.matrix)
    off = np.append(
        fit.calibration.ellipsoid.centre - truth.centre,
        upper_entries(fit.calibration.ellipsoid.shape) - upper_entries(truth.shape),
    )
    return level_error(truth, np.outer(off, off), dip_deg=DIP_DEG).rms


def test_a_drive_on_four_courses_renews_the_offset_as_claimed(trials: Choose) -> None:
    claim, ratios = trials(200, 10), []
    for seed in claim.seeds:
        earlier, sensor = vehicle(seed)
        samples, velocity = drive(sensor, np.random.default_rng([seed, 8]))
        try:
            fit = refresh_on_courses(
                samples,
                earlier,
                velocity,
                declination_deg=SITE.declination_deg,
                target_deg=3.0,
                site=flinders.Site(inclination_deg=DIP_DEG),
            )
        except Refused as refused:
            fit = refused.fit
        ratios.append(error_deg(fit, sensor) / fit.heading_error_deg.rms)
    rms = float(np.sqrt(np.mean(np.square(ratios))))
    assert 1.0 - 0.3 * claim.widening < rms < 1.0 + 0.3 * claim.widening


def test_stretches_are_straight_and_fast() -> None:
    _, sensor = vehicle(1)
    samples, velocity = drive(sensor, np.random.default_rng(3), sides=5)
    assert len(stretches(samples, velocity)) == 5
    assert not stretches(samples, velocity, slowest=11.0)
    with assert_raises(UsageError):
        stretches(replace(samples, time=None), velocity)


def test_a_drive_without_a_straight_stretch_is_refused() -> None:
    earlier, sensor = vehicle(1)
    samples, velocity = drive(sensor, np.random.default_rng(3))
    with assert_raises(FitError, found=0, slowest=20):
        refresh_on_courses(
            samples, earlier, velocity, declination_deg=0.0, slowest=20.0, site=flinders.Site(inclination_deg=DIP_DEG)
        )


# a log of ArduPilot


# the log of a boat beside the readings
