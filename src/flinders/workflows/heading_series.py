"""Magnetic and true headings of a recording, with their expected error.

A level vehicle that turns:

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> tumble = simulate.tumble(seed=1)
>>> fit = calibrate.fit(tumble.samples)
>>> turn = simulate.tumble(seed=2, motion="level", sensor=tumble.sensor)
>>> series = headings(turn.samples, fit, level=True, declination_deg=3.0)
>>> series.headings.true_deg.shape, series.summary.claim.level
((1000,), HeadingError(rms=0.06°, worst=0.07°, dip=60°))
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flinders.core.geomag import recorded_field
from flinders.core.keywords import check_keywords
from flinders.fitting.fit_file import fit_for
from flinders.heading.compass import Headings
from flinders.heading.smoothing import Filter
from flinders.workflows.correction import PARAMETERS_ELSEWHERE
from flinders.workflows.heading_stream import HeadingStream
from flinders.workflows.recordings import recording_for

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.arrays import Floats
    from flinders.core.geomag import SiteField
    from flinders.fitting.fit_file import AnyCalibration
    from flinders.workflows.heading_stream import HeadingSummary
    from flinders.workflows.recordings import AnyReadings


@dataclass(frozen=True, slots=True, eq=False)
class HeadingSeries:
    """Headings of a recording, one for each reading."""

    headings: Headings  #: (N,) each, in degrees: magnetic, true and grid heading, roll, pitch, dip; NaN if missing
    time: Floats | None  #: (N,) s, by the clock of the recording
    summary: HeadingSummary

    def __repr__(self) -> str:
        return f"HeadingSeries({self.summary})"


@check_keywords(PARAMETERS_ELSEWHERE)
def headings(
    source: AnyReadings,
    calibration: AnyCalibration,
    *,
    site: SiteField | None = None,
    declination_deg: float | None = None,
    dip_deg: float | None = None,
    level: bool = False,
    acceleration: str | None = None,
    acceleration_axes: str = "x,y,z",
    formula: str = "exact",
    at: Mapping[str, float] | None = None,
    by: Filter | str | None = None,
    grid: bool = False,
) -> HeadingSeries:
    """Compute headings of the sensor's x axis in a recording, clockwise from north, with their expected error.

    The accelerometer in the recording compensates the tilt, in any attitude.

    Parameters
    ----------
    source : Samples, Recording, (N, 3) array-like, path, open file or data frame
        Raw readings in the unit and axes of the calibration, with accelerations unless `level`; as for
        `flinders.apply`.
    calibration : Fit, Calibration or path
        Calibration of this sensor.
    site : SiteField, optional
        Field at the place, from `flinders.core.geomag.site_field`; its declination gives true headings. By default that
        of a log that states place and time, unless a declination or dip is given.
    declination_deg : float, degrees
        Declination, positive to the east; replaces the site.
    dip_deg : float, degrees
        Dip for the heading error. By default that of the site, else the measured dip, else 60°.
    level : bool
        Use x and y only, for a sensor that is always level.
    acceleration : str, optional
        Columns of the accelerometer in a text: three names, or numbers from 1.
    acceleration_axes : str
        Source of each axis of the acceleration, such as ``"x,-y,-z"``.
    formula : str
        Formula of the tilt compensation: ``exact``, or ``an4248`` and ``an3192`` for comparison.
    at, by
        As for `flinders.apply`.
    grid : bool
        Also give headings from grid north at the site: UTM, or UPS around the poles.

    Returns
    -------
    HeadingSeries
        (N,) headings, and the expected heading error with notes on its limits.

    Raises
    ------
    NoAccelerometer
        Without accelerations, unless `level`.
    ForeignAxes
        If accelerometer and magnetometer have different axes; the error names axes that agree.
    InputError, UnitError, AxesError
        As `flinders.apply`.
    UsageError
        For arguments that contradict each other, or an unknown formula.

    Examples
    --------
    >>> from flinders import simulate
    >>> from flinders.fitting import calibrate
    >>> tumble = simulate.tumble(seed=3)
    >>> series = headings(tumble.samples, calibrate.fit(tumble.samples), declination_deg=-4.0)
    >>> series.summary.voyage.readings, [note.code for note in series.summary.notes]
    (3000, ['mounting-unobserved'])
    """
    fit = fit_for(calibration)
    recording = recording_for(source, fit)
    if site is None and declination_deg is None and dip_deg is None:
        site = recorded_field(recording)
    stream = HeadingStream.of(
        recording,
        fit,
        site=site,
        declination_deg=declination_deg,
        dip_deg=dip_deg,
        level=level,
        acceleration=acceleration,
        acceleration_axes=acceleration_axes,
        formula=formula,
        at=at,
        by=Filter.of(by) if isinstance(by, str) else by,
        grid=grid,
    )
    blocks: list[Headings] = []
    times: list[Floats | None] = []
    for _, samples, block in stream.headings():
        blocks.append(block)
        times.append(samples.time)
    known = [time for time in times if time is not None]
    time = np.concatenate(known) if known and len(known) == len(times) else None
    return HeadingSeries(Headings.concatenate(blocks), time, stream.summary())
