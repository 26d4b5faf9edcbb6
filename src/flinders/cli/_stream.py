"""Conversion of a recording to headings, reading by reading, for ``flinders heading`` and ``swing``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flinders.cli._inputs import load_for_recordings, refuse_calibrations, site_of
from flinders.cli._output import bias_words, say
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.cli._options import Accelerometer, Place
    from flinders.heading.smoothing import Filter
    from flinders.workflows.heading_stream import HeadingStream


def open_log(
    command: str,
    calibration: str | None,
    recording: str,
    *,
    place: Place,
    accelerometer: Accelerometer,
    formula: str = "exact",
    declination_deg: float | None = None,
    dip_deg: float | None = None,
    fixed: tuple[str, ...] = (),
    by: Filter | None = None,
    has_stated_place: bool = False,
    grid: bool = False,
    **reading: Any,
) -> HeadingStream:
    """Open a recording with or without a calibration, and find the field at its site.

    With `has_stated_place`, a place that the log states is used like a typed one.
    """
    from flinders.core.axes import Axes
    from flinders.core.geomag import recorded_field
    from flinders.readers import open_recording
    from flinders.workflows.heading_stream import HeadingStream
    from flinders.workflows.recordings import identity_fit, open_with

    _refuse_contradictions(place, accelerometer, formula, declination_deg)
    Axes.of(accelerometer.acceleration_axes)
    if place.place is not None and place.date is not None:
        site_of(place.place, place.date, model=place.model)  # refuses a bad place or day before the recording is read
    if calibration is None:
        fit = identity_fit(open_recording(recording, **reading))
    else:
        fit = load_for_recordings(command, calibration, [recording], fixed)
    refuse_calibrations([recording])
    opened = open_with(fit, recording, once=True, **reading)
    site = None if place.place is None else site_of(place.place, place.date, opened, model=place.model)
    if has_stated_place and place.place is None and declination_deg is None and dip_deg is None:
        site = recorded_field(opened)
        if site is not None:
            say(f"{opened.source}: the log states place and time: {site}; used unless --at is given")
    stream = HeadingStream.of(
        opened,
        fit,
        site=site,
        declination_deg=declination_deg,
        dip_deg=dip_deg,
        level=accelerometer.is_level,
        acceleration=accelerometer.acceleration,
        acceleration_axes=accelerometer.acceleration_axes,
        formula=formula,
        by=by,
        grid=grid,
    )
    if (bias := stream.compass.acceleration_bias) is not None:
        gains = "" if stream.compass.acceleration_matrix is None else ", and its gains and angles between its axes"
        say(f"{bias_words(bias)}, by {calibration}: removed{gains}")
    return stream


def _refuse_contradictions(
    place: Place, accelerometer: Accelerometer, formula: str, declination_deg: float | None
) -> None:
    """Refuse options that contradict each other."""
    if accelerometer.is_level and formula != "exact":
        raise UsageError(f"--level ignores tilt, --formula {formula} corrects tilt: leave one of them out")
    if accelerometer.is_level and accelerometer.acceleration is not None:
        raise UsageError("--level uses no accelerometer, --acceleration names its columns: leave one of them out")
    if place.place is not None and declination_deg is not None:
        raise UsageError("--at and --declination both give the declination: leave one of them out")
    place.check()
