"""A recording in which a vehicle rests on one heading after another, with or without a calibration, and its rests.

>>> from flinders.core.samples import Samples
>>> around = np.deg2rad(np.repeat([10.0, 100.0, 190.0, 280.0], 100))
>>> field = np.column_stack([20.0 * np.cos(around), -20.0 * np.sin(around), np.full(400, 40.0)])
>>> recording = read_rests(Samples.of(field, unit="uT"), level=True)
>>> [round(rest.heading_deg) for rest in recording.rests]
[10, 100, 190, 280]
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.apps.marine.deviation import Expected, fit
from flinders.apps.marine.swing_table import NEED
from flinders.comparison.rotation_difference import rotation_covariance
from flinders.errors import FitError, NoAccelerometer, UsageError, count_text
from flinders.estimators.data import recording_of
from flinders.fitting.fit_file import fit_for
from flinders.geometry.angles import heading_text, wrap_180
from flinders.heading.error_propagation import deviation_covariance
from flinders.heading.stationary import MIN_REST_READINGS, half_turns, rests
from flinders.summary.summary import Summary
from flinders.workflows.heading_stream import HeadingStream
from flinders.workflows.recordings import identity_fit, recording_for

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.apps.marine.deviation import Deviation
    from flinders.core.geomag import SiteField
    from flinders.fitting.fit_file import AnyCalibration
    from flinders.heading.stationary import HalfTurn, Rest
    from flinders.workflows.notes import Note
    from flinders.workflows.recordings import AnyReadings

STATIONARY_S: Final = 2.0
"""Shortest rest of a recording with times."""

MIN_READINGS: Final = 8
"""Smallest number of readings in a rest."""

MAX_LISTED: Final = 12
"""Largest number of rests that an error names."""


@dataclass(frozen=True, slots=True, eq=False)
class SwingRecording:
    """A recording that was read completely, and its rests."""

    stream: HeadingStream
    rests: tuple[Rest, ...]
    is_calibrated: bool  #: whether readings were corrected by a calibration

    @classmethod
    def of(cls, stream: HeadingStream, *, is_calibrated: bool, stationary_s: float | None = None) -> Self:
        """Read a stream completely, and find its rests of at least `stationary_s` seconds.

        Raises `NoAccelerometer` without an accelerometer; without a calibration the message lists all inputs of a
        swing.
        """
        try:
            blocks = [(headings.magnetic_deg, samples.time) for _, samples, headings in stream.headings()]
        except NoAccelerometer as error:
            if is_calibrated:
                raise
            raise NoAccelerometer(
                f"{stream.recording.source} is no table of headings, and has no accelerometer: {NEED}; "
                "or give a recording with an accelerometer, or state that the sensor never tilts",
                hint=error.hint,
            ) from None
        times = [time for _, time in blocks if time is not None]
        steps = np.diff(np.concatenate(times)) if times else np.empty(0)
        step = float(np.median(steps[np.isfinite(steps)])) if np.isfinite(steps).any() else 0.0
        shortest_s = STATIONARY_S if stationary_s is None else stationary_s
        least = max(round(shortest_s / step), MIN_READINGS) if step > 0.0 else MIN_REST_READINGS
        heading = np.concatenate([headings for headings, _ in blocks])
        return cls(stream, rests(heading, least_readings=least), is_calibrated)

    @property
    def source(self) -> str:
        """Name of the recording."""
        return self.stream.recording.source

    @property
    def doubts(self) -> tuple[Note, ...]:
        """Notes on readings that do not fit their calibration; empty without a calibration."""
        return self.stream.corrector.notes() if self.is_calibrated else ()

    def half_turns(self) -> tuple[HalfTurn, ...]:
        """Pairs of rests that are half a turn apart."""
        return half_turns(self.rests)

    def deviation(
        self, headings_deg: Sequence[float], *, site: SiteField | None = None, sigma_deg: float | None = None
    ) -> Deviation:
        """Fit the deviation of rests on known headings, which are true headings if a site is given.

        Raises `FitError` unless there is a heading for each rest.
        """
        if len(self.rests) != len(headings_deg):
            raise FitError(
                f"{count_text(len(headings_deg), 'heading')} for {self.source}, which has {self.rest_words()}: give "
                "one heading for each rest, in order, or change the shortest duration of a rest",
                hint={"headings_deg": None, "stationary_s": None},
                rests=len(self.rests),
                headings=len(headings_deg),
            )
        seen = np.array([rest.heading_deg for rest in self.rests])
        magnetic = np.array(headings_deg) - (0.0 if site is None else site.declination_deg)
        return fit(seen, wrap_180(magnetic - seen), sigma_deg=sigma_deg)

    def expected_deviation(self) -> Expected | None:
        """Expected deviation from the claimed uncertainty of the calibration and its rotation; None without a claim."""
        known = self.stream.fit
        if not known.claim.states_uncertainty:
            return None
        dip, source = self.stream.site_dip()
        covariance = deviation_covariance(
            known.calibration.ellipsoid,
            known.claim.claimed_covariance,
            dip_deg=dip,
            down=self.stream.down_in_body(),
            rotation=known.calibration.rotation_matrix,
            rotation_covariance=rotation_covariance(known),
        )
        return Expected(covariance, dip, source)

    def rest_words(self) -> str:
        """Number and headings of the rests, in words."""
        shown = ", ".join(heading_text(rest.heading_deg, 0) for rest in self.rests[:MAX_LISTED])
        more = ", …" * (len(self.rests) > MAX_LISTED)
        return f"{count_text(len(self.rests), 'rest')}{f' on {shown}{more}' if self.rests else ''}"


def read_rests(
    source: AnyReadings,
    calibration: AnyCalibration | None = None,
    *,
    site: SiteField | None = None,
    stationary_s: float | None = None,
    level: bool = False,
    acceleration: str | None = None,
    acceleration_axes: str = "x,y,z",
) -> SwingRecording:
    """Compute headings of a recording, and find the rests of the vehicle.

    Parameters
    ----------
    source, site, level, acceleration, acceleration_axes
        As for `flinders.headings`.
    calibration : Fit, Calibration or path, optional
        Calibration of this sensor; by default the readings are used as they are.
    stationary_s : float, s
        Shortest rest; by default 2 s, or 50 readings for a recording without times.

    Raises
    ------
    NoAccelerometer, ForeignAxes, InputError, UnitError, AxesError
        As for `flinders.headings`.
    """
    if calibration is None:
        recording, _ = recording_of(source)
        if isinstance(recording, Summary):
            raise UsageError("a swing needs readings: give the recording, not its summary")
        known = identity_fit(recording)
    else:
        known = fit_for(calibration)
        recording = recording_for(source, known)
    stream = HeadingStream.of(
        recording,
        known,
        site=site,
        level=level,
        acceleration=acceleration,
        acceleration_axes=acceleration_axes,
    )
    return SwingRecording.of(stream, is_calibrated=calibration is not None, stationary_s=stationary_s)
